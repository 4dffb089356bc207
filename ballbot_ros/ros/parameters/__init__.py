# SPDX-License-Identifier: Apache-2.0
"""The parameters of the nodes: declaration, overrides, and changes at run time."""
