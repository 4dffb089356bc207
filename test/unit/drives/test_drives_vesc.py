# SPDX-License-Identifier: Apache-2.0
"""VESCs: a current in place of a torque, positions of the settings, two position sources."""
import itertools
import math
import struct

from drive_bench import Bench
import pytest
from refusals import refused

from ballbot_ros.drives.emulated_device import DriveSettings
from ballbot_ros.drives.vesc.uart import codec
from ballbot_ros.errors import DriveError

VALUES = codec.Values(35.2, 30.1, -3.45, 1.25, -4210.0, 23.9, -123456, 0, 271.123456, 0)


@pytest.fixture
def bench():
    """Return a bench whose driver has armed the motor."""
    made = Bench('vesc')
    made.driver.arm()
    return made


def change(bench, message, alter):
    """Modify the payload of the replies to a message in transit."""
    def altered(data):
        payloads = codec.parser().feed(data)
        return b''.join(codec.frame(alter(payload) if payload[0] == message else payload)
                        for payload in payloads)
    bench.from_drive = altered


def reporting(bench, **fields):
    """Make the drive report other values."""
    change(bench, codec.GET_VALUES_SELECTIVE, lambda payload: codec.pack_values(
        codec.parse_values(payload)._replace(**fields)))


def slow(lost):
    """Return a bench where values take 48 ms and their ends 53 ms; the first replies are lost."""
    bench, count = Bench('vesc'), itertools.count()

    def late(data):
        if data[2] != codec.GET_VALUES_SELECTIVE:
            return data
        if next(count) >= lost:
            bench.waiting += [(bench.now + 0.048, data[:20]), (bench.now + 0.053, data[20:])]
        return b''
    bench.from_drive = late
    return bench


@pytest.mark.parametrize('lost', [0, 2])
def test_a_late_reply_that_is_cut_off_by_the_next_request_is_accepted_but_no_measurement(lost):
    bench = slow(lost)
    with refused('late', 'drive', DriveError):
        bench.driver.identify(timeout=0.4)
    assert bench.driver.telemetry.bus_voltage == 24.0 and bench.driver.telemetry.measured is None
    assert bench.driver.counts['skipped'] == 0


def test_a_reply_that_is_cut_off_by_the_deadline_is_late_and_not_corrupted():
    with refused('late', 'drive', DriveError):
        slow(2).driver.identify(timeout=0.153)


def test_messages_have_the_numbers_of_the_firmware():
    # COMM_PACKET_ID in datatypes.h
    assert (codec.FW_VERSION, codec.GET_VALUES, codec.SET_CURRENT, codec.GET_MCCONF,
            codec.GET_APPCONF, codec.ALIVE, codec.GET_VALUES_SELECTIVE) == (
                0, 4, 6, 14, 17, 30, 50)


def test_values_stand_where_the_firmware_puts_them():
    # COMM_GET_VALUES_SELECTIVE in comm/commands.c: the bits of the mask and how each is appended
    bits = (0, 1, 2, 3, 7, 8, 13, 15, 16, 21)
    assert codec.get_values() == struct.pack('>BI', 50, sum(2**bit for bit in bits))
    payload = struct.pack('>BIhhiiihiBiB', 50, sum(2**bit for bit in bits), 352, 301, -345, 125,
                          -4210, 239, -123456, 0, 271123456, 0)
    assert codec.parse_values(payload) == pytest.approx(VALUES)
    assert codec.pack_values(VALUES) == payload


@pytest.mark.parametrize('parse, message, length', [
    (codec.parse_values, 50, 33), (codec.parse_firmware, 0, 19)])
def test_a_reply_that_is_too_short_or_to_another_message_is_not_read(parse, message, length):
    payload = {50: codec.pack_values(VALUES), 0: bytes((0, 6, 2)) + b'abc\0' + bytes(12)}.get(
        message, bytes((message,)) + bytes(length - 1))
    assert len(payload) == length and parse(payload) is not None
    assert all(parse(payload[:end]) is None for end in range(length))
    assert parse(bytes((99,)) + payload[1:]) is None


def test_a_firmware_has_version_board_and_serial_number():
    payload = bytes((0, 6, 2)) + b'60_MK6\0' + bytes(range(12)) + b'\0\0'
    assert codec.parse_firmware(payload) == codec.Firmware(
        6, 2, '60_MK6', '000102030405060708090a0b')
    assert codec.parse_firmware(payload[:-1] + b'\7').test == 7


def test_faults_have_the_names_of_the_firmware():
    # mc_fault_code in datatypes.h
    for number, name in ((1, 'OVER_VOLTAGE'), (4, 'ABS_OVER_CURRENT'), (5, 'OVER_TEMP_FET'),
                         (33, 'ABS_OVERSPEED'), (34, 'FAULT_34'), (77, 'FAULT_77')):
        assert codec.fault_names(number) == (name,)
    assert codec.fault_names(0) == ()


def test_skipped_bytes_and_wrong_checksums_are_counted():
    parser, packet = codec.parser(), codec.frame(codec.get_values())
    assert parser.feed(b'\x07\x07' + packet + b'\x00' + packet[:-2] + b'\x00\x03' + packet) == [
        packet[2:-3]] * 2
    assert parser.counts == {'skipped': 3 + len(packet), 'refused': 1}


def test_a_drive_whose_timeout_expired_under_power_is_disarmed_and_says_why(bench):
    bench.cycles(20, torque=0.05)
    assert bench.driver.poll().armed is True
    bench.pass_time(0.2)
    bench.driver.ask()
    bench.pass_time(0.002)
    telemetry = bench.driver.poll()
    assert telemetry.armed is False and telemetry.faults == ('HAS_TIMEOUT',)
    assert bench.cycles(20, torque=0.05).armed is True  # it follows the next command


