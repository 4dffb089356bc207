# SPDX-License-Identifier: Apache-2.0
"""The node ``imu``: an inertial sensor on a serial line."""
