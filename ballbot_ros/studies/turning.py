# SPDX-License-Identifier: Apache-2.0
"""The lateral model beside the free ball of MuJoCo, under the same commands."""
from typing import NamedTuple, Optional

import numpy as np

from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.steering import LateralState, law, step
from ballbot_ros.studies.free_ball import FreeBall

PERIOD = 0.02  # of the commands [s]
TURN = ('speed', 'tilt', 'yaw_rate', 'heading')


class LateralRun(NamedTuple):
    """A lean that is held, or a yaw rate that the steering law follows."""

    speed: float  # at the start [m/s]
    lean: float = 0.0  # [rad]
    yaw_rate: Optional[float] = None  # [rad/s]
    duration: float = 6.0  # [s]

    def command(self, robot: Robot, state: LateralState, speed: float) -> float:
        """Return the set-point of the lean [rad]."""
        return self.lean if self.yaw_rate is None else law(robot, state, speed, self.yaw_rate)


class TurnComparison(NamedTuple):
    """Motion in both models, (n,) each, and how far they differ."""

    time: Array  # [s]
    mujoco: dict[str, Array]  # by the names of `TURN`; speed in m/s, rad, rad/s
    model: dict[str, Array]

    def deviation(self, name: str) -> float:
        """Return the root mean square of a difference."""
        return float(np.sqrt(np.mean((self.mujoco[name] - self.model[name])**2)))

    def heading_error(self) -> float:
        """Return the largest difference of the heading [rad]."""
        return float(np.abs(self.mujoco['heading'] - self.model['heading']).max())


def lossless(robot: Robot) -> Robot:
    """Return a robot that keeps its speed without a torque of the forward axis."""
    return robot.replace(rolling_friction=0.0, joint_friction=0.0)


def compare(robot: Robot, run: LateralRun) -> TurnComparison:
    """
    Run a robot without friction in both models.

    The pendulum is held down by law (11).  The lateral model takes its speed from MuJoCo, and each
    model its commands from its own state.

    Raises
    ------
    ConfigurationError
        If MuJoCo is not installed, or the robot has no steering.

    """
    robot = lossless(robot)
    ball, state = FreeBall(robot, run.speed, set_angle=0.0), LateralState()
    found = ball.state()
    rows = []
    for _ in range(round(run.duration / PERIOD)):
        rows.append((found.time, found.speed, found.lateral.tilt, found.lateral.yaw_rate,
                     found.lateral.heading, found.speed, state.tilt, state.yaw_rate,
                     state.heading))
        ball.lean_command = run.command(robot, found.lateral, found.speed)
        command = run.command(robot, state, found.speed)
        ball.advance(PERIOD)
        before, found = found.speed, ball.state()
        state = step(robot, state, 0.5 * (before + found.speed), command, PERIOD,
                     (found.speed - before) / PERIOD)
    columns = np.array(rows).T
    columns[4] = np.unwrap(columns[4])
    return TurnComparison(columns[0], dict(zip(TURN, columns[1:5])), dict(zip(TURN, columns[5:])))

