# SPDX-License-Identifier: Apache-2.0
"""The node ``simulator``: the ball robot, its sensors, and simulated time."""
