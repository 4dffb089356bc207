# SPDX-License-Identifier: Apache-2.0
"""The node ``controller``: joint states and set-points in, pendulum torque out."""
