# SPDX-License-Identifier: Apache-2.0
"""Commands to a real motor: estimation, supervision, session with the drive; no ROS."""
