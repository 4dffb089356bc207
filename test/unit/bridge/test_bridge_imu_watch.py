# SPDX-License-Identifier: Apache-2.0
"""No torque without fresh IMU readings, for any reading or clock; and the recovery."""
import pytest
from refusals import refused
from virtual_robot import STEP, VirtualRobot

from ballbot_ros.bridge.sensing import AHEAD, IMU_RECOVERY_TIME, ImuWatch, MISSING_TIMEOUT
from ballbot_ros.bridge.supervisor import StopReason
from ballbot_ros.errors import MessageError, RefusedError
from ballbot_ros.estimation import ImuReading
from ballbot_ros.estimation.fusion import IMU_TIMEOUT

pytest.importorskip('rclpy')
from ballbot_ros.nodes.bridge.motor import state_of

HOUR = 3600.0


def with_torque(**limits):
    """Return a robot whose motor follows commands, and its IMU."""
    robot = VirtualRobot(**limits).ready()
    robot.run(0.2, torque=0.5)
    assert robot.motor > 0.0
    return robot, robot._imu


def run_without_imu(robot, seconds):
    """Run without IMU readings while commands continue; return the last report."""
    robot._imu = None
    return robot.run(seconds, torque=0.5)


@pytest.mark.parametrize('ahead, refused', [
    (0.9 * AHEAD, False), (1.1 * AHEAD, True), (HOUR, True), (float('inf'), True),
    (-0.9 * IMU_TIMEOUT, False), (-1.1 * IMU_TIMEOUT, True), (-HOUR, True),
    (float('nan'), True)])
def test_implausible_stamps_are_refused(ahead, refused):
    try:
        ImuWatch().check(100.0 + ahead, 100.0)
        assert not refused
    except MessageError as error:
        assert refused
        assert error.reason == ('from_the_future' if ahead > 0.0 else 'stale')


@pytest.mark.parametrize('ahead', [0.0, 0.9 * AHEAD])
def test_the_age_of_a_reading_counts_from_its_arrival_or_an_earlier_stamp(ahead):
    watch = ImuWatch()
    assert not watch.has(0.0)
    watch.reading_received(1.0 + ahead, 1.0)
    assert watch.has(1.0 + 0.99 * IMU_TIMEOUT) and not watch.has(1.0 + 1.01 * IMU_TIMEOUT)
    watch.reading_received(1.97, 2.0)
    assert watch.has(2.019) and not watch.has(2.021)


def steady_watch(now):
    """Return the watch of an IMU with a reading at a time, and long before [s]."""
    watch = ImuWatch()
    watch.silent = False
    watch.reading_received(now, now)
    return watch


def test_the_imu_is_silent_after_the_missing_timeout_and_until_it_is_steady():
    watch = steady_watch(1.0)
    assert not watch.update(1.0, True) and watch.usable(1.0)
    missing = 1.0 + IMU_TIMEOUT + 0.001
    assert not watch.update(missing, True) and not watch.usable(missing)
    assert not watch.update(missing + 0.9 * MISSING_TIMEOUT, False)
    assert watch.update(missing + 1.1 * MISSING_TIMEOUT, False)
    assert not watch.update(missing + 2.0, False) and watch.silent and watch.silences == 1
    now = start = missing + 3.0
    while now < start + 0.95 * IMU_RECOVERY_TIME:
        watch.reading_received(now, now)
        watch.update(now, False)
        assert not watch.usable(now)
        now += 0.01
    watch.update(now + 2.0 * IMU_TIMEOUT, False)
    start = now = now + 2.0 * IMU_TIMEOUT  # a gap restarts the recovery time
    while now < start + 1.05 * IMU_RECOVERY_TIME:
        watch.reading_received(now, now)
        watch.update(now, False)
        assert watch.usable(now) is (now >= start + IMU_RECOVERY_TIME)
        now += 0.01


def test_a_stall_of_the_process_is_not_an_imu_timeout():
    watch = steady_watch(1.0)
    watch.update(1.0, True)
    watch.update(1.2, True)  # the loop runs before the queued message
    watch.reading_received(1.199, 1.2005)
    assert not watch.update(1.202, False) and watch.usable(1.202) and watch.silences == 0


def test_an_imu_that_never_sent_a_reading_is_silent_but_not_a_fault():
    watch = ImuWatch()
    assert not watch.update(0.0, False) and not watch.update(1.0, False)
    assert watch.silent and watch.silences == 0


