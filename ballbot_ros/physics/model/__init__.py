# SPDX-License-Identifier: Apache-2.0
"""The components of a scene: robot, terrain, contact options, actuation."""
