# SPDX-License-Identifier: Apache-2.0
"""Bags: writing, reading, checking and replaying recorded runs."""
