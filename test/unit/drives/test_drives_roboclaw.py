# SPDX-License-Identifier: Apache-2.0
"""RoboClaws: a voltage in place of a torque, and requests to a drive that buffers them."""
from dataclasses import replace
import math

from drive_bench import Bench
import pytest
from refusals import refused

from ballbot_ros.drives.contract import bit_names
from ballbot_ros.drives.emulated_device import DriveSettings
from ballbot_ros.drives.roboclaw import codec
from ballbot_ros.drives.roboclaw.driver import RoboClawOptions
from ballbot_ros.errors import ConfigurationError, DriveError


@pytest.fixture
def bench():
    """Return a bench whose driver has armed the motor."""
    made = Bench('roboclaw')
    made.driver.arm()
    return made


def reply(bench, number, *values):
    """Make the drive answer a request with other values."""
    right = codec.answer(0x80, number, *bench.device._answers[number]())
    bench.from_drive = lambda data: data.replace(right, codec.answer(0x80, number, *values))


def test_commands_have_the_numbers_of_the_manual():
    assert (codec.SET_TIMEOUT, codec.GET_TIMEOUT, codec.GET_VERSION, codec.GET_BATTERY) == (
        14, 15, 21, 24)
    assert (codec.GET_ENCODER, codec.GET_SPEED, codec.SET_DUTY) == ((16, 17), (30, 31), (32, 33))
    assert (codec.GET_PWMS, codec.GET_CURRENTS, codec.GET_TEMPERATURE, codec.GET_STATUS,
            codec.GET_MAX_CURRENT) == (48, 49, 82, 90, (135, 136))


def test_answers_have_the_lengths_of_the_manual():
    # Data and CRC; text up to 48 bytes.
    lengths = {15: 1, 16: 5, 17: 5, 21: 48, 24: 2, 30: 5, 31: 5, 48: 4, 49: 4, 82: 2, 90: 4,
               135: 8, 136: 8, 59: 4}
    assert {number: codec.answer_length(number) - 2 for number in codec.ANSWERS} == lengths


def test_the_other_motor_has_commands_of_its_own():
    bench = Bench('roboclaw', axis=1, address=0x80)
    kept = bench.sent()
    bench.driver.identify()
    bench.driver.read_settings()
    bench.driver.arm()
    bench.cycles(40)
    bench.driver.stop()
    stream = b''.join(kept)
    assert {number for number in range(256) if bytes((0x80, number)) in stream} == {
        14, 15, 17, 21, 24, 31, 33, 48, 49, 59, 82, 90, 136}


def test_a_version_has_a_name_and_a_number():
    identity = Bench('roboclaw').driver.identify()
    assert (identity.hardware, identity.firmware) == ('USB Roboclaw 2x30a', '4.2.8')


def test_no_torque_needs_no_voltage_at_any_speed(bench):
    bench.sense(velocity=200.0)
    bench.cycles(20, torque=0.05)
    bench.cycles(1, torque=0.0)
    assert bench.device.torque() == 0.0


def test_the_voltage_of_a_torque_is_that_of_resistance_and_speed(bench):
    for velocity in (-150.0, 0.0, 120.0):
        bench.sense(velocity=velocity)
        bench.cycles(20, torque=-0.03)
        assert bench.device.torque() == pytest.approx(-0.03, abs=5e-4)


def test_a_supply_voltage_of_a_second_ago_scales_no_torque(bench):
    bench.cycles(20, torque=0.02)
    bench.from_drive = lambda data: b''
    begin = bench.now
    with refused('no_voltage', error=DriveError):
        bench.cycles(1000, torque=0.02)
    assert bench.now - begin == pytest.approx(1.0, abs=0.1)
    bench.driver.send_stop()
    assert bench.device.torque() == 0.0


def test_requests_repeat_no_command_that_is_fresh_and_release_one_that_is_old(bench):
    bench.cycles(5, torque=0.02)
    kept, duty = bench.sent(), codec.set_duty(0x80, 0, 0.0)
    bench.driver.ask()
    assert len(kept) == 1 and duty[:2] not in kept[0]
    bench.pass_time(0.11)
    bench.driver.ask()
    bench.driver.ask()
    assert kept[1].startswith(duty) and duty not in kept[2]


def test_feeding_counts_as_a_command_for_the_requests(bench):
    bench.cycles(20, torque=0.05)
    for _ in range(150):
        bench.pass_time(0.002)
        bench.driver.feed()
        bench.driver.ask()
        bench.driver.poll()
    assert bench.device.torque() == pytest.approx(0.05, abs=2e-3)


