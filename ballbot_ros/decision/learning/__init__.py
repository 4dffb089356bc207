# SPDX-License-Identifier: Apache-2.0
"""Outcomes of attempts, and learning of robot, floor and sensor parameters from them."""
