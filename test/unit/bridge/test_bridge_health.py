# SPDX-License-Identifier: Apache-2.0
"""Diagnostics of the bridge: each level with its message, and every count."""
from collections import Counter
from pathlib import Path
import re
from types import SimpleNamespace

import pytest
from session_faults import bunched_replies, loop
from virtual_robot import VirtualRobot

from ballbot_ros.control import Authority, Mode, SetPoint
from ballbot_ros.errors import LinkError, MessageError

pytest.importorskip('rclpy')
from ballbot_ros.nodes.bridge.health import health, VALUES
from ballbot_ros.ros import diagnostics

LOOP = SimpleNamespace(late=7, delayed=lambda: '')
DOCUMENT = Path(__file__).resolve().parents[3] / 'docs' / 'nodes.md'


def described(robot, loop=LOOP, imu_refused=0):
    """Return level, message and values."""
    return health(robot.session, loop, imu_refused, Authority(0.1))


def values(robot, **others):
    """Return the values only."""
    return described(robot, **others)[2]


def driving(**others):
    """Return a robot whose motor follows commands."""
    robot = VirtualRobot(**others).ready()
    robot.run(0.1, torque=0.2)
    return robot


# Level and message ------------------------------------------------------------------------

def test_before_configure_it_warns():
    level, message, found = described(VirtualRobot(), loop=None)
    assert (level, message) == (diagnostics.WARN, 'not configured')
    assert found['firmware'] == found['serial_number'] == found['faults'] == ''
    assert found['late_periods'] == 0


def test_a_failed_configure_is_reported_with_the_reason():
    robot = VirtualRobot()
    robot.plugged = False
    with pytest.raises(LinkError):
        robot.session.configure()
    assert described(robot, loop=None)[:2] == (
        diagnostics.WARN, 'not configured: the cable is out')
    robot.plugged = True
    robot.session.configure()
    assert described(robot, loop=None)[1] == 'not configured'


def test_a_motor_that_cannot_be_armed_is_an_error_without_a_named_fault():
    robot = driving(rearm=True)
    receive = robot.device.receive

    def keep_disarmed(data, now):
        robot.now += 1e-4  # a request takes time, so that its timeout ends
        return receive(data.replace(b'requested_state 8', b'requested_state 1'), now)
    robot.device.receive = keep_disarmed
    robot.session.engage('button')
    robot.run(0.3, torque=0.0)
    robot.run(0.6)
    robot.session.release()
    robot.run(0.6, torque=0.0)
    level, message, found = described(robot)
    assert level == diagnostics.ERROR and message.startswith('cannot arm: ')
    assert found['faults'] == found['e_stop'] == ''
    robot.device.receive = receive
    robot.run(1.0, torque=0.0)
    assert described(robot)[:2] == (diagnostics.OK, 'running')


def test_a_disconnected_drive_is_an_error_with_the_reason_even_under_e_stop():
    robot = driving()
    robot.plugged = False
    robot.run(0.1, torque=0.2)
    level, message, found = described(robot)
    assert level == diagnostics.ERROR
    assert message == 'looking for the drive: the cable is out'
    assert found['e_stop_reason'] == 'links_lost' and found['links_lost'] == 1
    assert not any(name.startswith('wire_') for name in found)


def test_the_e_stop_is_a_warning_with_its_reason():
    robot = VirtualRobot()
    robot.session.configure()
    robot.run(0.1)
    assert described(robot)[:2] == (diagnostics.WARN, 'e-stop: engaged at start')
    robot = driving()
    robot.session.engage('button')
    assert described(robot)[:2] == (diagnostics.WARN, 'e-stop: button')
    assert values(robot)['e_stop_reason'] == 'requested' and values(robot)['e_stops'] == 1


