# SPDX-License-Identifier: Apache-2.0
"""The sensors of an emulated robot on topics: what a real one has beside its motor."""
from typing import Any

from nav_msgs.msg import Odometry
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from sensor_msgs.msg import Imu as ImuMessage

from ballbot_ros.emulator.emulator import Emulator
from ballbot_ros.msg import BallState, StepObservation
from ballbot_ros.physics.scene import Scene
from ballbot_ros.plant import Imu, Sensor
from ballbot_ros.ros import qos
from ballbot_ros.ros.conversions import (
    ball_state_message, observation_message, odometry_message, to_time)
from ballbot_ros.ros.endpoints import advertise
from ballbot_ros.ros.motor import imu_message

IMU_RATE = 250.0  # [Hz]
# IMU readings per message of the others: odom at 83 Hz, observations at 50 Hz, truth at 83 Hz.
ODOM_EVERY, OBSERVATION_EVERY, TRUTH_EVERY = 3, 5, 3
# A cheap micromechanical IMU.
GYRO_SD, FORCE_SD, BIAS = 0.005, 0.1, 0.005
REACH = 3.0  # how far the step sensor sees [m]


class EmulatedRobot(Node):
    """
    Publishes imu, odom, step_observation and ball_state of the ball behind an emulated drive.

    Joint states are not among them: these the bridge tells.

    Parameters
    ----------
    emulator : Emulator
        Running.
    scene : Scene
        That of the emulator.
    **kwargs
        Of the node.

    """

    def __init__(self, emulator: Emulator, scene: Scene, **kwargs: Any):
        """Begin."""
        super().__init__('emulated_robot', **kwargs)
        self._emulator, self._model = emulator, scene.model
        self._imu = Imu(scene.model.robot.gravity, gyro_sd=GYRO_SD, force_sd=FORCE_SD, bias=BIAS)
        self._sensor = Sensor(scene.model.terrain, REACH)
        self._before = emulator.state
        self._number = 0
        self._readings = advertise(self, ImuMessage, 'imu', qos.STATE)
        self._odometry = advertise(self, Odometry, 'odom', qos.STATE)
        self._observation = advertise(self, StepObservation, 'step_observation', qos.STATE)
        self._truth = advertise(self, BallState, 'ball_state', qos.STATE)
        self.create_timer(
            1.0 / IMU_RATE, self._tell, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _tell(self) -> None:
        before, state = self._before, self._emulator.state
        if state.time <= before.time:
            return
        now = 1e-9 * self.get_clock().now().nanoseconds
        self._before, self._number = state, self._number + 1
        sample = self._imu.sample(before, state, self._number)
        self._readings.publish(imu_message(now, *sample[1:]))
        here = state._replace(time=now)  # the time of the wall, as a real robot has it
        if self._number % TRUTH_EVERY == 0:
            self._truth.publish(ball_state_message(
                here, self._emulator.pendulum_torque, self._model))
        if self._number % ODOM_EVERY == 0:
            self._odometry.publish(odometry_message(here))
        if self._number % OBSERVATION_EVERY == 0:
            sight = self._sensor.look(state.x, self._number // OBSERVATION_EVERY)
            self._observation.publish(observation_message(to_time(now), sight, self._sensor))
