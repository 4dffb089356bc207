# SPDX-License-Identifier: Apache-2.0
"""VESC by its serial protocol."""
