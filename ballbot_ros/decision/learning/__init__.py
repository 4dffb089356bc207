# SPDX-License-Identifier: Apache-2.0
"""Outcomes of attempts, and what they teach about robot, floor and sensor."""
