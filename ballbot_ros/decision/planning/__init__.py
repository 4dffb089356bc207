# SPDX-License-Identifier: Apache-2.0
"""Decide on the profile of the ground: stop lines, planners, safety filter."""
