# SPDX-License-Identifier: Apache-2.0
"""From what sensors say of the ground ahead to a profile with what is uncertain about it."""
from ballbot_ros.decision.perception.fusion import GroundFusion, Observation, ProfileTracker
from ballbot_ros.decision.perception.step_tracker import StepTracker
from ballbot_ros.decision.perception.terrain_tracker import TerrainTracker

__all__ = ['GroundFusion', 'Observation', 'ProfileTracker', 'StepTracker', 'TerrainTracker']
