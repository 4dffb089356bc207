# SPDX-License-Identifier: Apache-2.0
"""Between commands and a real motor: estimate, supervise, keep the drive; no ROS."""
