# SPDX-License-Identifier: Apache-2.0
"""The emulated drives behave as in the tests and documents of their makers."""
import pytest

from ballbot_ros.drives.emulated_device import DriveSettings
from ballbot_ros.drives.odrive.ascii import codec as odrive
from ballbot_ros.drives.odrive.ascii.emulated import ODriveDevice
from ballbot_ros.drives.roboclaw import codec as roboclaw
from ballbot_ros.drives.roboclaw.emulated import RoboClawDevice
from ballbot_ros.drives.vesc.uart import codec as vesc
from ballbot_ros.drives.vesc.uart.emulated import FAULT_TIME, VescDevice


@pytest.fixture
def settings():
    """Return settings with wide limits."""
    return DriveSettings(torque_limit=50.0, current_limit=5000.0)


@pytest.fixture
def board(settings):
    """Return an ODrive."""
    return ODriveDevice(settings)


# The sequence of tools/odrive/tests/uart_ascii_test.py in odriverobotics/ODrive

def test_odrive_reads_a_property(board):
    assert float(board.receive(b'r vbus_voltage\n', 0.0)) == pytest.approx(24.0)


def test_odrive_says_when_there_is_no_such_property(board):
    assert board.receive(b'r blahblah\n', 0.0) == b'invalid property\r\n'


def test_odrive_takes_a_line_byte_by_byte(board):
    replies = [board.receive(bytes((byte,)), 0.1 * number)
               for number, byte in enumerate(b'r vbus_voltage\n')]
    assert float(b''.join(replies)) == pytest.approx(24.0)


def test_odrive_ignores_a_line_with_a_wrong_checksum(board):
    assert board.receive(b'r vbus_voltage *12\n', 0.0) == b''


def test_odrive_answers_a_checksum_with_a_checksum_and_passes_over_comments(board):
    reply = board.receive(b'r vbus_voltage *93 ; this is a comment\n', 0.0)
    text, _, checksum = reply.strip().partition(b'*')
    assert float(text) == pytest.approx(24.0) and int(checksum) == odrive.checksum(text)


def test_odrive_takes_a_torque_without_an_answer(board):
    board.receive(b'w axis0.requested_state 8\n', 0.0)
    assert board.receive(b'c 0 12.5\n', 0.0) == b''
    assert board.torque() == 12.5
    assert board.receive(b'r axis0.controller.config.control_mode\n', 0.0) == b'1\r\n'


def test_odrive_gives_position_and_velocity_in_turns(board):
    board.sensed = board.sensed._replace(position=6.283185307179586, velocity=-3.141592653589793)
    assert board.receive(b'f 0\n', 0.0) == b'1.000000 -0.500000\r\n'


def test_odrive_watchdog_expires_and_stays_expired_until_cleared(board):
    board.receive(b'w axis0.requested_state 8\nc 0 1\n', 0.0)
    for tick in range(9):
        board.tick(0.02 * tick)
        board.receive(b'u 0\n', 0.02 * tick)
    assert board.torque() == 1.0
    board.tick(0.3)
    assert board.torque() == 0.0
    assert board.receive(b'r axis0.error\n', 0.3) == b'2048\r\n'
    board.receive(b'u 0\nw axis0.requested_state 8\nc 0 1\n', 0.31)
    assert board.torque() == 0.0
    board.receive(b'sc\nu 0\nw axis0.requested_state 8\nc 0 1\n', 0.32)
    assert board.torque() == 1.0


# Quirks that are relevant to safety, from Firmware/communication/ascii_protocol.cpp

@pytest.mark.parametrize('line, torque', [
    (b'c 0 0.25000 *%d\n' % odrive.checksum(b'c 0 0.25000 '), 0.25),
    (b'c 0 0.25000 *93\n', 0.0),  # a wrong checksum
    (b'c 0 0.25000 793\n', 0.25),  # an asterisk corrupted to a digit: the space protects
    (b'c 0 0.;5000 *117\n', 0.0),  # a digit corrupted to the start of a comment
    (b'c 0 0.2!000 *117\n', 0.2),  # a digit corrupted to the end of the line
    (b'c 0 nan\n', 0.0)])
