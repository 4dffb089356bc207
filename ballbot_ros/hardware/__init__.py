# SPDX-License-Identifier: Apache-2.0
"""Motor controllers on a serial line: transport, codecs and drivers; no ROS, no physics."""
