# SPDX-License-Identifier: Apache-2.0
"""Fuse polylines of the ground with odometry into a profile, or say why not."""
from dataclasses import dataclass, field, replace
import math
from typing import List, Optional

import numpy as np

from ballbot_ros.decision.perception.checks import arrays, fault, misplaced
from ballbot_ros.decision.perception.elevation import CELL, ElevationMap, Look, PLACE_SD, resample
from ballbot_ros.decision.perception.ground import Found, ground_of, GroundSeen
from ballbot_ros.decision.perception.trend import Trend
from ballbot_ros.decision.tuning import DecisionTuning
from ballbot_ros.decision.values import Face, Profile, Reason, TerrainObservation
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.terrain import Array

# Faces of two looks no farther apart are the same [m].
SAME_PLACE = 0.06

# No blur is longer [m].
BLURRED = 0.05

# The ground on this many nodes before and behind a face is what a look says of its height.
BESIDE = 6


@dataclass
class _Known:
    """A face, and how it has looked from where."""

    face: Face
    found: Found
    trend: Trend = field(default_factory=Trend)


class TerrainTracker:
    """
    Keeps the ground around the ball.

    Parameters
    ----------
    robot : Robot
    tuning : DecisionTuning
    frame : str
        In which observations must be.

    Attributes
    ----------
    offset : float
        By which the floor below the ball was seen too high in the newest look [m].

    """

    def __init__(self, robot: Robot, tuning: DecisionTuning, frame: str = 'base_link'):
        """Start with nothing seen."""
        self._radius, self._frame, self._tuning = robot.ball_radius, frame, tuning
        self._map = ElevationMap(tuning)
        self._number = 0
        self.reset()

    def reset(self) -> None:
        """Forget all, for a jump of time or place; the numbers of faces go on counting."""
        self._map.clear()
        self._faces: List[_Known] = []
        self._answer: Optional[Profile] = None
        self._newest = -math.inf
        self._strikes = 0
        self.offset = 0.0

    def update(self, observation: TerrainObservation, position: float) -> Profile:
        """
        Take in one observation; the same stamp again gives the same answer again.

        Parameters
        ----------
        observation : TerrainObservation
        position : float
            Odometry of the ball's centre when it was made [m].

        Returns
        -------
        Profile
            With the reason of a rejection, if it is one; never raises for what a sensor says.

        """
        if self._answer is None or observation.stamp != self._answer.stamp:
            self._answer = self._judge(observation, position)
        return self._answer

    def _judge(self, observation: TerrainObservation, position: float) -> Profile:
        """Return what is known after a new observation."""
        wrong = fault(observation, self._frame)
        if not wrong and not abs(position) < 1e6:
            wrong = f'the odometry is at {position:g} m'
        if wrong:
            return self._reject(observation, Reason.BAD_OBSERVATION, wrong)
        x, z, z_sd = arrays(observation)
        inside = (x >= observation.x_min - 1e-9) & (x <= observation.x_max + 1e-9)
        x, z, z_sd = x[inside], z[inside], z_sd[inside]
        look = resample(x, z, z_sd, position) if len(x) > 1 else None
        if look is None:
            return self._reject(observation, Reason.BAD_OBSERVATION,
                                'it shows nothing of the ground around the ball')
        if observation.stamp < self._newest:
            return self._contradicted(
                observation, look, position, f'it is of {observation.stamp:.3f} s, before the '
                f'last one of {self._newest:.3f} s')
        near = np.isfinite(look.z) & (np.abs(look.places - position) <= 2.0 * self._radius)
        if near.any():
            x, z = look.places[near] - position, look.z[near]
            wrong = misplaced(x, z, self._radius, self._map.looks > 0)
            if wrong:
                return self._reject(observation, Reason.BAD_OBSERVATION, wrong)
            self.offset = self._radius - float(np.hypot(x, z).min())
        contradiction, residual = self._map.add(look, position)
        if contradiction:
            slipped = self._map.slip(look)
            if slipped:
                self._move(slipped)
                contradiction, residual = self._map.add(look, position)
        if contradiction:
            return self._contradicted(observation, look, position, contradiction)
        return self._believed(observation.stamp, look, residual, position)

    def _move(self, nodes: int) -> None:
        """Move all that is known, for the odometry has slipped."""
        self._map.first += nodes
        for known in self._faces:
            known.found = known.found._replace(position=known.found.position + nodes * CELL)

    def _contradicted(self, observation: TerrainObservation, look: Look, position: float,
                      why: str) -> Profile:
        """Reject a sane observation, or believe it if it insists."""
        self._strikes += 1
        if self._strikes < self._tuning.forget_after:
            return self._reject(observation, Reason.CONTRADICTORY, why)
        self._map.clear()
        self._faces = []
        _, residual = self._map.add(look, position)
        return self._believed(observation.stamp, look, residual, position)

    def _believed(self, stamp: float, look: Look, residual: Array, position: float) -> Profile:
        """Return the profile after a look that was taken in."""
        self._strikes, self._newest = 0, stamp
        ground = ground_of(self._map, position)
        if not ground.points:
            self._faces = []
            return Profile(stamp, seen_from=position, seen_to=position)
        self._name(ground, look, residual, position)
        return self._profile(stamp, ground, position)

    def _profile(self, stamp: float, ground: GroundSeen, position: float) -> Profile:
        """Return what the decision is told of a ground."""
        return Profile(
            stamp, tuple(known.face for known in self._faces
                         if known.face.position + known.face.run > position),
            tuple(ground.points), ground.seen_from, ground.seen_to, ground.slope,
            ground.slope_sd, points_sd=tuple(ground.sds), gaps=tuple(ground.gaps),
            bias_sd=self._bias)

    @property
    def _bias(self) -> float:
        """Return the standard deviation that no number of looks brings down [m]."""
        return (self._tuning.height_bias_sd if self._map.told
                else max(self._tuning.height_bias_sd, self._tuning.untold_bias_sd))

    def _reject(self, observation: TerrainObservation, reason: Reason, why: str) -> Profile:
        """Return a profile that reports a rejection and keeps what is known."""
        if self._answer is None:
            return Profile(observation.stamp, seen_to=-math.inf, rejection=reason,
                           explanation=why)
        return replace(self._answer, stamp=observation.stamp, rejection=reason, explanation=why)

    def _name(self, ground: GroundSeen, look: Look, residual: Array, position: float) -> None:
        """Give numbers to the faces that were found; those that are known keep theirs."""
        known, self._faces = self._faces, []
        for found in ground.faces:
            same = [item for item in known if item.found.height * found.height > 0.0
                    and abs(item.found.position - found.position) < SAME_PLACE]
            if same:
                nearest = min(same, key=lambda item: abs(item.found.position - found.position))
                known.remove(nearest)
                nearest.found = found
            else:
                self._number += 1
                nearest = _Known(Face(self._number, 0.0, 0.0, 0.0, 0.0), found)
            self._note(nearest, look, residual, position)
            nearest.face = self._described(nearest, position)
            self._faces.append(nearest)

    def _note(self, known: _Known, look: Look, residual: Array, position: float) -> None:
        """Note what this look alone says of the height of a face."""
        distance = known.found.position - position
        if distance <= 0.0:
            return
        lift = []
        for begin, end in (known.found.before[1] - BESIDE, known.found.before[1]), (
                known.found.after[0], known.found.after[0] + BESIDE):
            shift = self._map.first - look.first
            beside = residual[max(0, begin + shift):max(0, end + shift)]
            beside = beside[np.isfinite(beside)]
            if len(beside) < 2:
                return
            lift.append(float(beside.mean()))
        known.trend.add(distance, known.found.height + lift[1] - lift[0])

    def _described(self, known: _Known, position: float) -> Face:
        """Return a face with all that is uncertain about it."""
        found, trend = known.found, known.trend
        scatter = trend.scatter / math.sqrt(trend.count) if trend.count else math.nan
        height_sd = max(found.height_sd, self._bias, scatter if scatter > 0.0 else 0.0)
        # A face that seems to have a run may be a vertical one, blurred by points that are lost.
        position_sd = math.hypot(PLACE_SD, 0.3 * min(found.run, BLURRED))
        return Face(known.face.number, found.position, found.height, position_sd,
                    math.hypot(height_sd, trend.growth), found.run)
