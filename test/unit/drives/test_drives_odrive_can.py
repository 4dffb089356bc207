# SPDX-License-Identifier: Apache-2.0
"""CANSimple: golden frames, values of the heartbeat, and values that are not reported."""
from dataclasses import replace
import json
import math
import struct

from drive_bench import Bench
import pytest
from refusals import refused

from ballbot_ros.drives.can_frames import CanFrame, record, RecordParser
from ballbot_ros.drives.emulated_device import DriveSettings
from ballbot_ros.drives.odrive.cansimple import codec
from ballbot_ros.drives.odrive.cansimple.emulated import ODriveCanDevice
from ballbot_ros.drives.odrive.cansimple.settings import load_endpoints
from ballbot_ros.errors import ConfigurationError, DriveError

KINDS = ('odrive_can 0.5', 'odrive_can 0.6')
both = pytest.mark.parametrize('kind', KINDS)


def frames(data):
    """Return the frames of records."""
    return RecordParser().feed(data)


def commands(data):
    """Return the commands to node 0 in records."""
    return [frame.identifier & 0x1F for frame in frames(data)]


def without(command):
    """Return a function that removes a command from records in transit."""
    return lambda data: b''.join(
        record(frame) for frame in frames(data) if frame.identifier & 0x1F != command)


def test_the_frames_are_those_of_the_maker_s_examples():
    # can_simple.py of ODriveResources: state 8 as '<I' to node << 5 | 0x07, and so on.
    assert frames(codec.set_state(3, 8)) == [CanFrame(0x67, b'\x08\0\0\0')]
    assert frames(codec.torque(3, -0.5)) == [CanFrame(0x6E, b'\0\0\0\xbf')]
    assert frames(codec.set_mode(0, 1, 1)) == [CanFrame(0x0B, b'\x01\0\0\0\x01\0\0\0')]
    assert frames(codec.ask(3, codec.ENCODER_ESTIMATES)) == [CanFrame(0x69, remote=True)]
    assert frames(codec.read_endpoint(0, 0x1A2)) == [CanFrame(0x04, b'\0\xa2\x01\0')]
    reply = b'\0\xa2\x01\0' + struct.pack('<f', 1.234)
    assert codec.parse_endpoint(reply, 0x1A2, 'float') == pytest.approx(1.234)
    assert codec.parse_endpoint(reply, 0x1A3, 'float') is None
    beat = codec.parse_heartbeat(bytes.fromhex('0008000008000100'))
    assert beat == codec.Heartbeat(0x800, 8, 0, 1, 0)
    assert codec.parse_floats(struct.pack('<ff', 1.5, -2.0)) == (1.5, -2.0)
    assert codec.parse_floats(struct.pack('<ff', math.nan, 0.0)) is None
    assert codec.parse_floats(b'1234') is None and codec.parse_heartbeat(b'1234567') is None


@both
def test_a_motor_that_does_not_obey_the_stop_is_not_confirmed_by_its_heartbeats(kind):
    bench = Bench(kind)
    bench.driver.arm()
    bench.cycles(5, torque=0.05)
    bench.to_drive = without(codec.SET_AXIS_STATE)
    with refused('not_stopped', 'drive', DriveError):
        bench.driver.stop(timeout=0.3)
    assert bench.device.armed and bench.device.torque() == 0.0


@both
def test_a_heartbeat_from_before_the_stop_does_not_confirm_it(kind):
    bench = Bench(kind)
    bench.driver.identify()
    bench.cycles(10, torque=None)
    begin = bench.now
    bench.to_drive = lambda data: b''  # nothing is received; idle heartbeats continue
    bench.pass_time(0.001)
    bench.driver.send_stop()
    for _ in range(100):
        bench.pass_time(0.001)
        bench.driver.poll()
    assert bench.driver.telemetry.armed is False and bench.driver.telemetry.status_time > begin
    assert not bench.driver.stopped_since(begin + 0.001)


@both
def test_arming_needs_a_heartbeat_that_says_so(kind):
    bench = Bench(kind)
    bench.driver.identify()
    bench.device.properties[bench.device.heartbeat_rate] = 0
    with refused('not_armed', 'drive', DriveError):
        bench.driver.arm()
    with refused('not_armed', 'drive', DriveError):
        bench.driver.send_torque(0.01)


