# SPDX-License-Identifier: Apache-2.0
"""ODrives of both generations: requests, checked answers, and required settings."""
import itertools
import math

from drive_bench import Bench
import pytest
from refusals import refused

from ballbot_ros.drives.emulated_device import DriveSettings
from ballbot_ros.drives.odrive.ascii import codec
from ballbot_ros.drives.odrive.ascii.driver import MARKER, Properties
from ballbot_ros.drives.odrive.firmware import (
    CLOSED_LOOP_CONTROL, GENERATION_5, GENERATION_6, GENERATIONS, hardware_name, IDLE, PASSTHROUGH,
    RESULT_6, TORQUE_CONTROL)
from ballbot_ros.errors import ConfigurationError, DriveError

KINDS = ('odrive 0.5', 'odrive 0.6')
both = pytest.mark.parametrize('kind', KINDS)

# From the list of endpoints that the maker generates for an ODrive with firmware 0.6.
ENDPOINTS_6 = {
    'vbus_voltage', 'serial_number', 'hw_version_major', 'hw_version_minor', 'hw_version_variant',
    'fw_version_major', 'fw_version_minor', 'fw_version_revision', 'test_property',
    'axis0.active_errors', 'axis0.disarm_reason', 'axis0.current_state', 'axis0.requested_state',
    'axis0.config.init_torque', 'axis0.config.watchdog_timeout', 'axis0.config.enable_watchdog',
    'axis0.config.torque_soft_min', 'axis0.config.torque_soft_max',
    'axis0.config.motor.motor_type', 'axis0.config.motor.torque_constant',
    'axis0.config.motor.current_soft_max', 'axis0.motor.foc.Iq_measured',
    'axis0.motor.fet_thermistor.temperature', 'axis0.motor.motor_thermistor.temperature',
    'axis0.controller.config.control_mode', 'axis0.controller.config.input_mode',
    'axis0.pos_vel_mapper.status', 'axis0.pos_vel_mapper.config.circular',
    'axis0.commutation_mapper.status', 'axis0.procedure_result', 'ibus',
    'axis0.motor.effective_current_lim', 'axis0.controller.config.vel_limit',
    'axis0.controller.config.vel_limit_tolerance', 'axis0.controller.config.vel_gain',
    'axis0.controller.config.enable_torque_mode_vel_limit',
    'axis0.controller.config.enable_overspeed_error', 'config.dc_max_negative_current',
    'config.max_regen_current', 'config.brake_resistor0.enable',
    'config.brake_resistor0.resistance'}


def asked_by(bench, act):
    """Return the names of the properties that the driver reads or writes in `act`."""
    lines = []
    deliver = bench.to_drive
    bench.to_drive = lambda data: lines.extend(data.decode().splitlines()) or deliver(data)
    act()
    bench.to_drive = deliver
    return {line.split()[1] for line in lines if line[:2] in ('r ', 'w ')}


def test_every_property_of_0_6_is_one_that_the_maker_lists():
    bench = Bench('odrive 0.6')

    def all_there_is():
        bench.driver.identify()
        bench.driver.read_settings()
        bench.driver.arm()
        bench.cycles(500)
        bench.device.properties['axis0.commutation_mapper.status'] = 3
        bench.driver.stop()
        with pytest.raises(DriveError):
            bench.driver.arm()
    assert asked_by(bench, all_there_is) == ENDPOINTS_6


# Frames of the maker's documents

def test_a_reply_of_the_documents_is_read_with_the_checksum_that_belongs_to_it():
    # "r vbus_voltage" => 24.087744, from the page on the ASCII protocol; 33 from issue 596.
    text = b'24.087744'
    assert codec.LineParser().feed(b'%s*%d\r\n' % (text, codec.checksum(text))) == [text.decode()]
    assert codec.parse_number('24.087744') == 24.087744
    assert codec.checksum(b'48.065918') == 33


