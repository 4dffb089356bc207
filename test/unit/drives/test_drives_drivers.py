# SPDX-License-Identifier: Apache-2.0
"""Behaviour of every driver, for each protocol."""
from dataclasses import replace
import itertools
import math

from drive_bench import Bench, KINDS
import pytest
from refusals import refused
import serial

from ballbot_ros.drives import codec_of, driver_class, line_of, SERIAL
from ballbot_ros.drives.contract import WireBudget
from ballbot_ros.drives.emulated_device import DriveSettings
from ballbot_ros.emulator.terminal import BIT_RATES
from ballbot_ros.errors import ConfigurationError, DriveError, MessageError


def test_a_drive_reports_its_identity(bench, kind):
    identity = bench.driver.identify()
    assert f'{identity.protocol} {identity.generation}'.strip() == kind
    assert identity.firmware.startswith(identity.generation)
    assert identity.in_words.endswith(identity.generation)


def test_settings_that_will_do_are_accepted(bench):
    assert 'watchdog' in bench.settings() and not bench.refused()


@pytest.mark.parametrize('watchdog, acceptable', [(0.0, False), (0.1, True), (0.2, False)])
def test_the_watchdog_of_the_drive_is_judged_by_that_of_the_options(kind, watchdog, acceptable):
    if kind == 'roboclaw':  # the driver sets it at each start
        watchdog, acceptable = 0.1, True
    bench = Bench(kind, DriveSettings(watchdog=watchdog))
    setting = bench.settings()['watchdog']
    assert setting.acceptable is acceptable and setting.remedy
    assert not watchdog or float(setting.value.split()[0]) == watchdog
    assert float(setting.wanted.split()[2]) == 0.1


@pytest.mark.parametrize('torque_limit, current_limit, ceiling', [
    (0.1, 9.0, 0.1), (0.1009, 9.0, 0.1009), (0.103, 9.0, 0.103), (9.0, 4.0, 0.1),
    (9.0, 4.2, 0.105)])
def test_the_limit_of_the_drive_is_judged_by_that_of_the_options(
        kind, torque_limit, current_limit, ceiling):
    bench = Bench(kind, DriveSettings(torque_limit=torque_limit, current_limit=current_limit))
    setting = bench.settings()['torque limit']
    assert setting.acceptable is (ceiling < 0.102) and setting.remedy
    assert float(setting.value.split()[0]) == pytest.approx(ceiling, rel=0.003)
    assert float(setting.wanted.split()[2]) == 0.1


@pytest.mark.parametrize('kind, limit, watchdog', [
    ('roboclaw', '4 A', '0.1 s'), ('vesc', '4 A', '90 ms'),
    ('odrive 0.5', 'torque_lim 0.1', 'watchdog_timeout 0.1')])
def test_a_remedy_names_the_number_to_set(kind, limit, watchdog):
    settings = Bench(kind).settings()
    assert limit in settings['torque limit'].remedy and watchdog in settings['watchdog'].remedy


def test_a_torque_reaches_the_motor_once_armed(bench):
    bench.driver.arm()
    bench.cycles(20, torque=0.05)
    assert bench.device.torque() == pytest.approx(0.05, abs=2e-3)


@pytest.mark.parametrize('torque', [3.0, -3.0])
def test_more_than_the_limit_is_cut(bench, torque):
    bench.device = type(bench.device)(replace(bench.device.settings, torque_limit=9.0,
                                              current_limit=99.0))
    bench.driver.arm()
    bench.cycles(20, torque=torque)
    assert bench.device.torque() == pytest.approx(math.copysign(0.1, torque), abs=2e-3)


@pytest.mark.parametrize('ask', [True, False])
def test_the_requests_of_a_period_can_be_left_out(bench, ask):
    bench.driver.arm()
    bench.cycles(5)
    lengths = []
    bench.to_drive = lambda data: lengths.append(len(data)) or data
    bench.driver.send_torque(0.0, ask)
    bench.driver.send_torque(0.0, False)
    assert (lengths[0] > lengths[1]) is ask


