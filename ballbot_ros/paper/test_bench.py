# SPDX-License-Identifier: Apache-2.0
"""
One roll on the virtual test bench: section 6 of the paper as two benches.

`Ramp` is the free-rolling test: the ball is released on a slope, rolls over a bend onto a level
floor and into a step.  `RunUp` is the driven test: from rest, a constant voltage on the motor
for 1.20 m.  In front of the step, two touch sensors, 100 mm apart and read at 1 kHz, measure the
speed as in the experiments: quantised by the readings, and at a distance before the touch.
"""
from dataclasses import dataclass
import math
from typing import ClassVar, NamedTuple, Optional

import numpy as np

from ballbot_ros.config.fields import Checked, quantity
from ballbot_ros.crossing.attempt import RETREAT
from ballbot_ros.crossing.rules import is_over, touch_distance
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics.model.actuation import Actuation
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.state import State
from ballbot_ros.physics.model.terrain import Array, Terrain
from ballbot_ros.physics.simulation.model import Model
from ballbot_ros.physics.simulation.run import run_once
from ballbot_ros.physics.simulation.solver import Solver

SOLVER_STEP = 2e-4  # of the integration [s]
OUTPUT_STEP = 1e-3  # between samples [s]
CHECK_PERIOD = 0.25  # simulated time between checks whether the roll has ended [s]
ROLL_TIME_MAX = 12.0  # a ball that is neither over nor back by then counts as at rest [s]
BEND_ARC = math.radians(0.5)  # of one segment of the bend


class Roll(NamedTuple):
    """
    One roll: measured and true values.

    The experiment yields the first four; `measured_speed` is NaN if a sensor was not reached.
    """

    step_height: float  # [m]
    setting: float  # release height [m] or voltage [V]
    measured_speed: float  # [m/s]
    passed: bool
    touch_speed: float  # of the centre at the first touch of the step [m/s]; NaN if none
    touch_angle: float  # absolute pendulum angle then [rad]


@dataclass(frozen=True)
class Bench(Checked):
    """Parameters of both benches: sensors, and scatter of the start of a roll."""

    sensor_gap: float = quantity('m', 'distance between the sensors', default=0.1, above=0.0)
    sensor_rate: float = quantity('Hz', 'sampling rate of the sensors', default=1000.0, above=0.0)
    sensor_distance: float = quantity(
        'm', 'distance from the second sensor to the face of the step', default=0.2, above=0.0)
    pendulum_sd: float = quantity(
        'rad', 'standard deviation of the pendulum angle at the start', default=0.25,
        minimum=0.0)
    run_up: float = quantity('m', 'level floor before the step', default=0.6, above=0.3)
    highest: float = quantity('1', 'highest setting', default=1.0, above=0.0)

    # Name and unit of the setting, its minimum, and factors between the settings of two rolls.
    setting_name: ClassVar[str]
    unit: ClassVar[str]
    lowest: ClassVar[float]
    coarse: ClassVar[float]
    fine: ClassVar[float]

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.sensor_distance + self.sensor_gap > self.run_up:
            raise ConfigurationError(
                f'sensor_distance must be at most {self.run_up - self.sensor_gap:.3g} m, where '
                f'the first sensor is at the start of the floor, got {self.sensor_distance:g} m',
                'inconsistent', 'sensor_distance')

    def terrain(self, height: float) -> Terrain:
        """Return the ground with a step; its face is at x = 0."""
        raise NotImplementedError

    def begin(self, model: Model, setting: float, chance: np.random.Generator
              ) -> tuple[State, Actuation]:
        """Return start state and actuation of a roll, with random scatter."""
        raise NotImplementedError

    def pendulum_angle(self, robot: Robot, chance: np.random.Generator) -> float:
        """Return a random pendulum angle at the start [rad]."""
        angle = chance.normal(0.0, self.pendulum_sd)
        return float(angle) if robot.has_pendulum else 0.0

    def roll(self, robot: Robot, height: float, setting: float,
             chance: np.random.Generator) -> Roll:
        """
        Simulate one roll into a step of a height [m].

        The setting is a release height [m] or a voltage [V]; `chance` generates the scatter, and
        the same seed gives the same rolls.  Raises `ConfigurationError` if the second sensor is
        behind the touch position.
        """
        touch = touch_distance(robot.ball_radius, height, robot.static_penetration)
        if self.sensor_distance < touch:
            raise ConfigurationError(
                f'sensor_distance must be at least {touch:.3g} m, where the ball touches a step '
                f'of {height:g} m, got {self.sensor_distance:g} m',
                'inconsistent', 'sensor_distance')
        model = Model(robot, self.terrain(height), solver=Solver(step=SOLVER_STEP))
        start, actuation = self.begin(model, setting, chance)
        phase = chance.random()
        rows, passed = run_to_the_end(model, start, actuation, touch, height)
        time, x = rows[:, 0], rows[:, State._fields.index('x')]
        gate = self.sensor_distance + self.sensor_gap
        first, second = (first_passage(time, x, -before)
                         for before in (gate, self.sensor_distance))
        measured = math.nan
        if first is not None and second is not None:
            # A sensor detects the ball at the first tick after its arrival.
            ticks = (math.ceil(second * self.sensor_rate - phase)
                     - math.ceil(first * self.sensor_rate - phase))
            measured = self.sensor_gap * self.sensor_rate / max(ticks, 1)
        at_touch = np.flatnonzero(x >= -touch)
        if not len(at_touch):
            return Roll(height, setting, measured, passed, math.nan, math.nan)
        # The last sample before the touch: a millisecond later the ball is already slower.
        state = State(*rows[max(at_touch[0] - 1, 0), :-1].tolist())
        return Roll(height, setting, measured, passed,
                    math.hypot(state.velocity_x, state.velocity_y), state.pendulum_angle)


