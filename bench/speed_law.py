# SPDX-License-Identifier: Apache-2.0
"""
Measure how the speed controller tracks and stops on slopes: tables of docs/speed_law.md.

    .venv/bin/python bench/speed_law.py
"""
import math

import numpy as np

from ballbot_ros.control import (
    JointReadings, load_tuning, lowest_stable_rate, Mode, PendulumController, SetPoint, speed_law)
from ballbot_ros.physics import load_robot
from ballbot_ros.physics.simulation.scene import read_scene
from ballbot_ros.plant import Plant

RATE = 500
ROBOT, TUNING = load_robot('gimball'), load_tuning('published')
LAW = speed_law.SpeedLaw.tuned(ROBOT, TUNING)[:]


def plant(slope):
    """Return GimBall at rest in the middle of a slope [degrees]."""
    return Plant(read_scene({
        'robot': 'gimball', 'duration': 1.0, 'initial': {'x': 20.0},
        'terrain': [{'slope': {'length': 50.0, 'angle_deg': slope}}]}, '', ''), RATE)


def drive(slope, speeds, duration=4.0):
    """Return the speeds of the ball [m/s], one row for each set speed."""
    ball, controller, rows = plant(slope), PendulumController(ROBOT, TUNING), []
    for speed in speeds:
        controller.give(SetPoint(Mode.SPEED, speed, ball.time))
        rows.append([-ROBOT.ball_radius * ball.advance(controller.torque(JointReadings.of(
            ball.state))).ball_rate for _ in range(round(duration * RATE))])
    return np.array(rows)


def stop(slope, speed, lean):
    """Return the distances that the ball rolls from a speed to its stop, and then back [m]."""
    ball, controller = plant(slope), PendulumController(ROBOT, TUNING)
    state = speed_law.speed_law_start(0.0, 0.0, math.radians(slope), LAW)
    way = [0.0]
    for period in range(22 * RATE):
        now, started = -ROBOT.ball_radius * ball.state.ball_rate, period >= 8 * RATE
        state, angle = speed_law.speed_law_step(
            state, now, ball.state.pendulum_angle, 0.0 if started else speed,
            lean if started else 1.4, 1.0 / RATE, LAW)
        controller.give(SetPoint(Mode.HOLD, angle, ball.time))
        ball.advance(controller.torque(JointReadings.of(ball.state)))
        way.append(way[-1] + now / RATE)
    return max(way) - way[8 * RATE], max(way) - way[-1]


def main():
    for lean in (0.7, TUNING.largest_lean, math.pi / 2.0):
        print(f'steepest slope for a lean of {lean:.2f} rad: '
              f'{math.degrees(speed_law.steepest_slope(lean, LAW)):.2f} degrees')
    for law in (Mode.HOLD, Mode.SPEED):
        print(f'lowest rate without delay for {law.law}: '
              f'{lowest_stable_rate(ROBOT, TUNING, law):.0f} Hz')
    print()
    print('| slope | set speed | settled after | overshoot | at the stop: back | creeps |')
    print('|---|---|---|---|---|---|')
    for slope in (-3.0, -1.0, 0.0, 1.0, 3.0):
        for speed in (0.1, 0.3, 0.6):
            _, rows, stopped = drive(slope, (0.0, speed, 0.0))
            off = np.flatnonzero(np.abs(rows - speed) > 0.05 * speed)
            print(f'| {slope:g} deg | {speed:g} m/s | {(off[-1] + 1) / RATE:.2f} s '
                  f'| {max(0.0, 100.0 * (rows.max() / speed - 1.0)):.1f} % '
                  f'| {max(0.0, -1e3 * stopped.min()):.1f} mm/s '
                  f'| {1e3 * abs(stopped[-1]):.2f} mm/s |')
    print('\n| slope | speed | lean | rolls | back | braking_distance |')
    print('|---|---|---|---|---|---|')
    for slope in (-3.0, 0.0, 3.0):
        for speed in (0.3, 0.8):
            for lean in (0.7, 1.4):
                far, back = stop(slope, speed, lean)
                said = speed_law.braking_distance(speed, math.radians(slope), lean, 0.0, LAW)
                print(f'| {slope:g} deg | {speed:g} m/s | {lean:g} rad | {far:.2f} m '
                      f'| {1e3 * back:.0f} mm | {said:.2f} m |')


if __name__ == '__main__':
    main()
