# SPDX-License-Identifier: Apache-2.0
"""
The simulated robot on a floor: planar physics along its path, plus the lateral model.

The ground along the path is a cut through the floor along the heading, and is cut again when the
ball leaves the line of the cut.
"""
from dataclasses import replace
import math
from typing import Optional, Tuple

import numpy as np

from ballbot_ros.errors import ConfigurationError, SimulationError
from ballbot_ros.floors.floor import distance_to_segment, Floor, Point
from ballbot_ros.floors.levels import level
from ballbot_ros.floors.profile import Cut, cut, passed
from ballbot_ros.physics.mechanics.contact import EDGE
from ballbot_ros.physics.model.actuation import Actuation
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.state import State
from ballbot_ros.physics.model.terrain import Terrain
from ballbot_ros.physics.simulation.model import Model
from ballbot_ros.physics.simulation.scene import Initial, Run, Scene
from ballbot_ros.physics.simulation.solver import Solver
from ballbot_ros.plant.plant import Plant
from ballbot_ros.steering import height_factor, LateralState, step
from ballbot_ros.steering.model import moved_to

# Deviation from the line of a cut [rad], [m] that is accepted if an edge or a wall is within
# MARGIN of the ball [m], and elsewhere.
ON_LINE, NEAR_LINE, MARGIN = 1e-6, 0.01, 0.1
# Work of a cut that is due to rounding alone [J].
WORK_ROUNDING = 1e-9
Line = Tuple[float, float, float, float]  # x, y, heading, and the path length there
# Largest angle to an edge for which its lateral push was measured, see `steering.oblique` [rad].
EDGE_ANGLE_MAX = math.radians(45.0)


