# SPDX-License-Identifier: Apache-2.0
"""VESC with its serial protocol."""