def test_an_encoder_that_is_not_ready_is_the_reason_why_it_does_not_arm():
    old, new = Bench(KINDS[0]), Bench(KINDS[1])
    old.device.properties['axis0.encoder.is_ready'] = 0
    new.device.properties['axis0.commutation_mapper.status'] = 6
    for bench, named in ((old, 'INVALID_STATE'), (new, 'NOT_CALIBRATED')):
        with refused('not_armed', 'drive', DriveError) as caught:
            bench.driver.arm()
        assert named in str(caught.value)


def test_to_a_0_5_each_frame_is_a_command_and_so_a_request_goes_with_no_torque():
    bench = Bench(KINDS[0])
    bench.driver.arm()
    bench.cycles(5, torque=0.05)
    # The quirk: requests alone keep the torque.
    for _ in range(300):
        bench.pass_time(0.001)
        bench.device.receive(codec.ask(0, codec.IQ), bench.now)
    assert bench.device.torque() == pytest.approx(0.05)
    sent = bench.sent()
    bench.driver.ask()
    assert commands(sent[0])[0] == codec.SET_INPUT_TORQUE and bench.device.torque() == 0.0


@pytest.mark.parametrize('watchdog, expires', [(0.1, True), (0.05, True), (0.0, False),
                                               (0.5, False)])
def test_the_watchdog_of_a_0_5_is_tried_despite_a_confirmation(watchdog, expires):
    bench = Bench(KINDS[0], DriveSettings(watchdog=watchdog))
    said = {**bench.driver.options.confirmed, 'axis0.config.enable_watchdog': 1,
            'axis0.config.watchdog_timeout': 0.1}
    bench.driver.options = replace(bench.driver.options, confirmed=said)
    settings = bench.settings()
    assert settings['watchdog'].acceptable
    tried = settings['watchdog, tried']
    assert tried.acceptable is expires and 'watchdog_timeout = 0.1' in tried.remedy
    if expires:
        took = float(tried.value.split()[-2])
        assert watchdog <= took <= watchdog + 0.02
    assert not bench.device.properties['axis0.error']  # the error is cleared
    assert bench.device.torque() == 0.0 and not bench.device.armed


def test_the_watchdog_is_not_tried_on_a_motor_under_power():
    bench = Bench(KINDS[0])
    bench.driver.arm()
    bench.cycles(3, torque=0.02)
    tried = bench.settings()['watchdog, tried']
    assert (tried.value, tried.acceptable) == ('not tried', False) and 'power' in tried.remedy


def test_a_setting_neither_reported_nor_confirmed_is_refused_by_name():
    bench = Bench(KINDS[0])
    confirmed = dict(bench.driver.options.confirmed)
    del confirmed['axis0.motor.config.torque_lim']
    bench.driver.options = replace(bench.driver.options, confirmed=confirmed)
    settings = bench.settings()
    limit, lacking = settings['torque limit'], settings['settings read or confirmed']
    assert (limit.value, limit.acceptable) == ('unknown', False)
    assert limit.remedy == 'odrv0.axis0.motor.config.torque_lim = 0.1'
    assert not lacking.acceptable and 'confirmed' in lacking.remedy
    assert lacking.value == 'all but axis0.motor.config.torque_lim'
    assert not settings['heartbeat'].remedy.startswith('w ')


def test_a_0_5_without_a_confirmed_version_is_refused():
    bench = Bench(KINDS[0], firmware='')
    assert bench.driver.identify().generation == '0.5'
    unnamed = bench.settings()['firmware']
    assert not unnamed.acceptable and 'firmware' in unnamed.remedy


@pytest.mark.parametrize('version', ['0.5', '0.5.2', '0.4.12', '0.6.11', '1.5.6', '0.5.x'])
def test_a_version_that_cannot_be_named_for_a_0_5_is_refused(version):
    with refused('out_of_range', 'firmware', ConfigurationError):
        Bench(KINDS[0], firmware=version)