def test_a_marker_is_written_to_and_read_from_a_property_that_does_nothing():
    lines = codec.marker(0x20000000).split(b'\n')
    assert lines[0] == b'*999'  # a wrong checksum: "the line is ignored"
    assert lines[1].startswith(b'w test_property 536870912 *')
    assert lines[2].startswith(b'r test_property *') and lines[3] == b''
    # An error could equal a marker only with a bit that neither generation has.
    for number in (codec.MARKERS[0], codec.MARKERS[-1]):
        assert len(str(number)) <= 9
        assert all('0x20000000' in generation.axis.names_of(number & 0x20000000)
                   for generation in GENERATIONS)


@both
def test_half_a_line_left_in_the_buffer_is_not_obeyed(kind):
    bench = Bench(kind)
    bench.device.receive(b'w axis0.requested_state 8', 0.0)
    bench.driver.identify()
    assert not bench.device.armed


@pytest.mark.parametrize('generation, names', [
    (GENERATION_5, {0x1: 'INVALID_STATE', 0x40: 'MOTOR_FAILED', 0x100: 'ENCODER_FAILED',
                    0x200: 'CONTROLLER_FAILED', 0x800: 'WATCHDOG_TIMER_EXPIRED',
                    0x80000: 'UNKNOWN_POSITION'}),
    (GENERATION_6, {0x1: 'INITIALIZING', 0x2: 'SYSTEM_LEVEL', 0x4: 'TIMING_ERROR',
                    0x8: 'MISSING_ESTIMATE', 0x40: 'MISSING_INPUT', 0x100: 'DC_BUS_OVER_VOLTAGE',
                    0x1000000: 'WATCHDOG_TIMER_EXPIRED', 0x40000000: 'CALIBRATION_ERROR'})])
def test_errors_that_decide_something_have_the_bits_of_the_maker(generation, names):
    assert {bit: generation.axis.names.get(bit) for bit in names} == names


def test_states_modes_and_results_have_the_numbers_of_the_maker():
    assert (IDLE, CLOSED_LOOP_CONTROL, TORQUE_CONTROL, PASSTHROUGH) == (
        1, 8, 1, 1)
    results = RESULT_6.names
    assert (results[0], results[3], results[13], results[14], len(results)) == (
        'SUCCESS', 'DISARMED', 'INVALID_STATE', 'NOT_CALIBRATED', 17)


@pytest.mark.parametrize('kind, setting, path, value, name, acceptable', [
    *(('odrive 0.6', 'input mode', 'axis0.controller.config.input_mode', mode, name, mode == 1)
      for mode, name in enumerate((
          'inactive', 'pass through', 'velocity ramp', 'position filter', 'mix channels',
          'trapezoidal trajectory', 'torque ramp', 'mirror', 'tuning'))),
    *(('odrive 0.5', 'motor', 'axis0.motor.config.motor_type', value, name, value == 0)
      for value, name in ((0, 'by current'), (2, 'by voltage'), (3, 'induction')))])
def test_input_modes_and_motor_types_have_the_names_of_the_maker(
        kind, setting, path, value, name, acceptable):
    bench = Bench(kind)
    bench.device.properties[path] = value
    found = bench.settings()[setting]
    assert (found.value, found.acceptable) == (f'{value} ({name})', acceptable)


# Requests for properties

def asked(properties, now=0.0):
    """Return the bytes that request a property."""
    return properties.ask('state', 'axis0.current_state', now)


def test_one_property_is_asked_for_at_a_time_and_its_answer_is_known():
    properties = Properties(timeout=0.05)
    assert properties.free and properties.requested_at == -math.inf
    assert asked(properties, 1.0) == codec.read('axis0.current_state')
    assert (properties.requested, properties.requested_at) == ('state', 1.0)
    assert not properties.free
    assert asked(properties, 1.01) == b'' and properties.requested_at == 1.0
    assert properties.take('8') == 'state' and properties.value == 8.0 and properties.free
    asked(properties)
    assert properties.take('invalid property') == 'state' and properties.value is None


def test_an_unrequested_value_is_ignored_until_a_marker_comes_back():
    properties = Properties(timeout=0.05)
    assert properties.take('some text') is None and properties.in_sync
    assert properties.take('7') is None and not properties.in_sync
    marker = asked(properties)
    assert marker == codec.marker(codec.MARKERS[0] + 1) and properties.requested is None
    assert properties.take('8') is None and not properties.free
    assert asked(properties, 0.05) == b''
    assert properties.take(str(codec.MARKERS[0] + 1)) == MARKER and properties.free


