# SPDX-License-Identifier: Apache-2.0
"""The nodes: declare, convert, call, publish."""
