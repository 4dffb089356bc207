# SPDX-License-Identifier: Apache-2.0
"""From sensor data of the ground ahead to a profile with its uncertainties."""
from ballbot_ros.decision.perception.fusion import GroundFusion, Observation, ProfileTracker
from ballbot_ros.decision.perception.step_tracker import StepTracker
from ballbot_ros.decision.perception.terrain_tracker import TerrainTracker

__all__ = ['GroundFusion', 'Observation', 'ProfileTracker', 'StepTracker', 'TerrainTracker']