def test_an_answer_is_overdue_after_the_timeout_and_then_too_late():
    properties = Properties(timeout=0.0625)
    asked(properties, 1.0)
    properties.drop_overdue(1.0625)
    assert properties.in_sync and properties.requested == 'state'
    properties.drop_overdue(1.063)
    assert not properties.in_sync
    assert properties.take('8') is None and properties.value is None


def test_each_marker_is_another_number_and_only_the_last_one_counts():
    properties = Properties(timeout=0.05)
    properties.lose_sync()
    sent = [asked(properties, 0.1 * number) for number in range(len(codec.MARKERS) + 1)]
    assert set(sent) == {codec.marker(number) for number in codec.MARKERS}
    assert all(before != after for before, after in zip(sent, sent[1:]))
    last = int(sent[-1].split(b'test_property ')[1].split()[0])
    assert properties.take(str(last - 1)) is None and not properties.in_sync
    assert properties.take(str(last)) == MARKER


# Identity

@pytest.mark.parametrize('kind, words', [
    ('odrive 0.5', 'odrive v3.6-56V 208F3387304B, firmware 0.5.6, generation 0.5'),
    ('odrive 0.6', 'odrive S1 (5.2.0), firmware 0.6.11, generation 0.6')])
def test_board_firmware_and_generation_are_reported(kind, words):
    assert Bench(kind).driver.identify().in_words == words


def test_a_serial_number_that_comes_whole_is_reported_as_printed_on_the_board(monkeypatch):
    monkeypatch.setattr('ballbot_ros.drives.odrive.ascii.emulated.VALUE_LENGTH_MAX', 20)
    assert Bench('odrive 0.6').driver.identify().serial_number == '208F3387304B'


@both
def test_a_handshake_on_a_good_line_takes_few_markers_and_is_made_once(kind):
    bench = Bench(kind)
    kept = bench.sent()
    bench.driver.identify()
    bench.driver.read_settings()
    bench.driver.arm()
    bench.cycles(50)
    bench.driver.stop()
    stream = b''.join(kept)
    # 0.6 loses lines of its answer to "i", so that the next one must be made sure of.
    assert stream.count(b'*999\n') == {'odrive 0.5': 1, 'odrive 0.6': 2}[kind]
    assert stream.count(b'r fw_version_major ') == 1
    assert bench.driver.counts['lost'] == bench.driver.counts['unexpected'] == 0


@both
def test_a_serial_number_that_got_lost_takes_nothing_else_with_it(kind):
    bench = Bench(kind)
    bench.from_drive = lambda data: b'' if data.startswith(b'Hardware') else data
    assert bench.driver.identify().serial_number == ''
    assert not bench.refused()


def test_a_drive_that_answers_without_checksums_is_of_another_protocol():
    bench = Bench('odrive 0.5')
    bench.from_drive = lambda data: b'unknown command\r\n' if data else b''
    with refused('wrong_protocol', error=DriveError):
        bench.driver.identify()


def test_commands_name_the_motor_output_in_use():
    bench = Bench('odrive 0.5', axis=1)
    bench.driver.identify()
    kept = bench.sent()
    with refused('not_armed', 'axis1.controller.config.control_mode', DriveError):
        bench.driver.arm()
    bench.driver.feed()
    bench.driver.ask()
    bench.driver.send_stop()
    lines = b''.join(kept).splitlines()
    assert {line[:3] for line in lines if line[:1] in b'cfu'} == {b'c 1', b'f 1', b'u 1'}
    assert b'axis0' not in b''.join(kept)


def test_boards_have_the_names_of_their_maker():
    assert [hardware_name(major, 4, 58) for major in (3, 4, 5, 6, 7)] == [
        'v3.4-58V', 'Pro (4.4.58)', 'S1 (5.4.58)', 'Micro (6.4.58)', 'board (7.4.58)']


@pytest.mark.parametrize('version', [
    (0, 4, 12), (0, 5, 1), (0, 5, 3), (0, 7, 0), (1, 5, 0), (1, 6, 0)])