def test_a_motor_that_turns_feels_no_torque_while_it_is_armed(bench):
    bench.sense(velocity=60.0)
    torques = []
    bench.from_drive = lambda data: torques.append(bench.device.torque()) or data
    bench.driver.arm()
    bench.cycles(5, torque=0.0)
    bench.driver.stop()
    assert set(torques) == {0.0}


def test_arming_needs_no_handshake_and_no_settings_before_it(kind):
    bench = Bench(kind)
    bench.driver.arm()
    bench.cycles(1, torque=0.05)
    assert bench.device.torque() == pytest.approx(0.05, abs=2e-3)


@pytest.mark.parametrize('torque', [math.nan, math.inf, -math.inf])
def test_a_torque_that_is_not_finite_is_refused_and_not_sent(bench, torque):
    bench.driver.arm()
    bench.cycles(5, torque=0.02)
    sent = bench.driver.counts['sent']
    with refused('not_finite', 'torque', MessageError):
        bench.driver.send_torque(torque)
    assert bench.driver.counts['sent'] == sent


@pytest.mark.parametrize('ask', [False, True])
def test_without_commands_the_drive_disarms_by_itself_despite_requests(bench, ask):
    bench.driver.arm()
    bench.cycles(20, torque=0.05)
    for _ in range(150):
        bench.pass_time(0.001)
        if ask:
            bench.driver.poll()
            bench.driver.ask()
    assert bench.device.torque() == 0.0


def test_feeding_keeps_the_torque(bench):
    bench.driver.arm()
    bench.cycles(20, torque=0.05)
    for _ in range(300):
        bench.pass_time(0.001)
        bench.driver.feed()
        bench.driver.poll()
    assert bench.device.torque() == pytest.approx(0.05, abs=2e-3)


def test_a_stop_is_confirmed(bench):
    bench.driver.arm()
    bench.cycles(20, torque=0.05)
    bench.driver.stop()
    assert bench.device.torque() == 0.0
    assert bench.driver.telemetry.armed is False


def test_a_stop_begins_with_the_command_for_no_torque(bench):
    bench.driver.arm()
    bench.cycles(5, torque=0.05)
    kept = bench.sent()
    bench.driver.send_torque(0.0, ask=False)
    bench.driver.send_stop()
    assert kept[1].startswith(kept[0]) and len(kept[1]) > len(kept[0])


def test_a_stop_is_repeated_while_the_line_loses_it(bench):
    bench.driver.arm()
    bench.cycles(20, torque=0.05)
    lost = []
    deliver = bench.to_drive
    bench.to_drive = lambda data: lost.append(data) or b'' if len(lost) < 5 else deliver(data)
    bench.driver.stop()
    assert len(lost) == 5 and bench.device.torque() == 0.0


def test_an_unconfirmed_stop_is_an_error(bench):
    bench.driver.arm()
    bench.to_drive = lambda data: b''
    with refused('not_stopped', 'drive', DriveError):
        bench.driver.stop(timeout=0.2)


@pytest.mark.parametrize('call, reason', [
    ('identify', 'silent'), ('read_settings', 'silent'), ('arm', None), ('stop', 'not_stopped')])
def test_each_call_that_waits_gives_up_after_half_a_second(bench, call, reason):
    bench.cycles(3, None)
    for _ in range(3):  # until no reply is in transit
        bench.pass_time(0.002)
        bench.driver.poll()
    bench.to_drive = lambda data: b''
    begin = bench.now
    with pytest.raises(DriveError) as raised:
        getattr(bench.driver, call)()
    assert reason in (None, raised.value.reason)
    assert raised.value.reason in ('silent', 'not_armed', 'not_stopped')
    assert bench.now - begin == pytest.approx(0.5, abs=0.06)


@pytest.mark.parametrize('timeout', [0.04, 0.5])
def test_arming_after_lost_replies_takes_no_longer_than_its_timeout(bench, timeout):
    bench.to_drive = lambda data: b''
    bench.cycles(5, None)
    bench.pass_time(0.045)  # until a reply is overdue
    begin = bench.now
    with pytest.raises(DriveError) as raised:
        bench.driver.arm(timeout)
    assert raised.value.reason in ('silent', 'not_armed')
    assert bench.now - begin == pytest.approx(timeout, abs=0.03)


