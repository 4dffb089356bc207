# SPDX-License-Identifier: Apache-2.0
"""VESC: settings, shared by its serial protocol and the same messages on a CAN bus."""