def test_odrive_obeys_damaged_lines_like_the_firmware(board, line, torque):
    board.receive(b'w axis0.requested_state 8\n', 0.0)
    board.receive(line, 0.0)
    assert board.torque() == torque


def test_odrive_passes_over_a_line_that_is_too_long(board):
    assert board.receive(b'r' * 300, 0.0) == b''
    assert board.receive(b'\nr axis0.error\n', 0.0) == b'0\r\n'
    assert board.receive(b'c ' + 5000 * b'1' + b'\nr axis0.error\n', 0.0) == b'0\r\n'


@pytest.mark.parametrize('lines', [
    b'w test_property inf\n', b'w test_property nan\n', b'w test_property 1e999\n',
    b'w config.enable_brake_resistor 1\nsc\nw config.brake_resistance 0\nr ibus\n',
    b'w axis0.requested_state 8\nw axis0.motor.config.torque_lim -1e300\nc 0 1\n'])
def test_odrive_goes_on_after_any_number(board, lines):
    board.receive(lines, 0.0)
    assert board.receive(b'r test_property\n', 0.0) == b'0\r\n'


# VESC

def test_vesc_releases_the_motor_when_its_timeout_expires_and_follows_the_next_command(settings):
    drive = VescDevice(settings)
    drive.receive(vesc.frame(vesc.set_current(4.0)), 0.0)
    assert drive.torque() == pytest.approx(0.1)
    drive.tick(0.0)
    drive.tick(0.2)
    assert drive.torque() == 0.0
    drive.receive(vesc.frame(vesc.set_current(4.0)), 0.2)
    assert drive.torque() == pytest.approx(0.1)


def test_vesc_keeps_off_for_a_while_after_a_fault(settings):
    drive = VescDevice(DriveSettings(watchdog=0.0))
    drive.tick(0.0)
    drive.over_current()
    for now in (0.1, FAULT_TIME):
        drive.tick(now)
        drive.receive(vesc.frame(vesc.set_current(4.0)), now)
        assert drive.torque() == 0.0
    drive.tick(0.1 + FAULT_TIME)
    drive.receive(vesc.frame(vesc.set_current(4.0)), 0.7)
    assert drive.torque() > 0.0


# RoboClaw

def test_roboclaw_sets_a_voltage_and_not_a_torque(settings):
    drive = RoboClawDevice(settings)
    assert drive.receive(roboclaw.set_duty(0x80, 0, 0.5), 0.0) == b'\xff'
    current = 0.5 * 24.0 / settings.resistance
    assert drive.torque() == pytest.approx(settings.torque_constant * current, rel=1e-3)
    drive.sensed = drive.sensed._replace(velocity=0.5 * 24.0 / settings.speed_constant)
    assert drive.torque() == pytest.approx(0.0, abs=1e-4)  # idling


def test_roboclaw_does_not_answer_a_damaged_command(settings):
    drive = RoboClawDevice(settings)
    packet = roboclaw.set_duty(0x80, 0, 0.5)
    for bit in range(8 * len(packet)):
        damaged = bytearray(packet)
        damaged[bit // 8] ^= 1 << bit % 8
        drive.receive(bytes(damaged), float(bit))
        assert drive.torque() == 0.0


def test_roboclaw_drops_a_packet_with_a_pause_in_it(settings):
    drive = RoboClawDevice(settings)
    packet = roboclaw.set_duty(0x80, 0, 0.5)
    drive.receive(packet[:3], 0.0)
    assert drive.receive(packet[3:], 0.02) == b'' and drive.torque() == 0.0
    assert drive.receive(packet, 0.04) == b'\xff' and drive.torque() > 0.0


def test_roboclaw_stops_when_no_bytes_come(settings):
    drive = RoboClawDevice(settings)
    drive.receive(roboclaw.set_duty(0x80, 0, 0.5), 0.0)
    drive.tick(0.09)
    assert drive.torque() > 0.0
    drive.tick(0.11)
    assert drive.torque() == 0.0