@pytest.mark.parametrize('kind', ['roboclaw', 'vesc', 'vesc_can'])
def test_a_stop_is_part_of_the_timeout_for_clearing_faults(bench):
    begin, stops = bench.now, []

    def lose_all_but_a_late_stop(data):
        if stops or bench.now < begin + 0.4:
            return b''
        stops.append(data)
        return data
    bench.to_drive = lose_all_but_a_late_stop
    with pytest.raises(DriveError) as raised:
        bench.driver.clear_faults(timeout=0.5)
    assert stops and raised.value.reason in ('silent', 'not_clearable')
    assert bench.now - begin == pytest.approx(0.5, abs=0.03)


@pytest.mark.parametrize('kind, fault', [
    ('roboclaw', 'DRIVER_FAULT'), ('vesc', 'ABS_OVER_CURRENT')])
def test_a_motor_with_a_fault_is_not_armed(kind, fault):
    bench = Bench(kind)
    bench.device.over_current()
    with refused('not_armed', 'drive', DriveError) as caught:
        bench.driver.arm()
    assert fault in str(caught.value)
    with refused('not_armed', 'drive', DriveError):
        bench.driver.send_torque(0.01)


def test_a_line_without_a_drive_is_silence(kind):
    bench = Bench(kind)
    bench.to_drive = lambda data: b''
    with refused('silent', error=DriveError):
        bench.driver.identify(timeout=0.2)
    assert bench.now < 0.5


def test_bytes_that_make_no_sense_are_distinguished_from_silence(kind):
    bench = Bench(kind)
    bench.from_drive = lambda data: bytes(0xAA ^ byte >> 1 for byte in data)
    with refused('garbled', error=DriveError):
        bench.driver.identify(timeout=0.2)


def test_valid_replies_that_come_too_late_are_distinguished_from_corrupted_ones(kind):
    bench = Bench(kind)
    bench._delay = 2.4 * bench.driver.options.reply_timeout
    with refused('late', 'drive', DriveError) as caught:
        bench.driver.identify(timeout=0.2)
    assert 'too late' in str(caught.value)
    bench.from_drive = lambda data: data[:-4] + b'1' + data[-3:]  # a wrong checksum
    with refused('garbled', 'drive', DriveError):
        bench.driver.identify(timeout=0.2)


@pytest.mark.parametrize('kind', [name for name in KINDS if 'can' not in name])
def test_corrupted_replies_after_the_handshake_are_distinguished_from_silence(kind):
    bench = Bench(kind)
    bench.driver.identify()

    def damage(data):
        middle = len(data) // 2
        return data[:middle] + bytes(byte ^ 1 for byte in data[middle:middle + 1]) \
            + data[middle + 1:]
    for bench.from_drive, reason in ((damage, 'garbled'), (lambda data: b'', 'silent')):
        with refused(reason, error=DriveError):
            bench.driver.read_settings(timeout=0.2)


def test_a_lost_reply_keeps_the_loop_going(bench):
    bench.driver.arm()
    deliver, count = bench.from_drive, iter(range(10**6))
    bench.from_drive = lambda data: b'' if next(count) % 3 == 0 else deliver(data)
    before = bench.now
    bench.cycles(500, torque=0.01)
    assert bench.now - before == pytest.approx(1.0)  # no wait in between
    assert bench.driver.counts['lost'] > 50
    assert bench.driver.telemetry.time > bench.now - 0.02


QUIET = {'odrive 0.5': {'status_period': 1.0}, 'odrive 0.6': {'status_period': 1.0},
         'odrive_can 0.5': {'status_period': 1.0}, 'odrive_can 0.6': {'status_period': 1.0},
         'roboclaw': {'status_period': 0.2}}