def test_faults_of_the_drive_are_an_error_unless_the_e_stop_is_engaged():
    robot = driving(rearm=True)
    robot.temperature = 200.0
    robot.run(0.3, torque=0.2)
    level, message, found = described(robot)
    assert level == diagnostics.ERROR and found['e_stop'] == ''
    assert 'MOTOR_FAILED' in found['faults'] and message == f'the drive reports {found["faults"]}'
    # An engaged e-stop, which does not release itself, takes precedence.
    robot = driving()
    robot.device.over_current()
    robot.run(0.1, torque=0.2)
    level, message, found = described(robot)
    assert level == diagnostics.WARN and message.startswith('e-stop: ') and found['faults']
    assert found['disarmed_by_drive'] == 1


def test_commands_that_timed_out_are_a_warning_until_the_next_command():
    robot = driving()
    robot.run(0.2)
    assert described(robot)[:2] == (diagnostics.WARN, 'commands timed out')
    assert values(robot)['timeouts'] == 1
    robot.run(0.02, torque=0.2)
    assert described(robot)[:2] == (diagnostics.OK, 'running')


def test_without_an_imu_there_is_a_warning_if_none_is_required():
    robot = driving(imu=False)
    assert described(robot)[:2] == (
        diagnostics.WARN, 'no IMU: pendulum angle unreliable off level floor')
    assert values(robot)['imu'] == 'silent'


def test_a_robot_that_follows_commands_is_ok():
    robot = driving()
    level, message, found = described(robot)
    assert (level, message) == (diagnostics.OK, 'running')
    assert found['imu'] == 'received' and found['e_stop'] == found['faults'] == ''
    assert float(found['torque']) == pytest.approx(0.2, abs=1e-4)


# Values -----------------------------------------------------------------------------------

@pytest.mark.parametrize('protocol', ['odrive', 'vesc', 'roboclaw'])
def test_drive_and_port_are_reported(protocol):
    robot = driving(protocol=protocol)
    found, identity = values(robot), robot.session.line.identity
    assert found['port'] == robot.hardware.connection.port and found['protocol'] == protocol
    assert (found['firmware'], found['serial_number']) == (
        identity.firmware, identity.serial_number)
    assert found['firmware']


def test_every_count_starts_at_zero():
    found = values(VirtualRobot(), loop=None)
    fixed = {key for key in VALUES if key == key.lower()}
    assert set(found) == fixed
    counted = fixed - {'port', 'protocol', 'firmware', 'serial_number', 'e_stop', 'faults',
                       'torque', 'imu', 'commander', 'control', 'law', 'set_value', 'warnings',
                       'derating', 'battery_voltage', 'motor_warmth', 'e_stop_reason'}
    assert {found[key] for key in counted} == {0}


def test_commands_are_counted_and_refused_ones_by_reason():
    robot = driving()
    before = values(robot)
    for stamp, reason in ((robot.now - 1.0, 'stale'), (robot.now + 1.0, 'from_the_future'),
                          (robot.now - 0.05, 'out_of_order')):
        with pytest.raises(MessageError) as refusal:
            robot.session.command(0.1, stamp)
        assert refusal.value.reason == reason
    with pytest.raises(MessageError):
        robot.session.command(float('nan'), robot.now)
    robot.session.supervisor.gate.refuse('unknown_joint')
    robot.session.command(0.1, robot.now)
    found = values(robot)
    assert found['commands_accepted'] == before['commands_accepted'] + 1
    assert found['commands_refused'] == before['commands_refused'] + 5 == 5
    assert {key: number for key, number in found.items() if key.startswith('refused_')} == {
        f'refused_{reason}': 1 for reason in (
            'stale', 'from_the_future', 'out_of_order', 'not_finite', 'unknown_joint')}


@pytest.mark.parametrize('limits, torque, counts', [
    ({'torque_limit': 0.3}, 3.0, {'limited_torque'}),
    ({'torque_rate_limit': 20.0}, 0.25, {'limited_rate'}),
    ({'angle_limit': 0.1}, 0.2, {'limited_angle'}),
    ({'speed_limit': 0.4}, 0.2, {'limited_speed'})])
def test_each_active_limit_is_counted_under_its_name(limits, torque, counts):
    robot = VirtualRobot(held=True, **limits).ready()
    robot.run(0.3, torque=torque)
    found = values(robot)
    names = ('limited_torque', 'limited_rate', 'limited_angle', 'limited_speed')
    assert {name for name in names if found[name]} >= counts
    # The rate limit always acts on a jump from rest.
    assert {name for name in names if found[name]} <= {*counts, 'limited_rate'}