def test_a_release_requires_readings_and_a_steady_imu_from_the_first_one_on():
    robot = VirtualRobot()
    robot.session.sensing.imu_watch = ImuWatch()
    imu, robot._imu = robot._imu, None
    robot.session.configure()
    robot.session.activate()
    for readings, seconds in ((None, 0.1), (imu, 0.9 * IMU_RECOVERY_TIME)):
        robot._imu = readings
        robot.run(seconds)
        with refused('standing', 'imu', RefusedError):
            robot.session.release()
    robot.run(0.2 * IMU_RECOVERY_TIME)
    robot.session.release()


@pytest.mark.parametrize('rearm', [False, True])
def test_an_imu_timeout_ends_the_torque_and_discards_the_command(rearm):
    robot, _ = with_torque(rearm=rearm)
    robot.torques.clear()
    report = run_without_imu(robot, 0.13)
    assert any(robot.torques[:20]) and not any(robot.torques[28:])
    assert (None if rearm else StopReason.IMU_SILENT) == (
        report.e_stop and report.e_stop.reason)
    assert state_of(report) == ('no_imu' if rearm else 'e_stop')


def test_with_rearm_torque_returns_only_with_a_steady_imu_and_a_fresh_command():
    robot, imu = with_torque(rearm=True)
    run_without_imu(robot, 0.3)
    robot._imu = imu
    robot.torques.clear()
    report = robot.run(0.9 * IMU_RECOVERY_TIME, torque=0.5)
    assert not any(robot.torques) and state_of(report) == 'no_imu'
    report = robot.run(0.3)  # the IMU is steady, but there are no commands
    assert not any(robot.torques) and state_of(report) == 'waiting'
    robot.run(0.1, torque=0.5)
    assert robot.motor > 0.0


def test_without_rearm_the_e_stop_is_released_only_with_a_steady_imu():
    robot, imu = with_torque()
    run_without_imu(robot, 0.3)
    robot._imu = imu
    robot.run(0.9 * IMU_RECOVERY_TIME, torque=0.0)
    with refused('standing', 'imu', RefusedError):
        robot.session.release()
    robot.run(0.2 * IMU_RECOVERY_TIME, torque=0.0)
    robot.session.release()
    robot.run(0.2, torque=0.5)
    assert robot.motor > 0.0


def test_an_imu_timeout_without_torque_does_not_engage_the_e_stop():
    robot = VirtualRobot().ready()
    robot.run(0.2, torque=0.0)
    robot._imu = None
    report = robot.run(0.3, torque=0.0)
    assert not report.e_stop and state_of(report) == 'no_imu'


def test_a_missing_imu_has_no_effect_if_none_is_required():
    robot = VirtualRobot(imu=False).ready()
    robot.run(0.3, torque=0.5)
    assert robot.motor > 0.0 and not robot.run(STEP).needs_imu


def test_a_stamp_from_the_future_neither_prolongs_torque_nor_blocks_later_readings():
    robot, imu = with_torque()
    with refused('from_the_future'):
        robot.session.imu(ImuReading(robot.now + HOUR, 0.0, 0.0, 9.81))
    report = robot.run(0.2, torque=0.5)
    assert robot.motor > 0.0 and not report.needs_imu  # correctly stamped readings continue
    run_without_imu(robot, 0.2)
    assert robot.motor == 0.0
    with pytest.raises(MessageError):
        robot.session.imu(ImuReading(robot.now + HOUR, 0.0, 0.0, 9.81))
    report = robot.run(0.2)
    assert robot.motor == 0.0 and report.needs_imu


@pytest.mark.parametrize('error', [HOUR, -HOUR, 0.03, -0.1])
def test_stamps_of_a_stepped_clock_are_refused_for_twenty_milliseconds_without_a_fault(error):
    robot, imu = with_torque()
    robot._imu = None
    for _ in range(10):  # until the clocks are compared again
        with pytest.raises(MessageError):
            robot.session.imu(ImuReading(robot.now + STEP + error, 0.0, 0.0, 9.81))
        robot.run(STEP, torque=0.5)
    robot._imu = imu
    report = robot.run(0.2, torque=0.5)
    assert robot.motor > 0.0 and not report.e_stop
    assert robot.session.sensing.imu_watch.silences == 0
