# SPDX-License-Identifier: Apache-2.0
"""Shared ROS code of the nodes: parameters, quality of service, conversions, start and stop."""
