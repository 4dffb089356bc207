# SPDX-License-Identifier: Apache-2.0
"""Fuse what any sensors of the ground ahead say into one profile."""
from dataclasses import replace
import math
from typing import Optional, Union

from ballbot_ros.decision.observations import StepObservation, TerrainObservation
from ballbot_ros.decision.perception.step_tracker import StepTracker
from ballbot_ros.decision.perception.terrain_tracker import TerrainTracker
from ballbot_ros.decision.profile import Face, Profile
from ballbot_ros.decision.tuning import DecisionTuning
from ballbot_ros.physics.model.robot import Robot

Observation = Union[StepObservation, TerrainObservation]

# A sensor that was silent for so much longer than the other does not count any more [s].
SILENT = 1.0

# Faces of two sensors no farther apart than this, beside what both are uncertain of, are one [m].
SAME_PLACE = 0.05

# Faces that only the step sensor sees are numbered from here, where the terrain is seen too.
STEP_NUMBERS = 1_000_000


class ProfileTracker:
    """
    Keeps the ground ahead, seen by a step sensor, a terrain sensor or both.

    Parameters
    ----------
    robot : Robot
    tuning : DecisionTuning
    frame : str
        In which the polylines must be.

    """

    def __init__(self, robot: Robot, tuning: DecisionTuning, frame: str = 'base_link'):
        """Start with nothing seen."""
        self._steps = StepTracker(robot, tuning)
        self._terrain = TerrainTracker(robot, tuning, frame)
        self._sigmas = tuning.contradiction_sigma
        self.reset()

    def reset(self) -> None:
        """Forget all, for a jump of time or place; the numbers of faces go on counting."""
        self._steps.reset()
        self._terrain.reset()
        self._step_profile: Optional[Profile] = None
        self._terrain_profile: Optional[Profile] = None

    def update(self, observation: Observation, position: float) -> Profile:
        """
        Take in one observation; the same stamp again gives the same answer again.

        Parameters
        ----------
        observation : StepObservation or TerrainObservation
        position : float
            Odometry of the ball's centre when it was made [m].

        Returns
        -------
        Profile
            With the reason of a rejection, if it is one; never raises for what a sensor says.

        """
        if isinstance(observation, TerrainObservation):
            newest = self._terrain_profile = self._terrain.update(observation, position)
            other = self._step_profile
        else:
            newest = self._step_profile = self._steps.update(observation, position)
            other = self._terrain_profile
        if other is None or not abs(newest.stamp - other.stamp) <= SILENT:
            return newest
        ground, steps = (newest, other) if newest is self._terrain_profile else (other, newest)
        return self._merged(ground, steps, max(newest.stamp, other.stamp), position)

    def _merged(self, ground: Profile, steps: Profile, stamp: float, position: float) -> Profile:
        """Return what both sensors show: the ground of one, its faces as both see them."""
        rejected = ground if ground.rejection is not None else steps
        step, faces = steps.face, list(ground.faces)
        if step is not None and step.position > position:
            for index, face in enumerate(faces):
                apart = self._sigmas * math.hypot(face.position_sd, step.position_sd)
                if face.height * step.height > 0.0 \
                        and abs(face.position - step.position) < SAME_PLACE + apart:
                    faces[index] = self._one(face, step)
                    break
            else:
                # Only one of them sees it: it is there until both say that it is not.
                faces.append(replace(step, number=STEP_NUMBERS + step.number))
                faces.sort(key=lambda face: face.position)
        return replace(ground, stamp=stamp, faces=tuple(faces), rejection=rejected.rejection,
                       explanation=rejected.explanation)

    def _one(self, face: Face, step: Face) -> Face:
        """Return a face that both sensors see; the higher one where they contradict."""
        apart = step.height - face.height
        together = math.hypot(face.height_sd, step.height_sd)
        if abs(apart) > self._sigmas * together:
            height = max(face.height, step.height, key=abs)
            return replace(face, height=height,
                           height_sd=max(face.height_sd, step.height_sd, 0.5 * abs(apart)))
        part = face.height_sd**2 / together**2
        # What is constantly wrong with either is not averaged away.
        sd = max(face.height_sd * step.height_sd / together,
                 min(face.height_sd, step.height_sd) / math.sqrt(2.0))
        return replace(face, height=face.height + part * apart, height_sd=sd)
