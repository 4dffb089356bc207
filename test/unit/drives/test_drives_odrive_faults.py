# SPDX-License-Identifier: Apache-2.0
"""Errors that an ODrive reports when it removes motor power, and their clearing."""
from drive_bench import Bench
import pytest
from refusals import refused

from ballbot_ros.drives.emulated_device import DriveSettings
from ballbot_ros.drives.odrive.ascii.driver import DriveStatus
from ballbot_ros.drives.odrive.firmware import (
    AXIS_5, AXIS_6, CONTROLLER_5, ENCODER_5, GENERATION_5, GENERATION_6, MOTOR_5, RESULT_6,
    SENSORLESS_5, STATE, SYSTEM_5)
from ballbot_ros.errors import DriveError

both = pytest.mark.parametrize('kind', ('odrive 0.5', 'odrive 0.6'))
REGISTERS = (AXIS_5, MOTOR_5, ENCODER_5, CONTROLLER_5, SENSORLESS_5, SYSTEM_5, AXIS_6)


def armed(kind, *quirks, **settings):
    """Return a bench whose motor has power and has reported its state."""
    bench = Bench(kind, DriveSettings(quirks=quirks, **settings), status_period=0.0)
    bench.driver.arm()
    bench.cycles(20)
    return bench


def until_disarmed(bench, cycles=200):
    """Run periods until the first report; return all reports from there on."""
    reports = []
    for _ in range(cycles):
        telemetry = bench.cycles(1)
        if telemetry.armed is False or telemetry.faults:
            reports.append((telemetry.armed, telemetry.faults))
    return reports


# Names

@pytest.mark.parametrize('register', REGISTERS, ids=lambda item: item.path)
def test_every_bit_of_every_register_is_named_also_where_the_drive_cuts_the_number(register):
    for bit, name in register.names.items():
        assert bit > 0 and bit & bit - 1 == 0
        # The drive sends nine characters of a value.
        assert register.names_of(float(str(bit)[:9])) == (register.prefix + name,)
    assert register.names_of(0) == ()


@pytest.mark.parametrize('register, number, names', [
    # motor.cpp of 0.5.4: no torque, hence no voltage; 4563402752 in full.
    (MOTOR_5, 456340275, ('MOTOR_ERROR_UNKNOWN_TORQUE', 'MOTOR_ERROR_UNKNOWN_VOLTAGE_COMMAND')),
    (MOTOR_5, 0x1040, ('MOTOR_ERROR_CURRENT_LIMIT_VIOLATION', 'MOTOR_ERROR_0x40')),
    (AXIS_6, 0x20000001, ('INITIALIZING', '0x20000000')),
    (RESULT_6, 14, ('NOT_CALIBRATED',)), (RESULT_6, 99, ('99',))])
def test_a_number_is_named_by_its_bits_or_as_it_is(register, number, names):
    assert register.names_of(number) == names


@pytest.mark.parametrize('prefix, number, name', [
    ('MOTOR_ERROR_', 0x400, 'CURRENT_SENSE_SATURATION'), ('MOTOR_ERROR_', 0x8, 'DRV_FAULT'),
    ('MOTOR_ERROR_', 0x1000, 'CURRENT_LIMIT_VIOLATION'),
    ('MOTOR_ERROR_', 0x1000000, 'SYSTEM_LEVEL'),
    ('ENCODER_ERROR_', 0x4, 'NO_RESPONSE'), ('ENCODER_ERROR_', 0x20, 'INDEX_NOT_FOUND_YET'),
    ('CONTROLLER_ERROR_', 0x1, 'OVERSPEED'), ('CONTROLLER_ERROR_', 0x80, 'SPINOUT_DETECTED'),
    ('ODRIVE_ERROR_', 0x8, 'DC_BUS_OVER_REGEN_CURRENT'),
    ('ODRIVE_ERROR_', 0x2, 'DC_BUS_UNDER_VOLTAGE'),
    ('ODRIVE_ERROR_', 0x80, 'INVALID_BRAKE_RESISTANCE'),
    ('SENSORLESS_ESTIMATOR_ERROR_', 0x2, 'UNKNOWN_CURRENT_MEASUREMENT')])
def test_errors_of_parts_have_the_bits_of_the_maker(prefix, number, name):
    register, = (item for item in REGISTERS if item.prefix == prefix)
    assert register.names[number] == name


# A single report, with the reason