@pytest.mark.parametrize('confirmed', [3, ['a'], {'a': 'b'}, {'a': math.nan}, {'a': None}])
def test_confirmed_settings_are_names_with_numbers(confirmed):
    with refused('wrong_type', 'confirmed', ConfigurationError):
        Bench(KINDS[0], confirmed=confirmed)


def test_without_the_list_of_its_endpoints_a_0_6_is_refused_with_where_to_get_it():
    bench = Bench(KINDS[1], endpoints='')
    lacking = bench.settings()['settings read or confirmed']
    assert not lacking.acceptable
    assert 'flat_endpoints.json' in lacking.remedy and '0.6.11' in lacking.remedy


def test_confirmed_settings_do_not_count_for_a_drive_that_reports_its_settings():
    old = Bench(KINDS[0])
    bench = Bench(KINDS[1], endpoints='', confirmed=old.driver.options.confirmed)
    assert not bench.settings()['torque limit'].acceptable


def test_a_list_of_another_firmware_is_refused(tmp_path):
    content = ODriveCanDevice(DriveSettings(firmware='0.6')).endpoints()
    path = tmp_path / 'flat_endpoints.json'
    path.write_text(json.dumps({**content, 'fw_version': '0.6.11-1'}))
    assert load_endpoints(str(path), (0, 6, 11))['axis0.config.watchdog_timeout'].kind == 'float'
    with refused('inconsistent', 'endpoints', ConfigurationError):
        load_endpoints(str(path), (0, 6, 10))
    bench = Bench(KINDS[1], endpoints=str(tmp_path / 'nowhere.json'))
    with refused('unreadable', 'endpoints', ConfigurationError):
        bench.driver.read_settings()
    for text in ('no json', '[]', '{"fw_version": "0.6.11"}', '{"endpoints": {"a": 1}}'):
        path.write_text(text)
        with refused('unreadable', 'endpoints', ConfigurationError):
            load_endpoints(str(path), (0, 6, 11))


@both
def test_a_heartbeat_that_comes_seldom_is_refused(kind):
    bench = Bench(kind)
    for milliseconds, acceptable in (
            (10, True), (20, True), (50, False), (100, False), (0, False)):
        bench.device.properties[bench.device.heartbeat_rate] = milliseconds
        bench.pass_time(0.2)
        found = bench.settings()['heartbeat']
        assert found.acceptable is acceptable, (milliseconds, found)
    assert 'rate_ms = 10' in found.remedy


@both
def test_a_drive_as_from_the_factory_is_refused_for_all_that_is_wrong(kind):
    bench = Bench(kind, DriveSettings(quirks=('factory',)), speed_limit=600.0)
    wrong = set(bench.refused())
    assert wrong >= {'torque limit', 'watchdog', 'heartbeat', 'velocity limit in torque mode',
                     'overspeed error', 'braking'}
    assert ('watchdog, tried' in wrong) is (kind == KINDS[0])


@both
def test_another_node_is_not_taken_for_ours_and_is_named(kind):
    bench = Bench(kind, node_id=5)
    with refused('silent', 'node_id', DriveError):
        bench.driver.identify(0.2)


@both
def test_errors_are_named_by_the_registers_of_the_firmware(kind):
    bench = Bench(kind)
    bench.driver.arm()
    bench.device.over_current()
    faults = bench.cycles(100, torque=0.02).faults
    assert any('CURRENT_LIMIT_VIOLATION' in name for name in faults), faults
    assert kind == KINDS[1] or faults[0] == 'MOTOR_FAILED'


def test_the_reason_of_a_0_6_stays_when_its_error_has_gone():
    bench = Bench(KINDS[1])
    bench.driver.arm()
    bench.device.over_current()
    bench.device.properties['axis0.active_errors'] = 0
    assert bench.cycles(100, torque=0.02).faults == ('CURRENT_LIMIT_VIOLATION',)


@both
def test_errors_are_cleared_without_power_and_only_then(kind):
    bench = Bench(kind)
    bench.driver.arm()
    with refused('not_clearable', 'motor', DriveError):
        bench.driver.clear_faults()
    bench.device.over_current()
    assert bench.cycles(100, torque=0.0).faults
    bench.driver.stop()
    assert bench.driver.clear_faults() == ()
    bench.device.over_current()
    bench.device.clear_errors = lambda: None  # the error recurs
    assert bench.driver.clear_faults()