def test_a_firmware_that_is_not_supported_is_refused_and_named(version):
    bench = Bench('odrive 0.5')
    bench.device.properties.update(zip(
        ('fw_version_major', 'fw_version_minor', 'fw_version_revision'), version))
    with refused('firmware', 'firmware', DriveError) as caught:
        bench.driver.identify()
    assert '.'.join(map(str, version)) in str(caught.value)


def test_a_drive_that_does_not_report_its_firmware_is_refused():
    bench = Bench('odrive 0.6')
    del bench.device.properties['fw_version_minor']
    with refused('firmware', 'firmware', DriveError):
        bench.driver.identify()


def test_a_second_axis_is_refused_where_there_is_none():
    with refused('firmware', 'axis', DriveError):
        Bench('odrive 0.6', axis=1).driver.identify()
    assert Bench('odrive 0.5', axis=1).driver.identify().generation == '0.5'


def test_an_emulated_drive_of_another_firmware_is_refused():
    for kind in ('odrive 0.7', 'roboclaw 5'):
        with refused('not_a_choice', 'firmware', ConfigurationError):
            Bench(kind)


# Required settings

WRONG = {
    'odrive 0.5': [
        ('torque limit', {'axis0.motor.config.torque_lim': 0.3,
                          'axis0.motor.config.current_lim': 50.0}),
        ('torque limit', {'axis0.motor.config.torque_lim': math.inf,
                          'axis0.motor.config.current_lim': math.inf}),
        ('input mode', {'axis0.controller.config.input_mode': 6}),
        ('motor', {'axis0.motor.config.motor_type': 2})],
    'odrive 0.6': [
        ('torque limit', {'axis0.config.torque_soft_max': 0.3,
                          'axis0.config.motor.current_soft_max': 50.0}),
        ('torque limit', {'axis0.config.torque_soft_min': -math.inf,
                          'axis0.config.motor.current_soft_max': math.inf}),
        ('input mode', {'axis0.controller.config.input_mode': 6}),
        ('motor', {'axis0.config.motor.motor_type': 2}),
        ('position', {'axis0.pos_vel_mapper.config.circular': 1}),
        ('torque at arming', {'axis0.config.init_torque': 0.05})]}
BOTH_WRONG = [
    ('watchdog', {'axis0.config.enable_watchdog': 0}),
    ('watchdog', {'axis0.config.watchdog_timeout': 0.5}),
    ('watchdog', {'axis0.config.watchdog_timeout': 0.0})]


@pytest.mark.parametrize('kind, name, changes', [
    (kind, *case) for kind in KINDS for case in (*WRONG[kind], *BOTH_WRONG)])
def test_a_setting_that_is_not_safe_is_refused_and_set_right_by_its_remedy(kind, name, changes):
    bench = Bench(kind)
    bench.device.properties.update(changes)
    wrong, = bench.refused().values()
    assert wrong.name == name
    for line in wrong.remedy.split(', '):  # typed lines have no checksums
        bench.device.receive(f'{line}\n'.encode(), bench.now)
    assert not bench.refused()


@pytest.mark.parametrize('kind, name, changes, reported', [
    ('odrive 0.5', 'encoder', {'axis0.encoder.is_ready': 0}, '0 (not ready)'),
    ('odrive 0.6', 'encoder', {'axis0.pos_vel_mapper.status': 1}, '1 (NO_RESPONSE)'),
    ('odrive 0.6', 'encoder', {'axis0.pos_vel_mapper.status': 99}, '99'),
    ('odrive 0.6', 'commutation', {'axis0.commutation_mapper.status': 6},
     '6 (PHASES_NOT_CALIBRATED)')])
def test_an_encoder_that_is_not_ready_is_refused_and_its_state_is_named(
        kind, name, changes, reported):
    bench = Bench(kind)
    bench.device.properties.update(changes)
    wrong, = bench.refused().values()
    assert (wrong.name, wrong.value) == (name, reported)
    assert 'w axis0.requested_state 3 ' in wrong.remedy


@pytest.mark.parametrize('kind, property_name', [
    (kind, name) for kind, generation in zip(KINDS, GENERATIONS) for name in (
        *generation.torque_limits, generation.current_limit, generation.torque_constant,
        'axis0.config.enable_watchdog', 'axis0.config.watchdog_timeout',
        *(rule.name for rule in generation.rules))])