@pytest.mark.parametrize('part, confirmed', [(0.04, True), (-0.04, True), (0.06, False),
                                             (-0.06, False)])
def test_a_stop_is_confirmed_where_no_more_current_flows_than_the_sensors_may_err(
        bench, part, confirmed):
    reporting(bench, current=part * 4.0)  # as a fraction of the current at the torque limit
    if confirmed:
        bench.driver.stop()
    else:
        with refused('not_stopped', 'drive', DriveError):
            bench.driver.stop(timeout=0.1)


def test_values_that_were_asked_for_before_a_stop_do_not_confirm_it(bench):
    bench.cycles(20)
    bench.driver.ask()  # of a motor without current; the reply is in transit
    bench.pass_time(0.0005)
    bench.to_drive = lambda data: b''
    with refused('not_stopped', 'drive', DriveError):
        bench.driver.stop(timeout=0.1)


def test_unrequested_values_confirm_no_stop():
    bench = Bench('vesc')
    bench.waiting.append((0.0, codec.frame(codec.pack_values(VALUES._replace(current=0.0)))))
    assert bench.driver.poll().current is None
    assert not bench.driver.stopped_since(0.0)


def test_a_motor_without_encoder_has_the_position_of_its_commutation():
    bench = Bench('vesc', encoder=False)
    bench.driver.arm()
    start = bench.cycles(10).position
    for position in (0.5, 7.0, -40.0):
        bench.sense(position=position)
        assert bench.cycles(10).position - start == pytest.approx(position, abs=math.tau / 42)
    assert len({bench.cycles(1).position for bench.device.sensed in (
        bench.device.sensed._replace(position=0.01 * step) for step in range(15))}) <= 2


@pytest.mark.parametrize('pairs', [4, 7])
def test_the_speed_is_that_of_the_shaft_and_not_the_electrical_one(pairs):
    bench = Bench('vesc', DriveSettings(pole_pairs=pairs), pole_pairs=pairs)
    bench.driver.arm()
    bench.sense(velocity=90.0)
    assert bench.cycles(10).velocity == pytest.approx(90.0, rel=1e-3)


# The thread of the drive checks timeout and kill switch every 10 ms; timeout.c

@pytest.mark.parametrize('phase', range(10))
def test_arming_goes_on_until_the_drive_has_seen_that_it_is_fed_again(phase):
    bench = Bench('vesc')
    bench.pass_time(0.5 + 0.001 * phase)
    bench.driver.ask()
    bench.pass_time(0.001)
    assert bench.driver.poll().faults == ()  # before it is armed a timeout is expected
    begin = bench.now
    bench.driver.arm()
    assert bench.now - begin <= 0.014  # two checks, and the reply
    bench.driver.ask()
    bench.pass_time(0.001)
    assert bench.driver.poll().armed is True


def test_a_timeout_that_stays_although_it_is_fed_is_not_armed_over():
    bench = Bench('vesc')
    reporting(bench, status=codec.TIMED_OUT)
    begin = bench.now
    with refused('not_armed', 'watchdog', DriveError):
        bench.driver.arm(timeout=0.25)
    assert bench.now - begin < 0.3


def test_a_drive_that_does_not_report_is_not_armed(bench):
    bench.from_drive = lambda data: b''
    with refused('not_armed', 'drive', DriveError):
        bench.driver.arm(timeout=0.1)


@pytest.mark.parametrize('status, faults', [
    (0, ()), (codec.KILL_SWITCH, ('KILL_SW_ACTIVE',)),
    (codec.TIMED_OUT | codec.KILL_SWITCH, ('HAS_TIMEOUT', 'KILL_SW_ACTIVE'))])
def test_under_power_the_status_is_reported_by_its_names(bench, status, faults):
    reporting(bench, status=status)
    assert bench.cycles(2).faults == faults


def test_a_kill_switch_keeps_the_motor_from_being_armed_and_is_named():
    bench = Bench('vesc', DriveSettings(quirks=('kill_switch',)))
    bench.sense(stop_switch=1.0)
    bench.pass_time(0.02)
    with refused('not_armed', 'drive', DriveError):
        bench.driver.arm()
    assert bench.driver.telemetry.faults == ('KILL_SW_ACTIVE',)
    bench.sense(stop_switch=0.0)
    bench.pass_time(0.03)
    bench.driver.arm()
    assert bench.cycles(20, torque=0.05).faults == () and bench.device.torque() > 0.0


def test_faults_are_waited_for_as_nothing_clears_them_sooner(bench):
    bench.device.over_current()
    begin = bench.now
    assert bench.driver.clear_faults() == ()
    assert bench.now - begin == pytest.approx(0.5, abs=0.02)
    bench.sense(temperature=150.0)
    bench.pass_time(0.002)
    with refused('not_clearable', 'drive', DriveError) as caught:
        bench.driver.clear_faults(timeout=0.2)
    assert 'OVER_TEMP_FET' in str(caught.value)
    bench.from_drive = lambda data: b''
    with refused('not_stopped', 'drive', DriveError):
        bench.driver.clear_faults(timeout=0.2)


def test_the_current_of_the_supply_is_reported(bench):
    bench.sense(velocity=300.0)
    assert bench.cycles(20, torque=0.05).bus_current == pytest.approx(
        (0.05 * 300.0 + 3.125 * 2.0**2) / 24.0, abs=0.01)
    assert bench.cycles(20, torque=-0.05).bus_current < 0.0