class FloorPlant(Plant):
    """
    A robot on a floor, with a torque and a lean set-point per control period.

    A robot without steering drives straight.  A straight drive is bit-identical to that of a
    `Plant` on the same profile.

    `pose` is x, y and heading of the start [m], [rad]; see `Plant` for the other parameters.
    Raises `ConfigurationError` if the pose is not finite or not on the map, and as `Plant` does.
    """

    def __init__(self, robot: Robot, floor: Floor,
                 pose: Tuple[float, float, float] = (0.0, 0.0, 0.0), control_rate: float = 500.0,
                 torque_limit: Optional[float] = None, solver: Solver = Solver()):
        if not all(map(math.isfinite, pose)) or not floor.contains(pose[:2]):
            left, right, bottom, top = floor.extent
            raise ConfigurationError(
                f'start pose {tuple(pose)} must lie on the map, which is x {left:g} to {right:g} '
                f'm, y {bottom:g} to {top:g} m', 'out_of_range', 'pose')
        self.floor, self._radius = floor, robot.ball_radius
        self._edges = np.array([
            segment for feature in floor.features if feature.kind != 'keep_out'
            for segment in feature.segments]).reshape(-1, 2, 2).transpose(1, 2, 0)
        self._level = 0.0
        self._seen: Optional[Terrain] = None
        self._seen_at: Line = (0.0, 0.0, 0.0, 0.0)
        self._place(pose)
        self.start_pose = self.pose
        scene = Scene(floor.name, Model(robot, self._exact().terrain(), solver=solver),
                      Initial(), Actuation(), Run(duration=1.0))
        super().__init__(scene, control_rate, torque_limit)

    @property
    def pose(self) -> Tuple[float, float, float]:
        """Return x, y and heading [m], [rad]."""
        return (*self._at, self._lateral.heading)

    @property
    def lateral(self) -> LateralState:
        """Return the lateral state; its heading is not wrapped."""
        return self._lateral

    @property
    def relative_pose(self) -> Tuple[float, float, float]:
        """Return x, y and heading in the frame of the start [m], [rad]."""
        x, y, heading = self.start_pose
        away, side = self._at[0] - x, self._at[1] - y
        return (math.cos(heading) * away + math.sin(heading) * side,
                math.cos(heading) * side - math.sin(heading) * away,
                self._lateral.heading - heading)

    @property
    def steers(self) -> bool:
        """Return whether the robot has a lateral axis."""
        robot = self.model.robot
        return robot.steering is not None and robot.has_pendulum

    @property
    def level(self) -> float:
        """Return the ground height due to the steps and drops passed so far [m]."""
        return self._level

    def advance(self, torque: float, lean_set_point: float = 0.0) -> State:
        """
        Advance by one control period and return the new planar state, whose x is the path length.

        See `Plant.advance` and, for the lean set-point [rad], `steering.law`.  Raises
        `SimulationError` if the run fails, and keeps the last valid state and time; raises
        `ConfigurationError` for a lean set-point of a robot without steering.
        """
        before, applied = self.state, self.torque
        after = super().advance(torque, lean_set_point)
        try:
            self._move(before, after, lean_set_point)
        except SimulationError:
            self.state, self.torque, self.periods = before, applied, self.periods - 1
            raise
        return self.state

    def reset(self, time: bool = False) -> State:
        """Return to the start pose, and to time 0 where `time` is true."""
        self._place(self.start_pose)
        return super().reset(time)

    def put(self, state: State, pose: Optional[Tuple[float, float, float]] = None) -> State:
        """Set the planar state and, if given, the pose; setting the pose resets the lean."""
        super().put(state)
        if pose is not None:
            self._place(pose)
        self._seen = None
        self._take(cut(self.floor, self._at, self._lateral.heading, self._level, self._radius))
        self._cut_again(False)  # keeps the exact cut where the ball touches a crest
        return self.state

    def profile(self) -> Terrain:
        """
        Return the exact ground along the heading, whose x is the path length.

        At walls, it is the ground along the path of the centre.
        """
        if self._seen is None or not self._on(self._seen_at, ON_LINE):
            self._seen_at = self._course()
            self._seen = self._exact().terrain(self.state.x)
        return self._seen

    def _exact(self) -> Cut:
        return cut(self.floor, self._at, self._lateral.heading, self._level)

    def _course(self) -> Line:
        return (*self._at, self._lateral.heading, self.state.x)

    def _on(self, line: Line, tolerance: float) -> bool:
        """Return whether position and heading are on a line, within a tolerance [m], [rad]."""
        x, y, heading, _ = line
        away, turned = (self._at[0] - x, self._at[1] - y), self._lateral.heading - heading
        across = away[1] * math.cos(heading) - away[0] * math.sin(heading)
        return max(abs(turned), abs(across)) < tolerance

    def _place(self, pose: Tuple[float, float, float]) -> None:
        self._at = (float(pose[0]), float(pose[1]))
        self._lateral = LateralState(heading=float(pose[2]))
        self._level = level(self.floor, self._at)

    def _take(self, ground: Cut) -> None:
        self._cut, self._cut_at = ground, self._course()
        self.model = replace(self.model, terrain=ground.terrain(self.state.x))

    def _cut_again(self, moves: bool = True) -> bool:
        """
        Cut the ground, and return whether the new cut was accepted.

        If the ball `moves`, the work that a new cut does on the contact springs is taken from its
        kinetic energy; a cut that needs more than the kinetic energy is rejected.
        """
        kept, state = (self._cut, self._cut_at, self.model), self.state
        present = self.model.energies(state)
        available = present.kinetic if moves else 0.0
        self._take(cut(self.floor, self._at, self._lateral.heading, self._level, self._radius,
                       _climbed))
        work = self.model.energies(state).contact - present.contact
        if work > available + WORK_ROUNDING or self.model.terrain.height(state.x) >= state.y:
            self._cut, self._cut_at, self.model = kept
            return False
        if moves and work > 0.0:
            factor = math.sqrt(max(0.0, 1.0 - work / available)) if available else 0.0
            self.state = state._replace(
                ball_rate=factor * state.ball_rate, pendulum_rate=factor * state.pendulum_rate,
                velocity_x=factor * state.velocity_x, velocity_y=factor * state.velocity_y)
        return True

    def _move(self, before: State, after: State, lean_set_point: float) -> None:
        """Advance pose and lateral state by the period in which the planar state changed."""
        robot, lateral = self.model.robot, self._lateral
        speed = 0.5 * (before.velocity_x + after.velocity_x)
        acceleration = (after.velocity_x - before.velocity_x) / self.period
        tilt_rate = lateral.tilt_rate
        # An edge reduces the speed across it, so an oblique edge also pushes sideways.
        angle = self._edge_angle(after)
        if angle and self.steers:
            tilt_rate += (before.velocity_x - after.velocity_x) * math.tan(angle) \
                / robot.ball_radius
            lateral = lateral._replace(tilt_rate=tilt_rate)
        if self.steers and (lean_set_point or lateral._replace(heading=0.0) != LateralState()):
            lateral = step(robot, lateral, speed, lean_set_point, self.period, acceleration)
            if not abs(lateral.tilt) < 0.5 * math.pi:
                raise SimulationError(
                    after.time, f'the axle tilts by {math.degrees(lateral.tilt):.0f} degrees, but '
                    'the lateral model is valid below 90',
                    'drive slower along edges, or cross them at right angles', 'out_of_range',
                    'tilt')
        kept, level = self._lateral.heading, self._level
        start, forward = self._at, after.x - before.x
        straight = moved_to(start, kept, forward)
        there = moved_to(start, 0.5 * (kept + lateral.heading), forward, 0.5 * (
            tilt_rate + lateral.tilt_rate) * robot.ball_radius * self.period)
        # Walls and ground to the side of the ball stop a turn without a rebound.
        if lateral is not self._lateral and (away := self._clearance(there)) < 0.0 \
                and away < self._clearance(straight):
            there, lateral = straight, _stopped(lateral, kept)
        self._level = level + passed(self.floor, start, there)
        self._at, self._lateral = there, lateral
        if self._on(self._cut_at, ON_LINE) or (
                self._on(self._cut_at, NEAR_LINE) and not self._near()):
            return
        if not self._cut_again():
            # The ball stays on its line.
            x, y, heading, path = self._cut_at
            self._at = moved_to((x, y), heading, after.x - path)
            self._lateral = _stopped(lateral, heading)
            self._level = level + passed(self.floor, start, self._at)

    def _near(self) -> bool:
        """Return whether the ground is uneven, or a wall or an edge is within `MARGIN`."""
        return (self.floor.heights is not None or self._clearance(self._at) < MARGIN
                or distance_to_segment(*self._at, *self._edges).min(initial=math.inf)
                < self._radius + MARGIN)

    def _clearance(self, place: Point) -> float:
        """Return the distance of the ball from the nearest wall, negative inside it [m]."""
        return self.floor.nearest_wall(place)[0] - self._radius

    def _edge_angle(self, state: State) -> float:
        """Return the angle between the path and the edge under the ball, 0 without one [rad]."""
        place = state.x - self._cut_at[3]
        edges = [edge for edge in self._cut.edges
                 if edge.angle and abs(edge.distance - place) < self._radius]
        if not edges or not any(touch.kind == EDGE for touch in self.model.touches(state)):
            return 0.0
        angle = min(edges, key=lambda edge: abs(edge.distance - place)).angle
        return min(max(angle, -EDGE_ANGLE_MAX), EDGE_ANGLE_MAX)


def _climbed(angle: float) -> float:
    """Return the fraction of the head-on height that the ball climbs at an edge angle [rad]."""
    # Beyond the table there are no measurements: use the energy of the speed across the edge.
    return height_factor(angle) or math.cos(angle)**2


def _stopped(lateral: LateralState, heading: float) -> LateralState:
    """Return a lateral state without lateral motion, at a heading [rad]."""
    return lateral._replace(tilt_rate=0.0, yaw_rate=0.0, heading=heading)
