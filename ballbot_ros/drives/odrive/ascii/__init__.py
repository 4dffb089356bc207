# SPDX-License-Identifier: Apache-2.0
"""ODrive by its ASCII protocol on a serial line."""
