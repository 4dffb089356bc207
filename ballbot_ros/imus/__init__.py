# SPDX-License-Identifier: Apache-2.0
"""Inertial sensors on a serial line: codec, stamps, axes, and a sensor in software; no ROS."""
