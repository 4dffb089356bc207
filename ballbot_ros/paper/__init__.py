# SPDX-License-Identifier: Apache-2.0
"""TODO: one line about this folder."""
