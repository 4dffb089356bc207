# SPDX-License-Identifier: Apache-2.0
"""Carry out decisions: set angles, goals, attempts, stuck detection."""