def test_every_slow_value_is_asked_for_in_turn_and_the_status_every_other_time(bench):
    kept = bench.sent()
    bench.cycles(600)
    firsts = [frame[6:8] for frame in kept if frame[7] not in (16, 30)]
    assert len(firsts) == pytest.approx(120, abs=2)  # one in 10 ms
    assert {frame[1] for frame in firsts[::2]} in ({90}, {15, 24, 48, 49, 82, 135})
    for number, times in ((90, 60), (24, 10), (49, 10), (82, 10), (15, 10), (135, 10)):
        assert sum(frame[1] == number for frame in firsts) == pytest.approx(times, abs=1)


@pytest.mark.parametrize('turns', [1, -1])
def test_the_position_goes_on_where_the_counter_of_the_encoder_wraps(bench, turns):
    start = bench.cycles(10).position
    for position in (2.0e6, 4.0e6, 6.0e6, 3.5e6):  # the counter wraps at 3.29e6 rad
        bench.sense(position=turns * position)
        assert bench.cycles(10).position - start == pytest.approx(turns * position, abs=2e-3)


@pytest.mark.parametrize('bit', range(32))
def test_only_errors_take_the_power_off_and_every_bit_has_one_name(bench, bit):
    reply(bench, codec.GET_STATUS, 1 << bit)
    telemetry = bench.cycles(30)
    # The manual lists errors in the lower half, warnings in the upper one.
    assert (len(telemetry.faults), len(telemetry.warnings)) == ((1, 0) if bit < 16 else (0, 1))
    assert telemetry.armed is (bit >= 16)


@pytest.mark.parametrize('sensed, faults, warnings', [
    ({}, (), ()), ({'temperature': 90.0}, (), ('TEMPERATURE_WARNING',)),
    ({'temperature': 101.0}, ('TEMPERATURE_ERROR',), ('TEMPERATURE_WARNING',)),
    ({'bus_voltage': 9.0}, (), ('MAIN_VOLTAGE_LOW_WARNING',)),
    ({'bus_voltage': 35.0}, (), ('MAIN_VOLTAGE_HIGH_WARNING',)),
    ({'stop_switch': 1.0}, ('E_STOP',), ())])
def test_the_status_names_errors_and_warnings(sensed, faults, warnings):
    bench = Bench('roboclaw')
    bench.driver.identify()
    bench.driver.arm()
    bench.sense(**sensed)
    telemetry = bench.cycles(30, torque=0.01)
    assert (telemetry.faults, telemetry.warnings) == (faults, warnings)
    assert telemetry.armed is (not faults)


def test_faults_are_not_cleared_by_any_command_and_that_is_said(bench):
    assert bench.driver.clear_faults() == ()
    bench.device.over_current()
    with refused('not_clearable', 'drive', DriveError) as caught:
        bench.driver.clear_faults()
    assert 'M1_DRIVER_FAULT_ERROR' in str(caught.value)


@pytest.mark.parametrize('bits, name', [
    (0x1, 'E_STOP'), (0x2, 'TEMPERATURE_ERROR'), (0x4, 'TEMPERATURE_2_ERROR'),
    (0x8, 'MAIN_VOLTAGE_HIGH_ERROR'), (0x10, 'LOGIC_VOLTAGE_HIGH_ERROR'),
    (0x20, 'LOGIC_VOLTAGE_LOW_ERROR'), (0x40, 'M1_DRIVER_FAULT_ERROR'),
    (0x80, 'M2_DRIVER_FAULT_ERROR'), (0x100, 'M1_SPEED_ERROR'), (0x200, 'M2_SPEED_ERROR'),
    (0x400, 'M1_POSITION_ERROR'), (0x800, 'M2_POSITION_ERROR'), (0x1000, 'M1_CURRENT_ERROR'),
    (0x2000, 'M2_CURRENT_ERROR'), (0x10000, 'M1_OVER_CURRENT_WARNING'),
    (0x20000, 'M2_OVER_CURRENT_WARNING'), (0x40000, 'MAIN_VOLTAGE_HIGH_WARNING'),
    (0x80000, 'MAIN_VOLTAGE_LOW_WARNING'), (0x100000, 'TEMPERATURE_WARNING'),
    (0x200000, 'TEMPERATURE_2_WARNING'), (0x400000, 'S4_SIGNAL_TRIGGERED'),
    (0x800000, 'S5_SIGNAL_TRIGGERED'), (0x1000000, 'SPEED_ERROR_LIMIT_WARNING'),
    (0x2000000, 'POSITION_ERROR_LIMIT_WARNING')])
def test_status_bits_have_the_names_of_the_library_of_the_maker(bits, name):
    assert bit_names(bits, codec.STATUS) == (name,)


def test_a_warning_does_not_keep_the_motor_from_being_armed():
    bench = Bench('roboclaw')
    reply(bench, codec.GET_STATUS, 0x10000)
    bench.driver.arm()
    reply(bench, codec.GET_STATUS, 0x8000)
    with refused('not_armed', 'drive', DriveError) as caught:
        bench.driver.arm()
    assert '0x8000' in str(caught.value)


