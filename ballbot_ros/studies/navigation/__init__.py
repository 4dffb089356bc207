# SPDX-License-Identifier: Apache-2.0
"""Evaluation of navigation: random houses, and drives through them in closed loop."""