def test_a_property_that_the_drive_does_not_have_is_refused(kind, property_name):
    bench = Bench(kind)
    bench.to_drive = lambda data: data.replace(codec.read(property_name), codec.read('blahblah'))
    wrong, = bench.refused().values()
    assert wrong.value in ('unknown', 'off')


def test_the_remedy_is_for_the_axis_in_use():
    settings = Bench('odrive 0.5', axis=1).settings()
    assert settings['input mode'].remedy == 'w axis1.controller.config.input_mode 1'
    assert all('axis0' not in item.remedy for item in settings.values())


@pytest.mark.parametrize('constant', [-0.025, math.inf])
@both
def test_a_torque_constant_that_bounds_nothing_is_not_a_limit(kind, constant):
    bench = Bench(kind)
    generation = GENERATIONS[KINDS.index(kind)]
    bench.device.properties.update({
        generation.torque_constant: constant, **dict.fromkeys(generation.torque_limits, 5.0)})
    assert 'torque limit' in bench.refused()


# Arming

@both
def test_arming_leaves_the_drive_in_torque_control_at_zero(kind):
    bench = Bench(kind)
    bench.device.properties['axis0.controller.config.control_mode'] = 3
    bench.driver.arm()
    assert bench.device.properties['axis0.controller.config.control_mode'] == 1
    assert bench.device.armed and bench.device.torque() == 0.0


@both
def test_a_drive_that_does_not_report_its_errors_is_not_armed(kind):
    bench = Bench(kind)
    generation = GENERATIONS[KINDS.index(kind)]
    bench.driver.identify()
    bench.to_drive = lambda data: data.replace(
        codec.read(generation.errors), codec.read('blahblah'))
    with refused('not_armed', generation.errors, DriveError):
        bench.driver.arm()
    assert not bench.device.armed


def test_a_drive_that_does_not_enter_torque_control_is_not_armed():
    bench = Bench('odrive 0.6')
    bench.driver.identify()
    bench.to_drive = lambda data: b'' if b'control_mode 1' in data else data
    with refused('not_armed', 'axis0.controller.config.control_mode', DriveError):
        bench.driver.arm()


@pytest.mark.parametrize('kind, changes, reported', [
    ('odrive 0.5', {'axis0.encoder.is_ready': 0}, 'INVALID_STATE'),
    ('odrive 0.6', {'axis0.commutation_mapper.status': 6}, 'NOT_CALIBRATED')])
def test_a_drive_that_cannot_be_armed_says_why(kind, changes, reported):
    bench = Bench(kind)
    bench.driver.identify()
    bench.device.properties.update(changes)
    begin = bench.now
    with refused('not_armed', 'drive', DriveError) as caught:
        bench.driver.arm(timeout=0.2)
    assert reported in str(caught.value)
    # 0.5 reports an error immediately; 0.6 may still arm.
    assert bench.now - begin < 0.2 and (bench.now - begin > 0.1) is (kind == 'odrive 0.6')


@pytest.mark.parametrize('changes, reported', [
    ({'axis0.procedure_result': 13}, ['INVALID_STATE']),
    ({'axis0.procedure_result': 13, 'axis0.disarm_reason': 0x2000}, [
        'INVALID_STATE', 'MOTOR_OVER_TEMP']),
    ({'axis0.procedure_result': 99}, ['99'])])
def test_a_drive_that_stays_disarmed_names_result_and_reason(changes, reported):
    bench = Bench('odrive 0.6')
    bench.driver.identify()
    bench.to_drive = lambda data: b'' if b'requested_state 8' in data else data
    clear = bench.device.receive

    def receive(data, now):
        reply = clear(data, now)
        if b'sc' in data:
            bench.device.properties.update(changes)
        return reply
    bench.device.receive = receive
    with refused('not_armed', 'drive', DriveError) as caught:
        bench.driver.arm()
    assert all(name in str(caught.value) for name in reported)


@pytest.mark.parametrize('result, bits, reported', [
    (math.nan, math.nan, ()), (math.nan, 1.0, ('INITIALIZING',)), (0.0, 0.0, ()),
    (3.0, 0.0, ()),  # being disarmed is not a reason
    (2.0, 0.0, ('CANCELLED',)), (99.0, 2.0, ('SYSTEM_LEVEL', '99'))])