def hush(bench):
    """Suppress unrequested messages of the drive."""
    if bench.device.protocol == 'odrive_can':
        bench.device.properties[bench.device.heartbeat_rate] = 0


def test_every_write_every_byte_and_every_lost_reply_is_counted_once(kind):
    bench = Bench(kind, **QUIET.get(kind, {}))
    bench.driver.arm()
    hush(bench)
    bench.cycles(5)
    received, count = [], itertools.count()
    bench.from_drive = lambda data: received.append(
        b'' if next(count) % 10 == 3 else data) or received[-1]
    before = bench.driver.counts.copy()
    bench.cycles(100)
    bench.pass_time(0.002)
    bench.driver.poll()
    counts = bench.driver.counts
    assert counts['sent'] - before['sent'] == 100
    assert counts['bytes'] - before['bytes'] == pytest.approx(
        sum(map(len, received)), abs=max(40, *map(len, received)))
    bench.pass_time(0.1)
    bench.driver.poll()
    assert counts['lost'] - before['lost'] == 10
    answers = {'roboclaw': 2}.get(kind, 1)  # position and speed are separate
    assert counts['replies'] - before['replies'] == pytest.approx(90 * answers, abs=2 * answers)


def test_replies_of_a_dead_line_are_lost_once_and_its_first_one_counts_again(kind):
    bench = Bench(kind, **QUIET.get(kind, {}))
    bench.driver.arm()
    bench.cycles(5)
    bench.pass_time(0.002)
    bench.driver.poll()
    before = bench.driver.counts['lost']
    bench.from_drive = lambda data: b''
    bench.cycles(5)
    for _ in range(100):
        bench.pass_time(0.001)
        bench.driver.poll()
    assert bench.driver.counts['lost'] - before == 5
    bench.from_drive = lambda data: data
    bench.cycles(3)
    assert bench.driver.telemetry.time > bench.now - 0.004
    assert bench.driver.counts['lost'] - before == 5


VALUES_REQUEST = codec_of('vesc').frame(codec_of('vesc').get_values())


@pytest.mark.parametrize('kind, garbage, name, number', [
    ('odrive 0.5', b'1.000000 *7\r\n', 'refused', 1), ('odrive 0.5', b'hello\r\n', 'unchecked', 1),
    ('odrive 0.5', b'7*55\r\n', 'unexpected', 1),
    ('vesc', b'\x07' * 9 + VALUES_REQUEST, 'skipped', 9),
    ('vesc', codec_of('vesc').frame(b'\x63'), 'unexpected', 1),
    ('vesc', VALUES_REQUEST[:-2] + b'\x00\x03', 'refused', 1),
    ('roboclaw', b'\x07' * 40, 'skipped', 20)])
def test_bytes_outside_a_reply_are_counted(kind, garbage, name, number):
    bench = Bench(kind)
    bench.driver.arm()
    bench.cycles(5)
    bench.pass_time(0.002)
    bench.driver.poll()
    before = bench.driver.counts[name]
    bench.waiting.append((bench.now, garbage))
    bench.driver.poll()
    assert before + number <= bench.driver.counts[name] <= before + len(garbage)
    assert bench.driver.counts[name] == before + number or kind == 'roboclaw'


def test_baud_rates_are_such_as_ports_have(kind):
    protocol = kind.split()[0]
    rates = driver_class(protocol).baud_rates
    known = serial.Serial.BAUDRATES if line_of(protocol) is SERIAL else BIT_RATES
    assert set(rates) <= set(known) and len(set(rates)) == len(rates)


@pytest.mark.parametrize('protocol, option, values', [
    ('odrive', 'axis', (-1, 2)), ('odrive', 'status_period', (-0.1, 1.1)),
    ('roboclaw', 'axis', (-1, 2)), ('roboclaw', 'address', (0x7F, 0x88)),
    ('roboclaw', 'status_period', (-0.1, 0.3)), ('roboclaw', 'counts_per_turn', (3,)),
    ('roboclaw', 'torque_constant', (0.0,)), ('roboclaw', 'resistance', (0.0,)),
    ('roboclaw', 'speed_constant', (-0.1,)), ('vesc', 'torque_constant', (0.0,)),
    ('vesc', 'pole_pairs', (0,)), ('vesc', 'watchdog', (0.0, 10.1)),
    ('vesc', 'reply_timeout', (0.0, 10.1)), ('vesc', 'torque_limit', (0.0,))])
