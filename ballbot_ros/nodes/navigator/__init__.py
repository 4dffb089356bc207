# SPDX-License-Identifier: Apache-2.0
"""The node ``navigator``: drives to poses on a floor with steps."""
