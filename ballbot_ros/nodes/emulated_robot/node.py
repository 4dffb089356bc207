# SPDX-License-Identifier: Apache-2.0
"""The node ``emulated_robot``: a drive on a serial device, the simulated ball and its sensors."""
from dataclasses import dataclass
from pathlib import Path
from typing import Any, List, Optional

from rclpy.node import Node

from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.config.fields import fixed, live, quantity, text
from ballbot_ros.emulator.ball import settings_for
from ballbot_ros.emulator.emulator import Emulator
from ballbot_ros.emulator.imu_line import ImuLine
from ballbot_ros.nodes.bridge.motor import imu_message
from ballbot_ros.physics import load_scene
from ballbot_ros.plant import Imu, Sensor, TerrainSensor
from ballbot_ros.ros.conversions import (
    ball_state_message, observation_message, terrain_message, to_time)
from ballbot_ros.ros.endpoints import change_period, create_publisher, create_wall_timer
from ballbot_ros.ros.frames import frame, frame_prefix, Frames
from ballbot_ros.ros.parameters import Commit, declare
from ballbot_ros.ros.run import run
from ballbot_ros.ros.settings import file_in, rate_of, Settings

# IMU readings per message of each other topic.
OBSERVATION_EVERY, TRUTH_EVERY = 5, 3
REACH = 3.0  # range of the step and terrain sensors [m]


@dataclass(frozen=True)
class EmulatedRobotSettings(Settings):
    """Parameters of the node ``emulated_robot``."""

    hardware: str = fixed('the emulated drive is created with it', file_in(
        'hardware', 'gimball_odrive', 'hardware file',
        ', with protocol and baud rate of the drive'))
    firmware: str = fixed('the emulated drive is created with it', text(
        'firmware generation of the drive, `0.5` or `0.6` for an ODrive; empty for the only or '
        'oldest one', default=''))
    scene: str = fixed('the simulation is built from it', file_in('scenes', 'doorstep'))
    link: str = fixed('the device is created at the start', text(
        'symbolic link to the serial device', default='/tmp/ballbot_motor'))
    imu_link: str = fixed('the device is created at the start', text(
        'symbolic link to the serial device of an emulated WitMotion sensor, in place of the '
        'topic imu; empty for the topic', default=''))
    imu_rate: float = live(rate_of('imu', 250.0, minimum=10.0, maximum=1000.0))
    gyro_sd: float = live(quantity(
        'rad/s', 'noise of the gyro per reading', default=0.005, minimum=0.0, maximum=10.0))
    gyro_bias: float = live(quantity(
        'rad/s', 'constant error of the gyro', default=0.005, minimum=-1.0, maximum=1.0))
    force_sd: float = live(quantity(
        'm/s2', 'noise of the accelerometer per reading', default=0.1, minimum=0.0, maximum=10.0))
    frame_prefix: str = frame_prefix()
    odom_frame: str = frame('odom')
    base_frame: str = frame('base')
    imu_frame: str = frame('imu')


class EmulatedRobot(Node):
    """
    Emulates a robot without its bridge; `EmulatedRobotSettings` has its parameters.

    It publishes imu, step_observation, terrain_observation and the true ball_state, stamped with
    wall time as on a real robot.  The bridge publishes joint states and odometry.  The IMU can be
    on a serial device instead, for the node ``imu``.
    """

    def __init__(self, **kwargs: Any):
        super().__init__('emulated_robot', **kwargs)
        settings = declare(self, EmulatedRobotSettings, self._prepare)
        self._frames = Frames.of(settings)
        hardware = load_hardware(settings.hardware)
        connection = hardware.connection
        scene = load_scene(settings.scene)
        self._model = scene.model
        self._imu = self._new_imu(settings)
        self._sensor = Sensor(scene.model.terrain, REACH)
        self._camera = TerrainSensor(scene.model.terrain, REACH)
        self._imu_line = ImuLine(Path(settings.imu_link)) if settings.imu_link else None
        # Even a silent publisher counts as a second one beside a node imu on the link.
        self._readings = create_publisher(self, 'imu') if self._imu_line is None else None
        self._observation = create_publisher(self, 'step_observation')
        self._terrain = create_publisher(self, 'terrain_observation')
        self._truth = create_publisher(self, 'ball_state')
        self._emulator = Emulator(
            connection.protocol, scene, connection.baud,
            settings_for(scene.model.robot, firmware=settings.firmware), Path(settings.link),
            steering=hardware.steering is not None)
        self._before = self._emulator.state
        self._number = 0
        self._emulator.start()
        self._timer = create_wall_timer(self, 1.0 / settings.imu_rate, self._publish)
        self.get_logger().info(
            f'{connection.protocol} at {connection.baud} baud on {self._emulator.path}')

    def _new_imu(self, settings: EmulatedRobotSettings) -> Imu:
        return Imu(self._model.robot.gravity, gyro_sd=settings.gyro_sd,
                   force_sd=settings.force_sd, bias=settings.gyro_bias)

    def _prepare(self, wanted: EmulatedRobotSettings) -> Commit:
        def commit() -> None:
            self._imu = self._new_imu(wanted)
            change_period(self._timer, 1.0 / wanted.imu_rate)
        return commit

    @property
    def failure(self) -> Optional[Exception]:
        """Return the error that ended the drive or the sensor, and ends the node; see `run`."""
        line = self._imu_line
        return self._emulator.failure or (None if line is None else line.failure)

    def _publish(self) -> None:
        before, state = self._before, self._emulator.state
        if state.time <= before.time:
            return
        now = 1e-9 * self.get_clock().now().nanoseconds
        self._before, self._number = state, self._number + 1
        sample = self._imu.sample(before, state, self._number)
        if self._imu_line is not None:
            self._imu_line.measure(*sample[1:])
        elif self._readings is not None:
            self._readings.publish(imu_message(
                now, (0.0, -sample.turn_rate, 0.0), (sample.forward, 0.0, sample.upward),
                self._frames.imu))
        if self._number % TRUTH_EVERY == 0:
            course = self._emulator.ball.course
            self._truth.publish(ball_state_message(
                state._replace(time=now), self._emulator.pendulum_torque, self._model,
                self._frames, course.lateral, course.pose))
        if self._number % OBSERVATION_EVERY == 0:
            sight = self._sensor.measure(state.x, self._number // OBSERVATION_EVERY)
            if sight is not None:
                self._observation.publish(observation_message(
                    to_time(now), sight, self._sensor, self._frames))
            ground = self._camera.measure(state.x, state.y, self._number // OBSERVATION_EVERY)
            if ground is not None:
                self._terrain.publish(terrain_message(to_time(now), ground, self._frames))

    def make_safe(self) -> None:
        self._emulator.stop()
        if self._imu_line is not None:
            self._imu_line.stop()
        if self._emulator.dropped:
            self.get_logger().warning(
                f'{self._emulator.dropped} ms were skipped because the machine was too slow')


def main(args: Optional[List[str]] = None) -> int:
    return run(EmulatedRobot, args)