def test_an_option_out_of_range_is_refused(protocol, option, values):
    for value in values:
        with refused('out_of_range', option, ConfigurationError):
            Bench(protocol, **{option: value})


def test_no_torque_is_sent_before_arming_or_after_a_stop(bench):
    with refused('not_armed', 'drive', DriveError):
        bench.driver.send_torque(0.05)
    bench.driver.arm()
    bench.cycles(20, torque=0.05)
    bench.driver.stop()
    with refused('not_armed', 'drive', DriveError):
        bench.driver.send_torque(0.05)
    assert bench.device.torque() == 0.0


def test_position_velocity_and_health_are_reported(bench, kind):
    bench.sense(position=2.3, velocity=-45.0, bus_voltage=23.5, temperature=41.0)
    bench.driver.arm()
    telemetry = bench.cycles(400, torque=0.05)
    assert telemetry.position == pytest.approx(2.3, abs=2e-3)
    assert telemetry.velocity == pytest.approx(-45.0, rel=0.01)
    assert telemetry.bus_voltage == pytest.approx(23.5, abs=0.06)
    # An ODrive 0.5 does not report it over CAN.
    reported = kind != 'odrive_can 0.5'
    assert telemetry.temperature == (pytest.approx(41.0, abs=0.1) if reported else None)
    assert telemetry.current == pytest.approx(2.0, abs=0.1)
    assert telemetry.armed is True and telemetry.faults == ()


def test_the_position_goes_on_over_full_turns_although_replies_are_lost(bench):
    bench.driver.arm()
    start = bench.cycles(10).position
    bench.sense(position=1234.5)
    assert bench.cycles(10).position - start == pytest.approx(1234.5, abs=2e-3)
    bench.sense(position=-987.6)
    assert bench.cycles(10).position - start == pytest.approx(-987.6, abs=2e-3)


def test_a_fault_is_named_and_takes_the_power_off(bench):
    bench.driver.arm()
    bench.device.over_current()
    telemetry = bench.cycles(100, torque=0.05)
    assert telemetry.faults and telemetry.armed is False
    assert bench.device.torque() == 0.0


def test_the_budget_covers_what_really_goes_over_the_line(bench, kind):
    written, received = [], []
    bench.to_drive = lambda data: written.append(len(data)) or data
    bench.from_drive = lambda data: received.append(len(data)) or data
    bench.sense(position=-12345.6, velocity=-987.6)
    bench.driver.arm()
    written.clear()
    received.clear()
    bench.cycles(400, torque=-0.09)
    budget = bench.driver.budget()
    # Numbers as text may have fewer digits, and 0.6 gets one request at a time.
    # A heartbeat arrives without a request.
    spare = {'odrive 0.5': (10, 25), 'odrive 0.6': (40, 25), 'odrive_can 0.5': (0, 16),
             'odrive_can 0.6': (0, 16)}.get(kind, (0, 0))
    assert max(written) <= budget.bytes_out <= max(written) + spare[0]
    assert max(received) <= budget.bytes_in <= max(received) + spare[1]


def test_a_byte_takes_ten_bits_each_way():
    assert WireBudget(30, 18).duration(9600) == pytest.approx(0.05)
    assert WireBudget(30, 18).highest_rate(9600) == pytest.approx(20.0)


@pytest.mark.parametrize('voltage, temperature', [(0.0, -40.0), (1000.0, 1000.0)])
def test_a_drive_reports_at_the_ends_of_what_can_be_set(kind, voltage, temperature):
    bench = Bench(kind)
    bench.sense(bus_voltage=voltage, temperature=temperature)
    bench.driver.identify()
    assert bench.cycles(500, torque=None).bus_voltage == pytest.approx(voltage)
