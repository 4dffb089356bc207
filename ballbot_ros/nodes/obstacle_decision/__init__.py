# SPDX-License-Identifier: Apache-2.0
"""The node ``obstacle_decision``: it decides about the step ahead and sends a set-point."""
