# SPDX-License-Identifier: Apache-2.0
"""ODrive with its ASCII protocol on a serial line."""
