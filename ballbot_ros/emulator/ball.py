# SPDX-License-Identifier: Apache-2.0
"""The simulated ball of an emulated drive: full model, gear, encoder and inertial sensor."""
import math
from typing import Any

from ballbot_ros.drives.emulated_device import DriveSettings, Sensed
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics.model.robot import Motor, Robot
from ballbot_ros.physics.model.state import State
from ballbot_ros.physics.simulation.scene import Scene
from ballbot_ros.plant import Imu, ImuSample, Plant
from ballbot_ros.steering import GroundTrack, LateralState, pull


# Period of the emulator [s].
PERIOD = 1e-3


def motor_of(robot: Robot) -> Motor:
    """Return the motor of a robot; `ConfigurationError` if it has none to emulate."""
    if robot.motor is None or not robot.has_pendulum:
        raise ConfigurationError(
            f'robot {robot.name!r} has no pendulum motor; choose one that has, such as gimball',
            'missing', 'robot')
    return robot.motor


def settings_for(robot: Robot, **changes: Any) -> DriveSettings:
    """
    Return the settings of a drive for the motor of a robot, with changes of `DriveSettings`.

    The torque limit is the largest torque of the robot, converted to the motor shaft.
    """
    motor = motor_of(robot)
    limit = motor.maximum_torque / (motor.gear_ratio * motor.gear_efficiency)
    values = {'torque_constant': motor.torque_constant, 'speed_constant': motor.speed_constant,
              'resistance': motor.resistance, 'torque_limit': limit,
              'current_limit': limit / motor.torque_constant}
    return DriveSettings(**{**values, **changes})


class Ball:
    """
    A scene driven by the torque of a motor shaft, which is constant over a period [s].

    The period is an integer number of solver steps; the settings give the encoder resolution.
    `lateral` is the state of a robot whose second motor leans the pendulum, `course` the pose in
    the frame of the start.
    """

    def __init__(self, scene: Scene, settings: DriveSettings, period: float = PERIOD):
        self.motor = motor_of(scene.model.robot)
        self.plant = Plant(scene, 1.0 / period, torque_limit=math.inf)
        self._count = math.tau / settings.counts_per_turn
        self._imu = Imu(scene.model.robot.gravity)  # an ideal one at the centre of the shell
        self._begin()

    def _begin(self) -> None:
        """Initialize as if the state had been constant for a period."""
        # Both in one assignment: another thread may request a reading at any time.
        self._pair = (self.state._replace(time=self.state.time - self.plant.period), self.state)
        self.lateral = LateralState()
        self.course = GroundTrack(x=self.state.x, path=self.state.x)

    @property
    def state(self) -> State:
        return self.plant.state

    def pendulum_torque(self, shaft_torque: float) -> float:
        """
        Return the torque at the pendulum joint [N m] for one at the motor shaft.

        The plant limits the torque by the supply voltage of the robot file at the joint rate: a
        drive that regulates current does not model this limit.
        """
        return shaft_torque * self.motor.gear_ratio * self.motor.gear_efficiency

    def advance(self, shaft_torque: float, lateral_torque: float = 0.0) -> State:
        """
        Advance by a period and return the new planar state.

        The torques are those of the motor, and of the motor that leans the pendulum, at their
        shafts [N m].  Raises `SimulationError` if the model fails.
        """
        before = self.state
        after = self.plant.advance(self.pendulum_torque(shaft_torque))
        self._pair = (before, after)
        if lateral_torque or self.lateral != LateralState():
            robot, period = self.plant.model.robot, self.plant.period
            speeds = [-robot.ball_radius * state.ball_rate for state in (before, after)]
            self.lateral = pull(
                robot, self.lateral, 0.5 * sum(speeds), self.pendulum_torque(lateral_torque),
                period, (speeds[1] - speeds[0]) / period)
            if abs(self.lateral.tilt) >= 0.5 * math.pi:
                # The model is not valid beyond: a ball whose lean is not driven has rolled over.
                self.lateral = LateralState(heading=self.lateral.heading)
        self.course = self.course.after(
            after.x, self.lateral, self.plant.model.robot.ball_radius)
        return after

    def reset(self) -> None:
        self.plant.reset()
        self._begin()

    def sensed(self, before: Sensed, jump: float = 0.0) -> Sensed:
        """
        Return the present measurements of the drive, with an encoder offset `jump` [rad].

        Voltage and temperatures are those of the measurements `before`.
        """
        return self._at_shaft(before, self.state.joint_angle, self.state.joint_rate, jump)

    def lean_sensed(self, before: Sensed) -> Sensed:
        """Return the present measurements at the second motor; see `sensed`."""
        return self._at_shaft(before, self.lateral.lean, self.lateral.lean_rate)

    def _at_shaft(self, before: Sensed, angle: float, rate: float, jump: float = 0.0) -> Sensed:
        ratio = self.motor.gear_ratio
        return before._replace(
            position=math.floor((ratio * angle + jump) / self._count) * self._count,
            velocity=ratio * rate)

    def imu(self) -> ImuSample:
        """Return the reading of an inertial sensor in the shell over the last period."""
        return self._imu.sample(*self._pair, self.plant.periods)
