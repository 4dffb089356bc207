# SPDX-License-Identifier: Apache-2.0
"""Measure the error of the estimated pendulum angle, with and without an IMU."""
from dataclasses import replace
import math

import numpy as np

from ballbot_ros.control import ControlTuning, Mode, PendulumController, SetPoint
from ballbot_ros.estimation import EncoderReading, Fusion, ImuMounting, ImuReading
from ballbot_ros.physics import load_robot
from ballbot_ros.physics.simulation.scene import read_scene
from ballbot_ros.plant import Imu, Plant

RATE = 500.0  # of the encoder and the IMU [Hz]
COUNTS = 50 * 4096  # of the encoder, on the motor shaft, per revolution of the joint
# A low-cost MEMS IMU, not at the centre of the ball.
PLACE, GYRO_SD, FORCE_SD, BIAS = (0.03, -0.02), 0.005, 0.1, 0.01
# Factors of the parameter errors of the filter, as for identified robots.
WRONG = {'pendulum_mass': 1.05, 'joint_friction': 1.3, 'ball_inertia': 0.95}
TORQUE_ERROR = 1.05

FLAT = [{'flat': {'length': 30.0}}]
CASES = (
    # Name, terrain, changes of the robot, start, set angle over time, duration.
    ('rolling', FLAT, {}, {'x': 0.5}, lambda t: 0.6 * math.sin(1.5 * t), 8.0),
    ('slope of 3 degrees', [{'flat': {'length': 1.0}},
                            {'slope': {'length': 30.0, 'angle_deg': 3.0}}],
     {}, {'x': 0.5}, lambda t: 0.9, 6.0),
    ('crossing 31 mm', [{'flat': {'length': 2.0}}, {'step': {'height': 0.031}},
                        {'flat': {'length': 20.0}}],
     {}, {'x': 0.5}, lambda t: 1.2 if t < 2.8 else 0.0, 5.0),
    ('slip, friction 0.02', FLAT, {'surface_friction': 0.02}, {'x': 0.5},
     lambda t: 1.2 * math.sin(2.0 * t), 5.0),
    ('flight, 0.3 m down', [{'flat': {'length': 2.0}}, {'step': {'height': -0.3}},
                            {'flat': {'length': 30.0}}],
     {}, {'x': 0.5}, lambda t: 0.8 if t < 2.5 else 0.3, 5.0),
)


def errors(case, imu, closed=False):
    """
    Return the error of the pendulum angle [rad] and of its rate [rad/s] over time.

    With `closed`, controller (11) uses the estimate, else the true state.
    """
    _, terrain, changes, start, wanted, duration = case
    robot = replace(load_robot('gimball'), **changes)
    scene = read_scene({'robot': 'gimball', 'robot_changes': changes, 'terrain': terrain,
                        'initial': start, 'duration': duration}, case[0], case[0])
    plant = Plant(scene, RATE)
    assumed = replace(robot, **{name: getattr(robot, name) * factor
                                 for name, factor in WRONG.items()})
    fusion = Fusion(assumed, ImuMounting(*PLACE))
    sensor = Imu(robot.gravity, PLACE, GYRO_SD, FORCE_SD, BIAS, seed=1)
    law = PendulumController(robot, ControlTuning(position_kp=6.0, position_kd=0.8))
    torque, wrong = 0.0, []
    for number in range(int(duration * RATE)):
        before = plant.state
        state = plant.advance(torque)
        if imu:
            fusion.imu(ImuReading(*sensor.sample(before, state, number)))
        counted = round(state.joint_angle / (2.0 * math.pi) * COUNTS)
        estimate = fusion.encoder(EncoderReading(
            state.time, counted / COUNTS * 2.0 * math.pi, torque / TORQUE_ERROR))
        readings = estimate.readings
        wrong.append((readings.pendulum_angle - state.pendulum_angle,
                      readings.pendulum_rate - state.pendulum_rate))
        truth = replace(readings, ball_angle=state.ball_angle, ball_rate=state.ball_rate,
                        joint_angle=state.joint_angle, joint_rate=state.joint_rate)
        law.give(SetPoint(Mode.HOLD, wanted(state.time), state.time))
        torque = law.torque(readings if closed else truth)
    return np.array(wrong).T


def measure():
    for case in CASES:
        for imu in (True, False):
            for closed in (False, True):
                angle, _ = errors(case, imu, closed)
                label = f'{case[0]}, {"with" if imu else "no"} IMU' \
                       f'{", closed loop" if closed else ""}'
                yield f'{label}: rms', 'deg', [math.degrees(np.sqrt(np.mean(angle**2)))], None
                yield f'{label}: most', 'deg', [math.degrees(np.abs(angle).max())], None