CAUSES = [
    ('odrive 0.5', (), 'overspeed', ('CONTROLLER_FAILED', 'CONTROLLER_ERROR_OVERSPEED')),
    ('odrive 0.5', ('0.5.4',), 'overspeed', (
        'MOTOR_FAILED', 'MOTOR_ERROR_UNKNOWN_TORQUE', 'MOTOR_ERROR_UNKNOWN_VOLTAGE_COMMAND',
        'CONTROLLER_ERROR_OVERSPEED')),
    ('odrive 0.5', (), 'regeneration', (
        'MOTOR_FAILED', 'MOTOR_ERROR_SYSTEM_LEVEL', 'ODRIVE_ERROR_DC_BUS_OVER_REGEN_CURRENT')),
    ('odrive 0.5', (), 'too_hot', ('MOTOR_FAILED', 'MOTOR_ERROR_FET_THERMISTOR_OVER_TEMP')),
    ('odrive 0.5', (), 'no_estimate', ('ENCODER_FAILED', 'ENCODER_ERROR_NO_RESPONSE')),
    ('odrive 0.5', (), 'watchdog', ('WATCHDOG_TIMER_EXPIRED',)),
    # An error that the axis does not report.
    ('odrive 0.5', (), 'brake_resistor_disarmed', ('MOTOR_ERROR_BRAKE_RESISTOR_DISARMED',)),
    ('odrive 0.6', (), 'overspeed', ('VELOCITY_LIMIT_VIOLATION',)),
    ('odrive 0.6', (), 'regeneration', ('DC_BUS_OVER_REGEN_CURRENT',)),
    ('odrive 0.6', (), 'watchdog', ('WATCHDOG_TIMER_EXPIRED',))]


@pytest.mark.parametrize('phase', range(4))
@pytest.mark.parametrize('kind, quirks, cause, names', CAUSES)
def test_a_loss_of_power_is_reported_immediately_with_all_that_the_drive_names(
        kind, quirks, cause, names, phase):
    bench = armed(kind, *quirks)
    bench.cycles(phase)  # state or errors may be requested first
    bench.device.trip(cause)
    begin = bench.now
    while not bench.cycles(1).faults:
        assert bench.driver.telemetry.armed and bench.now - begin < 0.05
    reports = until_disarmed(bench)
    assert set(reports) == {(False, names)}


def test_an_error_that_the_drive_adds_later_is_reported_as_well():
    bench = armed('odrive 0.5')
    bench.device.trip('too_hot')
    bench.cycles(50)
    bench.device.trip('overspeed')
    telemetry = bench.cycles(100)
    assert 'CONTROLLER_ERROR_OVERSPEED' in telemetry.faults
    assert 'MOTOR_ERROR_FET_THERMISTOR_OVER_TEMP' in telemetry.faults


@both
def test_registers_that_are_not_answered_do_not_hide_a_loss_of_power(kind):
    bench = armed(kind)
    last = {'odrive 0.5': b'r error ', 'odrive 0.6': b'r axis0.procedure_result '}[kind]
    bench.to_drive = lambda data: b'' if last in data else data
    bench.device.trip('overspeed')
    telemetry = bench.cycles(150)
    assert telemetry.armed is False and telemetry.faults
    assert bench.driver.counts['lost'] > 0


def test_a_drive_that_goes_on_names_nothing_of_what_was():
    status = DriveStatus(GENERATION_5, 0.1)
    for name, value in ((STATE, 1.0), ('axis0.error', 0x40), ('axis0.motor.error', 0x1000)):
        status.take(name, value, 0.0, ours=True)
    assert status.generation.faults(status.values, True) == (
        'MOTOR_FAILED', 'MOTOR_ERROR_CURRENT_LIMIT_VIOLATION')
    status.take('axis0.error', 0.0, 0.1, ours=False)
    assert status.generation.faults(status.values, True) == () and not status.urgent


def test_a_watchdog_that_expires_without_power_is_not_a_fault():
    bench = Bench('odrive 0.5', status_period=0.0)
    bench.driver.identify()
    assert bench.cycles(200, torque=None).faults == ()
    assert bench.device.properties['axis0.error'] == 0x800  # the watchdog did expire
    bench.device.over_current()
    assert bench.cycles(100, torque=None).faults == (
        'MOTOR_FAILED', 'MOTOR_ERROR_CURRENT_LIMIT_VIOLATION')