@dataclass(frozen=True)
class Ramp(Bench):
    """
    The free-rolling test: the motor is detached, the setting is the release height.

    The release height is that of the ground below the ball centre, above the floor before the
    step.
    """

    slope: float = quantity('rad', 'angle of the ramp', default=math.radians(8.0), above=0.0,
                            maximum=math.radians(45.0))
    bend: float = quantity('m', 'length of the rounded foot of the ramp', default=0.3, above=0.0)
    release_sd: float = quantity('m', 'standard deviation of the release height', default=1e-3,
                                 minimum=0.0)
    push_sd: float = quantity('m/s', 'standard deviation of the speed at the release',
                              default=0.01, minimum=0.0)
    highest: float = quantity('m', 'top of the ramp', default=0.4, above=0.0)

    setting_name, unit, lowest, coarse, fine = 'release height', 'm', 4e-3, 1.3, 1.05

    def terrain(self, height: float) -> Terrain:
        radius = self.bend / math.sin(self.slope)
        angles = np.linspace(self.slope, 0.0, 1 + math.ceil(self.slope / BEND_ARC))
        foot = np.column_stack([-self.run_up - radius * np.sin(angles),
                                radius * (1.0 - np.cos(angles))])
        top = foot[0] + [-1.0, math.tan(self.slope)]
        return Terrain([top, *foot, [0.0, 0.0], [0.0, height], [1.0, height]])

    def begin(self, model: Model, setting: float, chance: np.random.Generator
              ) -> tuple[State, Actuation]:
        """Return the ball released on the ramp."""
        release = max(setting + chance.normal(0.0, self.release_sd), 1e-3)
        push = max(chance.normal(0.0, self.push_sd), 0.0)
        angle = self.pendulum_angle(model.robot, chance)
        # Backwards, because the ground slopes down towards the step.
        ground = model.terrain.vertices[-4::-1]
        x = np.interp(release, ground[:, 1], ground[:, 0])
        if release > ground[-1, 1]:
            x = ground[-1, 0] - (release - ground[-1, 1]) / math.tan(self.slope)
        return model.at_rest(float(x), push, angle), Actuation()


@dataclass(frozen=True)
class RunUp(Bench):
    """The driven test: a constant voltage from rest; the setting is the voltage."""

    run_up: float = quantity('m', 'travel of the centre until it touches the step', default=1.2,
                             above=0.4, maximum=10.0)
    voltage_sd: float = quantity('1', 'standard deviation of the voltage, relative to it',
                                 default=0.02, minimum=0.0)
    length_sd: float = quantity('m', 'standard deviation of the run-up', default=0.01,
                                minimum=0.0)
    highest: float = quantity(
        'V', 'maximum voltage of the driver; more would swing the pendulum of GimBall over the '
        'top at the start and make the ball slower', default=8.0, above=0.0)

    setting_name, unit, lowest, coarse, fine = 'voltage', 'V', 1.0, 1.15, 1.03

    def terrain(self, height: float) -> Terrain:
        return Terrain.step(height)

    def begin(self, model: Model, setting: float, chance: np.random.Generator
              ) -> tuple[State, Actuation]:
        """Return the ball at rest, with a voltage on its motor."""
        voltage = setting * (1.0 + chance.normal(0.0, self.voltage_sd))
        length = max(self.run_up + chance.normal(0.0, self.length_sd), 0.4)
        height = float(model.terrain.vertices[-1, 1])
        touch = touch_distance(
            model.robot.ball_radius, height, model.robot.static_penetration)
        start = model.at_rest(-touch - length, 0.0, self.pendulum_angle(model.robot, chance))
        return start, Actuation(law='voltage', voltage=min(voltage, self.highest))


def run_to_the_end(model: Model, start: State, actuation: Actuation, touch: float,
                   height: float) -> tuple[Array, bool]:
    """
    Simulate until the ball is over the step, rolls back from it, or rests.

    `crossing.rules` defines "over"; the first attempt counts.  Returns the samples, see
    `Trajectory`, and whether the ball passed.
    """
    x, y, velocity = (State._fields.index(name) for name in ('x', 'y', 'velocity_x'))
    pieces: list[Array] = []
    state = start
    while state.time < ROLL_TIME_MAX:
        run = run_once(model, state, actuation, CHECK_PERIOD, OUTPUT_STEP)
        rows = run.rows
        pieces.append(rows if not pieces else rows[1:])
        over = is_over(rows[:, x], rows[:, y], 0.0, height, model.robot.ball_radius)
        # On the ramp, a ball may first roll uphill: it is back only after it was near the step.
        back = (rows[:, velocity] < 0.0) & (rows[:, x] < -touch - RETREAT) & (
            rows[:, x].max() > -touch - 0.3)
        if over.any():
            return np.vstack(pieces), bool(not back.any() or over.argmax() < back.argmax())
        if back.any():
            return np.vstack(pieces), False
        state = run.state(len(run) - 1)
    return np.vstack(pieces), False


def first_passage(time: Array, x: Array, where: float) -> Optional[float]:
    """Return the interpolated time at which x first passes a point [s]; None if it never does."""
    beyond = np.flatnonzero(x >= where)
    if not len(beyond) or beyond[0] == 0:
        return None
    after = beyond[0]
    share = (where - x[after - 1]) / (x[after] - x[after - 1])
    return float(time[after - 1] + share * (time[after] - time[after - 1]))
