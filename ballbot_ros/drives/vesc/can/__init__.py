# SPDX-License-Identifier: Apache-2.0
"""VESC on a CAN bus: its serial messages in CAN frames."""
