# SPDX-License-Identifier: Apache-2.0
"""
Motion of the ball after a command timeout, for each `on_timeout`, on a slope or a level floor.

The full model of the robot runs under the torques of the real `Supervisor`, which receives the
true angles.  The ball rests, or rolls at a constant speed, under the velocity controller (12) with
the `gentle` gains, which are stable at the rate of every hardware file; then the commands stop.
Positive slopes rise towards +x.
"""
from dataclasses import replace
import math
from typing import Iterable, Iterator, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from ballbot_ros.bridge.hardware_file import Hardware, ON_TIMEOUT
from ballbot_ros.bridge.supervisor import PendulumMotion, Supervisor
from ballbot_ros.control.tuning import load_tuning
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics import load_robot, Model, Terrain
from ballbot_ros.physics.model.actuation import Actuation, velocity_torque
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.state import State
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.simulation.scene import Initial, Run, Scene
from ballbot_ros.plant import Plant

COMMANDED_TIME = 1.0  # duration of the commands [s]
OBSERVED_TIME = 10.0  # simulated after the last command [s]
ACCURACY = 1e-4  # of positions [m]
HANGING_ANGLE = math.radians(5.0)  # largest angle at which a pendulum counts as hanging [rad]


class Scenario(NamedTuple):
    """Initial motion of a ball, and the policy after its commands stop."""

    policy: str  # one of ON_TIMEOUT
    slope: float  # of the ground [rad]
    speed: float  # along it [m/s]


class Response(NamedTuple):
    """
    Response in a scenario, from the last command on.

    Every array has a value for each period of the loop.
    """

    scenario: Scenario
    time: Array  # [s]
    distance: Array  # along the ground [m]
    speed: Array  # of the centre, along the ground [m/s]
    pendulum_angle: Array  # absolute [rad]
    work: Array  # net energy supplied by the motor since the command timeout [J]
    error: float  # estimated position error [m]

    def after(self, seconds: float) -> Tuple[float, float]:
        """Return distance [m] and speed [m/s] at a time after the last command [s]."""
        place = int(np.argmin(np.abs(self.time - seconds)))
        return float(self.distance[place]), float(self.speed[place])

    @property
    def largest_angle(self) -> float:
        """Return the largest pendulum angle, in either direction [rad]."""
        return float(np.abs(self.pendulum_angle).max())

    @property
    def hangs_after(self) -> Optional[float]:
        """Return the time from which the pendulum stays within `HANGING_ANGLE` [s], or None."""
        beyond = np.flatnonzero(np.abs(self.pendulum_angle) > HANGING_ANGLE)
        if not len(beyond):
            return 0.0
        return float(self.time[beyond[-1] + 1]) if beyond[-1] + 1 < len(self.time) else None

    @property
    def energy_given(self) -> float:
        """Return the maximum net energy supplied by the motor since the command timeout [J]."""
        return float(self.work.max())


def held_angle(robot: Robot, slope: float, joint_rate: float) -> float:
    """
    Return the pendulum angle that keeps a rolling ball at its speed [rad].

    About the contact, the weight of the pendulum balances slope and rolling friction:
    M2 g e sin(angle) = M g R sin(slope) + c1 v / R.

    Raises `ConfigurationError` if there is no such angle, naming the steepest slope.
    """
    if robot.largest_gravity_torque == 0.0:
        raise ConfigurationError(
            f'robot {robot.name!r} has no pendulum that could hold it',
            'inconsistent', 'pendulum_mass')
    drag = robot.rolling_friction * joint_rate
    weight = robot.weight * robot.ball_radius
    sine = (weight * math.sin(slope) + drag) / robot.largest_gravity_torque
    if not abs(sine) < 1.0 or abs(slope) > 0.5 * math.pi:
        steepest = math.asin((robot.largest_gravity_torque - abs(drag)) / weight)
        raise ConfigurationError(
            f'slope must be within +-{math.degrees(steepest):.3g} degrees, got '
            f'{math.degrees(slope):g}: no pendulum angle holds {robot.name!r} on a steeper slope',
            'out_of_range', 'slope')
    return math.asin(sine)


