# SPDX-License-Identifier: Apache-2.0
"""The node ``emulated_robot``: a drive on a serial device, the simulated ball and its sensors."""
