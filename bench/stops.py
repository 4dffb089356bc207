# SPDX-License-Identifier: Apache-2.0
"""
Compare random stops of the full model with the distance that the safety filter predicts.

``python bench/stops.py [COUNT [SEED]]`` prints the number of longer stops, and the worst ones.
"""
from dataclasses import dataclass
import math
import sys

import numpy as np

from ballbot_ros.decision import (
    Decision, Kind, Knowledge, Motion, nominal_knowledge, Pilot, Plan, Reason, Strategy)
from ballbot_ros.physics.model.terrain import Terrain
from ballbot_ros.studies.evaluation.approaches import draw_robot
from ballbot_ros.studies.evaluation.closed_loop import balanced_angle, ClosedLoop, PERIOD

SLOPE_MAX = math.radians(3.0)  # [rad]
SPEEDS = (0.05, 1.1)          # before the stop [m/s]
ROLLING = 0.4                 # duration of driving before the stop [s]
LEAST_SPEED, STOP_TIME_MAX = 0.005, 15.0  # threshold of rest [m/s], longest stop [s]
PERIODS = 10                  # control periods between two decisions


@dataclass(frozen=True)
class RandomStop:
    """The predicted and the simulated distance of an immediate stop."""

    speed: float  # at the start of the stop [m/s]
    slope: float  # [rad]
    predicted: float  # stopping distance of the safety filter [m]
    rolled: float  # stopping distance of the full model [m]


def random_stop(nominal: Knowledge, seed: int, number: int) -> RandomStop:
    """
    Return stop `number` of a seed, with random robot, friction, slope and speed.

    The pilot of the decision, initialized with the true slope and pendulum angle, first drives
    the ball at the speed, then stops it.
    """
    random = np.random.default_rng([seed, number])
    robot = draw_robot(nominal.robot, random)
    slope, speed = float(random.uniform(-SLOPE_MAX, SLOPE_MAX)), float(random.uniform(*SPEEDS))
    length = 50.0
    terrain = Terrain([(-length, -length * math.tan(slope)), (length, length * math.tan(slope))],
                      np.array([robot.surface_friction]))
    loop = ClosedLoop(robot, terrain, nominal.robot, nominal.control, speed,
                      balanced_angle(robot, slope))
    pilot = Pilot(nominal)
    going = Decision(Kind.CLEAR, Reason.NOTHING_AHEAD, speed, '')
    stopping = Decision(Kind.STOP, Reason.TOO_FAST, 0.0, '', plan=Plan(Strategy.STOP))
    for decision, longest in (going, ROLLING), (stopping, STOP_TIME_MAX):
        begin, speed = loop.state.x, loop.state.velocity_x
        farthest = begin
        for _ in range(round(longest / (PERIODS * PERIOD))):
            state = loop.state
            farthest = max(farthest, state.x)
            if decision is stopping and state.velocity_x < LEAST_SPEED:
                break
            motion = Motion(loop.time, state.x, state.velocity_x, state.pendulum_angle,
                            slope=slope)
            loop.advance(pilot.angle(decision, motion), PERIODS)
    return RandomStop(speed, slope, nominal.braking.distance(speed, slope, emergency=True),
                      farthest - begin)


def main(count=10_000, seed=0):
    """Print the margins of the predicted distance."""
    nominal = nominal_knowledge()
    stops = [random_stop(nominal, seed, number) for number in range(count)]
    spare = np.array([stop.predicted - stop.rolled for stop in stops])
    print(f'{count} random stops, seed {seed}: {np.sum(spare < 0.0)} longer than predicted')
    for number in np.argsort(spare)[:5]:
        stop = stops[number]
        print(f'  stop {number}: {stop.speed:.2f} m/s on {np.degrees(stop.slope):+.1f} degrees, '
              f'predicted {stop.predicted:.3f} m, rolled {stop.rolled:.3f} m')
    print('  predicted minus rolled [m], 1 / 10 / 50 / 90 %: ' + ' / '.join(
        f'{value:.3f}' for value in np.percentile(spare, (1, 10, 50, 90))))


if __name__ == '__main__':
    main(*map(int, sys.argv[1:]))
