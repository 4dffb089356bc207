# SPDX-License-Identifier: Apache-2.0
"""Convert sensor data of the ground ahead to a profile with its uncertainties."""
from ballbot_ros.decision.perception.fusion import GroundFusion, Observation, ProfileTracker

__all__ = ['GroundFusion', 'Observation', 'ProfileTracker']
