# SPDX-License-Identifier: Apache-2.0
"""The time of measurement counts, not the time of reading: late and lost answers."""
import pytest
from virtual_robot import SERIAL, STEP, VirtualRobot


@pytest.mark.parametrize('protocol', SERIAL)
@pytest.mark.parametrize('late', [0.02, 0.04])
def test_an_answer_that_is_read_late_does_not_falsify_the_rate(protocol, late):
    robot = VirtualRobot(protocol, held=True, rearm=True, speed_limit=11.0).ready()
    robot.plant.state = robot.plant.state._replace(pendulum_rate=10.0)
    robot.run(0.05, torque=0.0)
    robot.pass_time(late)  # the process is delayed
    worst = 0.0
    for _ in range(30):
        robot.run(STEP, torque=0.0)
        estimate = robot.session.fusion.estimate
        was = robot.history[round(estimate.stamp / STEP)]
        worst = max(worst, abs(estimate.readings.joint_rate - was.joint_rate))
    assert worst < 0.1 and not robot.session.supervisor.e_stop


@pytest.mark.parametrize('protocol', SERIAL)
def test_a_lost_reply_makes_stamps_one_request_too_old_for_a_short_time(protocol):
    robot = VirtualRobot(protocol).ready()
    robot.run(0.1, torque=0.0)
    robot.waiting.clear()
    lost = robot.now
    for _ in range(40):
        report = robot.run(STEP, torque=0.0)
        if report.estimate is not None:
            periods = 2.5 if robot.now < lost + 0.03 else 1.5
            assert robot.now - report.estimate.stamp < periods * STEP