def test_loss_and_recovery_of_the_line_are_counted():
    robot = driving()
    robot.plugged = False
    robot.run(0.1)
    robot.plugged = True
    robot.run(0.5)
    found = values(robot)
    assert (found['links_lost'], found['reconnects'], found['armed']) == (1, 1, 1)
    assert found['wire_sent'] > 0 and found['wire_bytes'] > 0 and found['wire_replies'] > 0


def test_encoder_imu_and_loop_are_counted():
    robot = driving()
    robot.session.fusion.jumps, robot.session.fusion.rezeroed = 5, 1
    found = values(robot, imu_refused=3)
    assert (found['encoder_jumps'], found['encoder_rezeroed']) == (5, 1)
    assert (found['imu_refused'], found['late_periods']) == (3, 7)


def test_a_count_that_is_added_during_a_report_does_no_harm():
    # A report must not iterate over counters to which the thread of the loop adds.
    class Busy(Counter):
        def items(self):
            for item in super().items():
                yield item
                self[f'new {len(self)}'] += 1

    robot = driving()
    robot.session.line.driver.counts = Busy(robot.session.line.driver.counts)
    assert values(robot)['wire_sent'] > 0


# The document -----------------------------------------------------------------------------

@pytest.mark.parametrize('protocol', ['odrive', 'vesc', 'roboclaw'])
def test_every_value_is_documented(protocol):
    text = DOCUMENT.read_text(encoding='utf-8').split('table: bridge health')[1]
    rows = dict(re.findall(r'^\| `(\w+)` \| (.*) \|$', text, re.M))
    robot = driving(protocol=protocol)
    with pytest.raises(MessageError):
        robot.session.command(0.1, robot.now - 1.0)
    for key in values(robot):
        if key.startswith(('wire_', 'refused_')):
            family, _, name = key.partition('_')
            row = rows['wire_COUNT' if family == 'wire' else 'refused_REASON']
            assert f'`{name}`' in row
        else:
            assert key in rows


def test_every_message_is_documented():
    text = DOCUMENT.read_text(encoding='utf-8')
    for level, message in (
            ('WARN', 'not configured'), ('ERROR', 'cannot arm: WHY'),
            ('ERROR', 'looking for the drive: WHY'),
            ('WARN', 'e-stop: WHY'), ('ERROR', 'the drive reports FAULTS'),
            ('WARN', 'commands timed out'),
            ('WARN', 'no IMU: pendulum angle unreliable off level floor'), ('OK', 'running')):
        assert f'| {level} | `{message}` |' in text


# Laws on board ----------------------------------------------------------------------------

def test_the_active_law_and_its_set_value_are_reported():
    assert values(driving())['control'] == 'direct' and values(driving())['law'] == ''
    robot = VirtualRobot(onboard='gentle').ready()
    robot.loop(0.1, SetPoint(Mode.SPEED, 0.25))
    found = values(robot)
    assert (found['control'], found['law'], found['set_value']) == ('onboard', 'speed', '0.2500')
    assert described(robot)[:2] == (diagnostics.OK, 'running')


def test_replies_at_a_lower_rate_than_the_gains_need_are_an_error_with_both_rates():
    robot = VirtualRobot('roboclaw', onboard='gentle').ready()
    bunched_replies(0.08)(robot)
    loop(robot, 1.5, SetPoint(Mode.HOLD, 0.2))
    level, message, _ = described(robot)
    assert level == diagnostics.ERROR
    assert message.startswith('the drive answers at 13 Hz, and these gains need 20 Hz')


def test_set_points_that_timed_out_are_a_warning():
    robot = VirtualRobot(onboard='gentle').ready()
    robot.loop(0.1, SetPoint(Mode.HOLD, 0.2))
    robot.loop(0.6)
    assert described(robot)[:2] == (diagnostics.WARN, 'set-points timed out')