@pytest.mark.parametrize('watchdog, tenths', [(0.1, 1), (0.3, 3), (1.0, 10)])
@pytest.mark.parametrize('before', [0.0, 0.1, 5.0])
def test_the_serial_timeout_is_set_at_each_start_in_tenths_of_a_second(watchdog, tenths, before):
    bench = Bench('roboclaw', DriveSettings(watchdog=before), watchdog=watchdog)
    kept = bench.sent()
    judged = bench.settings()
    assert judged['watchdog'].acceptable and bench.device._timeout == tenths
    assert judged['watchdog'].value == f'{0.1 * tenths:g} s'
    assert any(frame.startswith(bytes((0x80, 14, tenths))) for frame in kept)


@pytest.mark.parametrize('watchdog, timeout, acceptable', [
    (0.1, 1, True), (0.1, 2, False), (0.3, 2, True), (0.3, 3, True), (0.3, 4, False),
    (0.1, 0, False)])
def test_a_serial_timeout_that_stays_otherwise_is_judged(watchdog, timeout, acceptable):
    bench = Bench('roboclaw', watchdog=watchdog)
    reply(bench, codec.GET_TIMEOUT, timeout)
    bench.to_drive = lambda data: data[5:] if data[1] == 14 else data
    assert bench.settings()['watchdog'].acceptable is acceptable


@pytest.mark.parametrize('watchdog', [0.02, 0.05, 0.12, 0.25, 9.99])
def test_a_watchdog_that_the_drive_would_round_is_refused(watchdog):
    with refused('out_of_range', 'watchdog', ConfigurationError):
        RoboClawOptions(torque_limit=0.1, watchdog=watchdog)


def test_firmware_without_a_serial_timeout_is_refused_with_what_to_do():
    bench = Bench('roboclaw', DriveSettings(quirks=('no_timeout',)))
    bench.driver.identify()
    bad, = bench.refused().values()
    assert (bad.name, bad.value) == ('watchdog', 'unknown') and 'firmware' in bad.remedy


@pytest.mark.parametrize('supply, acceptable', [
    (9.9, False), (10.1, True), (33.9, True), (34.1, False)])
def test_the_supply_must_lie_where_the_drive_lets_the_motor_have_it(supply, acceptable):
    bench = Bench('roboclaw')
    bench.sense(bus_voltage=supply)
    assert bench.settings()['supply'].acceptable is acceptable


def test_answers_to_a_lost_group_do_not_confirm_a_stop(bench):
    # The first stop is lost, but not its requests; the second is lost completely.
    bench.cycles(20, torque=0.05)
    bench.to_drive = lambda data: data[6:]
    bench.driver.send_stop()
    bench.to_drive = lambda data: b''
    with refused('not_stopped', 'drive', DriveError):
        bench.driver.stop(timeout=0.1)


def test_a_duty_beyond_full_is_full():
    for axis in (0, 1):
        assert codec.set_duty(0x80, axis, 7.0) == codec.set_duty(0x80, axis, 1.0)
        assert codec.set_duty(0x80, axis, -7.0) == codec.set_duty(0x80, axis, -1.0)
    assert codec.set_duty(0x80, 0, math.inf)[2:4] == b'\x7f\xff'


def test_bytes_that_belong_to_no_answer_are_counted_but_acknowledgements():
    parser = codec.parser()
    reply = codec.reply_of(b'')
    parser.feed(b'\xff\x07\x07\xff' + reply + b'\xff\x07' + reply)
    assert parser.counts == {'skipped': 3}


def test_a_text_without_an_end_is_not_an_answer():
    parser = codec.parser()
    assert parser.feed(b'a' * 200) == [] and parser.counts['skipped'] >= 150
    assert parser.feed(codec.reply_of(b'')) != []


def test_the_current_that_is_asked_for_is_one_that_the_drive_can_keep_and_is_accepted():
    settings = DriveSettings(torque_limit=10.0, current_limit=60.0)
    for limit in (0.3 / 45.0, 0.1, 0.0889, 0.0123):
        bench = Bench('roboclaw', settings, torque_limit=limit)
        amperes = float(bench.refused()['torque limit'].remedy.split()[-2])
        bench.device.settings = replace(settings, current_limit=amperes)
        assert bench.settings()['torque limit'].acceptable, (limit, amperes)


def test_a_command_that_is_not_answered_is_named_by_its_number(bench):
    bench.driver.identify()
    bench.from_drive = lambda data: b''
    with refused('silent', 'drive', DriveError) as caught:
        bench.driver.arm()
    assert f'command {codec.GET_STATUS}' in str(caught.value)
