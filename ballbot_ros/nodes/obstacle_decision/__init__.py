# SPDX-License-Identifier: Apache-2.0
"""The node ``obstacle_decision``: decisions about the step ahead, and set-points."""
