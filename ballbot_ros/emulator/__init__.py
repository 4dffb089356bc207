# SPDX-License-Identifier: Apache-2.0
"""Emulated motor controllers on a real serial device, which drive a simulated ball."""