def test_a_motor_that_cannot_be_armed_names_the_part():
    bench = Bench('odrive 0.5')
    bench.driver.identify()
    bench.device.properties['config.enable_brake_resistor'] = 1
    bench.device._brake_armed = False
    bench.to_drive = lambda data: data.replace(b'sc ', b'xx ')  # the command to arm
    with refused('not_armed', 'drive', DriveError) as caught:
        bench.driver.arm(0.2)
    assert 'MOTOR_ERROR_BRAKE_RESISTOR_DISARMED' in str(caught.value)


@pytest.mark.parametrize('silent', ['axis0.motor.error', 'axis0.sensorless_estimator.error'])
def test_a_register_that_is_not_answered_does_not_hide_what_keeps_a_motor_from_being_armed(silent):
    bench = Bench('odrive 0.5')
    bench.driver.identify()
    bench.sense(temperature=200.0)
    bench.to_drive = lambda data: b'' if f'r {silent} '.encode() in data else data
    with refused('not_armed', 'drive', DriveError) as caught:
        bench.driver.arm()
    assert 'MOTOR_FAILED' in str(caught.value)


@both
def test_reading_the_reasons_of_a_refused_arming_is_part_of_its_timeout(kind):
    bench = Bench(kind)
    bench.driver.identify()
    bench._delay = 0.045  # of each reply
    bench.sense(temperature=200.0)
    begin = bench.now
    with refused('not_armed', 'drive', DriveError):
        bench.driver.arm(0.2)
    assert bench.now - begin < 0.25


@pytest.mark.parametrize('generation', ('0.5', '0.6'))
def test_an_error_has_the_same_text_on_a_serial_line_and_on_a_bus(generation):
    texts = []
    for protocol in ('odrive', 'odrive_can'):
        bench = Bench(f'{protocol} {generation}')
        bench.driver.arm()
        with refused('not_clearable', 'motor', DriveError) as powered:
            bench.driver.clear_faults()
        bench.driver.stop()
        bench.sense(temperature=200.0)
        with refused('not_armed', 'drive', DriveError) as hot:
            bench.driver.arm()
        first, _, rest = str(hot.value).partition(' reports ')
        texts.append((str(powered.value), first, rest.partition('; ')[2]))
    assert texts[0] == texts[1] and all(texts[0])


# Clearing

@both
def test_faults_are_cleared_and_those_that_stay_are_named(kind):
    bench = Bench(kind)
    bench.driver.identify()
    bench.device.over_current()
    assert bench.driver.clear_faults() == ()
    assert bench.cycles(100, torque=None).faults == ()
    bench.sense(temperature=200.0)
    reports = bench.driver.clear_faults()
    assert 'INVERTER_OVER_TEMP' in reports or 'MOTOR_ERROR_FET_THERMISTOR_OVER_TEMP' in reports
    assert not bench.device.armed


@both
def test_faults_of_a_motor_under_power_are_not_cleared(kind):
    bench = Bench(kind)
    bench.driver.arm()
    for _ in range(2):
        with refused('not_clearable', 'motor', DriveError):
            bench.driver.clear_faults()
        assert bench.device.armed
        bench.driver._armed = False  # disarmed by another program
        bench.device.properties['axis0.config.enable_watchdog'] = 0


# Warnings, and the current of the supply

@both
def test_current_from_the_supply_and_back_into_it_is_reported(kind):
    bench = armed(kind)
    bench.cycles(120, torque=0.05)
    assert bench.driver.telemetry.bus_current == pytest.approx(3.125 * 2.0**2 / 24.0, abs=1e-5)
    bench.sense(velocity=-600.0)
    bench.cycles(120, torque=0.05)
    assert bench.driver.telemetry.bus_current == pytest.approx(
        (3.125 * 2.0**2 - 0.05 * 600.0) / 24.0, abs=1e-5)


@both
def test_a_drive_that_takes_torque_away_because_it_is_hot_warns(kind):
    bench = armed(kind)
    bench.driver.read_settings()
    assert bench.cycles(120).warnings == ()
    bench.sense(temperature=85.0)
    assert bench.cycles(120).warnings == ('effective_current_lim 2 A',)
    bench.sense(temperature=35.0)
    assert bench.cycles(120).warnings == ()


def test_a_brake_resistor_that_takes_no_more_is_warned_of():
    bench = armed('odrive 0.5')
    bench.device.properties['brake_resistor_saturated'] = 1
    assert bench.cycles(120).warnings == ('brake_resistor_saturated',)


def test_0_6_names_no_warning_that_only_0_5_has():
    assert 'brake_resistor_saturated' not in GENERATION_6.polled
