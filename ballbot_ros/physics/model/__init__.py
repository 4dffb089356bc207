# SPDX-License-Identifier: Apache-2.0
"""What a scene is made of: robot, terrain, contact options, actuation."""