def test_faults_are_made_of_what_the_drive_reports(result, bits, reported):
    values = {'axis0.current_state': 1.0, 'axis0.disarm_reason': bits,
              'axis0.procedure_result': result}
    assert GENERATION_6.faults(values, ours=True) == reported


@both
def test_a_motor_that_lost_its_power_is_seen_to_be_disarmed_though_no_fault_is_named(kind):
    bench = Bench(kind)
    bench.driver.arm()
    assert bench.cycles(100, torque=0.05).armed is True
    bench.device.properties['axis0.requested_state'] = IDLE  # by another program
    telemetry = bench.cycles(100, torque=0.05)
    assert telemetry.armed is False and telemetry.faults == ()


def test_a_drive_that_takes_its_time_to_arm_is_waited_for_without_torque():
    bench, kept, late = Bench('odrive 0.5'), [], []
    bench.driver.identify()
    begin = bench.now

    def slow(data):
        kept.append(data)
        if b'requested_state 8' in data and not late:
            late.append(data)
            return b''
        return late[0] + data if late and bench.now - begin > 0.2 else data
    bench.to_drive = slow
    bench.driver.arm()
    assert 0.2 < bench.now - begin < 0.3 and bench.device.armed
    torques = [data.split()[2] for data in kept if data.startswith(b'c 0')]
    assert len(torques) > 20 and set(torques) == {b'0.000000000e4'}


# Replies

@pytest.mark.parametrize('period, least, most', [(0.02, 45, 51), (0.1, 9, 11)])
@both
def test_one_property_is_asked_for_in_each_status_period(kind, period, least, most):
    bench = Bench(kind, status_period=period)
    bench.driver.arm()
    bench.cycles(60)
    kept = bench.sent()
    bench.cycles(500)
    names = [line.split()[1] for data in kept for line in data.splitlines() if line[:1] == b'r']
    assert least <= len(names) <= most
    errors = GENERATIONS[KINDS.index(kind)].errors.encode()
    for name in (errors, b'axis0.current_state'):  # each is every third request
        assert names.count(name) == pytest.approx(len(names) / 3, abs=2)


def test_0_6_loses_a_reply_that_comes_while_another_is_being_sent():
    bench = Bench('odrive 0.6')
    reply = bench.device.receive(b'f 0\nr vbus_voltage\n', 0.0)
    assert reply == b'0.000000 0.000000\r\n'
    assert bench.device.receive(b'r vbus_voltage\n', 0.01) == b'24.000000\r\n'


def loop(bench, periods, wait):
    """Run periods of 2 ms; if `wait`, wait in the first millisecond for the answer."""
    times = []
    for _ in range(periods):
        bench.pass_time(0.001)
        bench.driver.poll()
        bench.driver.send_torque(0.01)
        bench.pass_time(0.001)
        times.append((bench.driver.poll() if wait else bench.driver.telemetry).time)
    return times


@pytest.mark.parametrize('wait', [True, False])
def test_no_reply_of_0_6_is_lost_by_asking_too_early(wait):
    bench = Bench('odrive 0.6')
    bench.driver.arm()
    loop(bench, 500, wait)
    assert bench.driver.counts['lost'] == 0
    assert bench.driver.telemetry.faults == () and bench.driver.telemetry.bus_voltage == 24.0


def test_every_period_of_0_6_brings_the_position_to_a_loop_that_waits_for_it():
    bench = Bench('odrive 0.6')
    bench.driver.arm()
    times = loop(bench, 500, wait=True)
    assert len(set(times)) == 500


def test_a_loop_that_does_not_wait_goes_without_it_where_a_property_is_asked_for():
    bench = Bench('odrive 0.6')
    bench.driver.arm()
    times = loop(bench, 500, wait=False)[2:]
    assert len(set(times)) > 430
    assert max(after - before for before, after in zip(times, times[1:])) < 0.0045


