# SPDX-License-Identifier: Apache-2.0
"""The node ``obstacle_decision``: what to do about the step ahead, and a set-point for it."""
