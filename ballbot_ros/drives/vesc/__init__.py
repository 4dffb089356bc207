# SPDX-License-Identifier: Apache-2.0
"""VESC: codec of its protocol, driver, and the drive in software."""
