# SPDX-License-Identifier: Apache-2.0
"""The ball behind an emulated drive: full model, gear, encoder, and an inertial sensor."""
from dataclasses import dataclass
import math
import random
from typing import NamedTuple

from ballbot_ros.emulator.device import DriveSettings, Sensed
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.fields import Checked, count, quantity
from ballbot_ros.physics.model import State
from ballbot_ros.physics.robot import Motor, Robot
from ballbot_ros.physics.scene import Scene
from ballbot_ros.plant import Plant


class Imu(NamedTuple):
    """
    What an inertial sensor in the middle of the shell reads.

    Its axes are those of the world at ball angle 0 (x along the floor, y up) and turn with the
    shell.  The specific force is acceleration less gravity, the mean over the last period: at
    rest it is 9.81 m/s2 upwards.
    """

    time: float  # simulated [s]
    angular_rate: float  # of the shell, counter-clockwise [rad/s]
    force_x: float  # specific force [m/s2]
    force_y: float


@dataclass(frozen=True)
class ImuNoise(Checked):
    """Errors of the inertial sensor."""

    rate_sd: float = quantity('rad/s', 'noise of the angular rate', default=0.0, minimum=0.0)
    rate_bias: float = quantity('rad/s', 'constant error of the angular rate', default=0.0)
    force_sd: float = quantity('m/s2', 'noise of the specific force', default=0.0, minimum=0.0)
    seed: int = count('of the noise', default=0)


def motor_of(robot: Robot) -> Motor:
    """
    Return the motor of a robot.

    Raises
    ------
    ConfigurationError
        If it has none: then there is nothing to emulate.

    """
    if robot.motor is None or not robot.has_pendulum:
        raise ConfigurationError(
            f'robot {robot.name!r} has no pendulum motor; take one that has, such as gimball')
    return robot.motor


def settings_for(robot: Robot, **changes: float) -> DriveSettings:
    """
    Return a drive set up for the motor of a robot.

    Its torque limit is the largest torque of the robot, brought to the motor shaft.

    Parameters
    ----------
    robot : Robot
    **changes
        Other values of `DriveSettings`.

    """
    motor = motor_of(robot)
    limit = motor.maximum_torque / (motor.gear_ratio * motor.gear_efficiency)
    values = {'torque_constant': motor.torque_constant, 'speed_constant': motor.speed_constant,
              'resistance': motor.resistance, 'torque_limit': limit,
              'current_limit': limit / motor.torque_constant}
    return DriveSettings(**{**values, **changes})  # type: ignore[arg-type]


class Ball:
    """
    A scene that takes the torque of a motor shaft.

    Parameters
    ----------
    scene : Scene
    settings : DriveSettings
        For the resolution of the encoder.
    period : float
        Over which the torque is constant [s]; a whole number of solver steps.
    noise : ImuNoise

    """

    def __init__(self, scene: Scene, settings: DriveSettings, period: float = 1e-3,
                 noise: ImuNoise = ImuNoise()):
        """Start at the start of the scene."""
        self.motor = motor_of(scene.model.robot)
        self.plant = Plant(scene, 1.0 / period, torque_limit=math.inf)
        self._gravity = scene.model.robot.gravity
        self._count = math.tau / settings.counts_per_turn
        self._noise = noise
        self._random = random.Random(noise.seed)
        self._velocity_before = (self.state.velocity_x, self.state.velocity_y)

    @property
    def state(self) -> State:
        """Return the true state."""
        return self.plant.state

    def pendulum_torque(self, shaft_torque: float) -> float:
        """Return the torque at the pendulum joint [N m] for one at the motor shaft."""
        return shaft_torque * self.motor.gear_ratio * self.motor.gear_efficiency

    def advance(self, shaft_torque: float) -> State:
        """
        Advance by a period and return the new state.

        Raises
        ------
        SimulationError
            If the model cannot go on.

        """
        before = self.state
        self._velocity_before = (before.velocity_x, before.velocity_y)
        return self.plant.advance(self.pendulum_torque(shaft_torque))

    def reset(self) -> None:
        """Put the ball back to the start of the scene."""
        self.plant.reset()
        self._velocity_before = (self.state.velocity_x, self.state.velocity_y)

    def sensed(self, before: Sensed, jump: float = 0.0) -> Sensed:
        """
        Return what the drive measures now.

        Parameters
        ----------
        before : Sensed
            Voltage and temperatures are taken over from it.
        jump : float
            Error of the encoder [rad].

        """
        ratio = self.motor.gear_ratio
        angle = ratio * self.state.joint_angle + jump
        return before._replace(position=math.floor(angle / self._count) * self._count,
                               velocity=ratio * self.state.joint_rate)

    def imu(self) -> Imu:
        """Return a reading of the inertial sensor; each call draws new noise."""
        state, noise, draw = self.state, self._noise, self._random.gauss
        before_x, before_y = self._velocity_before
        force_x = (state.velocity_x - before_x) / self.plant.period
        force_y = (state.velocity_y - before_y) / self.plant.period + self._gravity
        sine, cosine = math.sin(state.ball_angle), math.cos(state.ball_angle)
        return Imu(
            state.time, state.ball_rate + noise.rate_bias + draw(0.0, noise.rate_sd),
            cosine * force_x + sine * force_y + draw(0.0, noise.force_sd),
            cosine * force_y - sine * force_x + draw(0.0, noise.force_sd))