def test_a_property_that_still_waits_for_its_turn_is_not_taken_for_a_setting():
    bench = Bench('odrive 0.6', DriveSettings(current_limit=9.0))
    bench.driver.identify()
    for _ in range(10):
        bench.driver.arm()
        bench.cycles(1)  # a position is in transit
        bench.driver.send_stop()  # the state is requested after the position has arrived
        limit, watchdog, *_ = bench.driver.read_settings()
        assert (limit.value, watchdog.value) == ('0.1 N m', '0.1 s')


def test_a_stop_of_0_6_is_confirmed_although_a_position_is_under_way():
    bench = Bench('odrive 0.6')
    bench.driver.arm()
    bench.cycles(7, torque=0.01)
    begin = bench.now
    bench.driver.stop()
    assert bench.now - begin < 0.01


@both
def test_the_cause_of_a_loss_of_power_is_named_afterwards(kind):
    bench = Bench(kind)
    bench.driver.arm()
    bench.cycles(50, torque=0.05)
    bench.pass_time(0.2)  # the watchdog expires
    if kind == 'odrive 0.6':
        bench.device.properties['axis0.active_errors'] = 0  # it may be cleared without a request
    telemetry = bench.cycles(200, torque=0.05)
    assert telemetry.faults == ('WATCHDOG_TIMER_EXPIRED',) and telemetry.armed is False


def test_an_old_reason_is_not_a_fault_of_a_motor_under_power():
    bench = Bench('odrive 0.6')
    bench.driver.arm()
    bench.device.properties['axis0.disarm_reason'] = 0x1000000
    telemetry = bench.cycles(300, torque=0.05)
    assert telemetry.armed is True and telemetry.faults == ()


@both
def test_an_estimate_that_is_missing_is_not_taken_for_a_position(kind):
    bench = Bench(kind)
    bench.driver.arm()
    bench.sense(position=2.0)
    bench.cycles(50)
    bench.device.trip('no_estimate')
    bench.cycles(50)
    last = bench.driver.telemetry
    bench.sense(position=0.0)
    assert bench.cycles(50)[:3] == last[:3] and last.position == pytest.approx(2.0, abs=1e-4)


def test_an_estimate_that_was_missing_once_does_not_hide_the_position_for_good():
    bench = Bench('odrive 0.6')
    bench.driver.arm()
    bench.device.trip('no_estimate')
    bench.cycles(100)
    bench.device.properties['axis0.active_errors'] = 0  # the reason stays
    before = bench.now
    assert bench.cycles(100).time > before


@both
def test_a_value_that_is_not_a_number_is_not_put_into_the_telemetry(kind):
    bench = Bench(kind)
    bench.driver.arm()
    bench.sense(motor_temperature=math.nan)
    telemetry = bench.cycles(400, torque=0.01)
    assert telemetry.motor_temperature is None and telemetry.temperature == 35.0
    assert bench.driver.counts['lost'] == 0


@both
def test_a_lost_value_is_counted_once(kind):
    bench, lost = Bench(kind), iter(range(3))
    bench.driver.arm()
    bench.cycles(50)
    bench.to_drive = lambda data: data.partition(b'r vbus')[0] \
        if b'r vbus' in data and next(lost, None) is not None else data
    bench.cycles(1000)
    assert next(lost, None) is None and bench.driver.counts['lost'] == 3


@both
def test_a_late_value_is_not_taken_for_another_property(kind):
    # A line that stalls repeatedly: values arrive long after the next request.
    bench = Bench(kind, status_period=0.0, reply_timeout=0.01)
    bench.driver.arm()
    held, count = [], itertools.count()

    def stalling(reply):
        """Delay replies for eight periods of twenty, and keep their order."""
        held.append(reply)
        if next(count) % 20 < 8:
            return b''
        released = b''.join(held)
        held.clear()
        return released
    bench.from_drive = stalling
    seen = set()
    for _ in range(2000):
        telemetry = bench.cycles(1, torque=0.01)
        seen.add((telemetry.bus_voltage, telemetry.temperature, telemetry.faults))
    assert (24.0, 35.0, ()) in seen
    assert {value for reported in seen for value in reported} == {None, 24.0, 35.0, ()}
    assert {reported[0] for reported in seen} == {None, 24.0}
    assert bench.driver.counts['lost'] > 50