@both
def test_an_encoder_that_failed_gives_no_position(kind):
    bench = Bench(kind)
    bench.driver.identify()
    bench.sense(position=3.0)
    before = bench.cycles(20, torque=None)
    assert before.position == pytest.approx(3.0)
    bench.device.trip('no_estimate')
    bench.cycles(20, torque=None)
    lost = bench.now
    bench.sense(position=0.0)
    after = bench.cycles(20, torque=None)
    assert after.time < lost and after.position == pytest.approx(3.0)


@both
def test_a_position_is_stamped_with_its_request_and_an_unrequested_one_is_not_a_measurement(kind):
    bench = Bench(kind)
    bench.driver.identify()
    bench.pass_time(0.1)
    bench.driver.poll()
    asked = bench.now
    bench.driver.ask()
    bench.pass_time(0.005)  # and is read with a delay
    assert bench.driver.poll().measured == pytest.approx(asked, abs=1e-9)
    bench.waiting.append((bench.now, codec.frame(
        0, codec.ENCODER_ESTIMATES, struct.pack('<ff', 0.5, 0.0))))
    telemetry = bench.driver.poll()
    assert telemetry.position == pytest.approx(math.pi)
    assert telemetry.measured is None and bench.driver.counts['unexpected'] == 1


@both
def test_numbers_that_are_none_are_no_telemetry(kind):
    bench = Bench(kind)
    bench.driver.identify()
    before = bench.cycles(20, torque=None)
    for command in (codec.ENCODER_ESTIMATES, codec.IQ, codec.BUS_VOLTAGE_CURRENT, 0x15):
        for data in (struct.pack('<ff', math.nan, 1.0), struct.pack('<ff', 1.0, math.inf), b'12'):
            bench.waiting.append((bench.now, codec.frame(0, command, data)))
    bench.driver.poll()
    assert bench.driver.telemetry._replace(time=0.0, measured=0.0, status_time=0.0) == \
        before._replace(time=0.0, measured=0.0, status_time=0.0)


@pytest.mark.parametrize('version', [(0, 7, 1), (1, 0, 0), (0, 4, 12)])
def test_an_unsupported_reported_version_is_refused(version):
    bench = Bench(KINDS[1])
    bench.device.firmware = replace(bench.device.firmware, version=version)
    with refused('firmware', 'firmware', DriveError) as caught:
        bench.driver.identify()
    assert '.'.join(map(str, version)) in str(caught.value)


def test_of_four_simultaneous_answers_a_0_5_loses_one():
    # odrive_can.cpp, send_message: three mailboxes.
    device = ODriveCanDevice(DriveSettings())
    device.receive(b'', 1.0)  # the heartbeat
    asked = b''.join(codec.ask(0, command) for command in (
        codec.ENCODER_ESTIMATES, codec.IQ, codec.BUS_VOLTAGE_CURRENT, codec.MOTOR_ERROR))
    assert len(frames(device.receive(asked, 1.005))) == 3


def test_the_torque_is_the_first_frame_of_a_stop_and_power_off_the_second():
    bench = Bench(KINDS[0])
    sent = bench.sent()
    bench.driver.send_stop()
    assert commands(sent[0])[:2] == [codec.SET_INPUT_TORQUE, codec.SET_AXIS_STATE]
    assert frames(sent[0])[0].data == bytes(4)


@both
def test_arming_is_not_refused_for_an_error_reported_before_it_was_cleared(kind):
    for share in range(100):  # of the time between two heartbeats
        bench = Bench(kind)
        bench.driver.identify()
        bench.pass_time(bench.device.settings.watchdog + 1.0 + 0.001 * share)
        bench.driver.arm()


@both
def test_positions_that_are_sent_cyclically_are_refused(kind):
    bench = Bench(kind)
    cyclic = codec.frame(0, codec.ENCODER_ESTIMATES, bytes(8))
    bench.from_drive = lambda data: data + cyclic * (len(data) > 0)
    found = bench.settings()['positions']
    assert not found.acceptable and 'encoder_' in found.remedy
    bench.from_drive = lambda data: data
    assert bench.settings()['positions'].acceptable