def scene_of(hardware: Hardware, scenario: Scenario) -> Scene:
    """Return a scene in equilibrium; raises `ConfigurationError` if the slope is too steep."""
    robot = load_robot(hardware.robot)
    rise = math.tan(scenario.slope)
    model = Model(robot, Terrain([[-1.0, -rise], [1.0, rise]]))
    joint_rate = -model.at_rest(0.0, scenario.speed).ball_rate
    angle = math.degrees(held_angle(robot, scenario.slope, joint_rate))
    return Scene('timeout', model, Initial(speed=scenario.speed, pendulum_angle_deg=angle),
                 Actuation(), Run(duration=COMMANDED_TIME + OBSERVED_TIME))


def lose_commands(hardware: Hardware, scenario: Scenario,
                  lasts: float = OBSERVED_TIME) -> Response:
    """
    Simulate a scenario up to some time after the last command [s].

    Robot and limits are those of the hardware; its ``on_timeout`` is that of the scenario.  Raises
    `ConfigurationError` if the robot cannot be held on that slope, or the policy is unknown.
    """
    scene = scene_of(hardware, scenario)
    limits = replace(hardware.limits, on_timeout=scenario.policy)
    robot = scene.model.robot
    plant = Plant(scene, hardware.connection.loop_rate, limits.torque_limit, ACCURACY)
    supervisor = Supervisor(limits, plant.period)
    supervisor.reset(0.0)
    # Without an integral, law (12) has a steady-state error from the friction of the joint.
    gain = load_tuning('gentle').velocity_kp
    set_rate = scene.start.joint_rate * (1.0 + robot.joint_friction / gain)
    last, end = (round(time / plant.period) for time in (COMMANDED_TIME, COMMANDED_TIME + lasts))
    states, given = [], []
    since = None  # work of the motor at the command timeout
    while True:
        state = plant.state
        if plant.periods >= last:
            if since is None and supervisor.timed_out:
                since = state.motor_work
            states.append(state)
            given.append(0.0 if since is None else state.motor_work - since)
        if plant.periods == end:
            break
        if plant.periods <= last:
            supervisor.offer(velocity_torque(
                state.pendulum_angle, state.joint_rate, 0.0, set_rate, gain, 0.0,
                robot.largest_gravity_torque), plant.time, plant.time)
        plant.advance(supervisor.decide(plant.time, PendulumMotion(
            state.pendulum_angle, state.pendulum_rate, state.joint_rate)))
    return _response(scenario, states, given, plant.error_estimate)


def _response(scenario: Scenario, states: Sequence[State], given: Sequence[float],
              error: float) -> Response:
    """Return a response from its states, with positions and speeds along the ground."""
    columns = dict(zip(State._fields, np.array(states).T))
    cosine, sine = math.cos(scenario.slope), math.sin(scenario.slope)
    x, y = (columns[name] - columns[name][0] for name in 'xy')
    return Response(scenario, columns['time'] - columns['time'][0], cosine * x + sine * y,
                    cosine * columns['velocity_x'] + sine * columns['velocity_y'],
                    columns['pendulum_angle'], np.array(given), error)


def scenarios(speed: float, slopes: Iterable[float],
              policies: Sequence[str] = ON_TIMEOUT) -> Iterator[Scenario]:
    """
    Yield the scenarios of the study, for a speed [m/s] and slopes of 0 or more [rad].

    The ball rests on each downhill slope, then rolls down each slope, then up each slope.
    """
    steps = list(slopes)
    starts = [(0.0, -slope) for slope in steps]
    if speed:
        starts += [(speed, -slope) for slope in steps] + [
            (speed, slope) for slope in steps if slope > 0.0]
    for initial_speed, slope in starts:
        for policy in policies:
            yield Scenario(policy, slope, initial_speed)
