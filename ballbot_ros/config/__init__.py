# SPDX-License-Identifier: Apache-2.0
"""Described and ranged fields, the provenance of numbers, and configuration files."""
