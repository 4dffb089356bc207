# SPDX-License-Identifier: Apache-2.0
"""Settings of a VESC: their positions per firmware, and the values with which a robot can move."""
import math
import struct

from drive_bench import Bench
import pytest
from refusals import refused

from ballbot_ros.drives.emulated_device import DriveSettings
from ballbot_ros.drives.vesc import settings
from ballbot_ros.drives.vesc.uart import codec, emulated
from ballbot_ros.drives.vesc.uart.emulated import LIMITS, VescDevice
from ballbot_ros.errors import DriveError

# Offsets in a GET_MCCONF after the message id: confgenerator_serialize_mcconf of the tags
# 5.03 and 6.00 and of release_6_02, and of release_6_05, release_6_06, release_7_00 and master.
PLACES = {
    (5, 3): {
        'l_current_max': (8, 'f', 1), 'l_current_min': (12, 'f', 1),
        'l_in_current_max': (16, 'f', 1), 'l_in_current_min': (20, 'f', 1),
        'l_abs_current_max': (24, 'f', 1), 'l_min_erpm': (28, 'f', 1),
        'l_max_erpm': (32, 'f', 1), 'l_erpm_start': (36, 'h', 1e4), 'l_min_vin': (46, 'f', 1),
        'l_max_vin': (50, 'f', 1), 'l_battery_cut_start': (54, 'f', 1),
        'l_battery_cut_end': (58, 'f', 1), 'l_temp_fet_start': (63, 'h', 10),
        'l_temp_motor_start': (67, 'h', 10), 'l_temp_accel_dec': (71, 'h', 1e4),
        'l_watt_max': (77, 'f', 1), 'l_watt_min': (81, 'f', 1),
        'l_current_max_scale': (85, 'h', 1e4), 'l_current_min_scale': (87, 'h', 1e4)},
    (6, 5): {
        'l_current_max': (8, 'f', 1), 'l_current_min': (12, 'f', 1),
        'l_in_current_max': (16, 'f', 1), 'l_in_current_min': (20, 'f', 1),
        'l_abs_current_max': (28, 'f', 1), 'l_min_erpm': (32, 'f', 1),
        'l_max_erpm': (36, 'f', 1), 'l_erpm_start': (40, 'h', 1e4), 'l_min_vin': (50, 'h', 10),
        'l_max_vin': (52, 'h', 10), 'l_battery_cut_start': (54, 'h', 10),
        'l_battery_cut_end': (56, 'h', 10), 'l_battery_regen_cut_start': (58, 'h', 10),
        'l_temp_fet_start': (63, 'B', 1), 'l_temp_motor_start': (65, 'B', 1),
        'l_temp_accel_dec': (67, 'h', 1e4), 'l_watt_max': (73, 'f', 1),
        'l_watt_min': (77, 'f', 1), 'l_current_max_scale': (81, 'h', 1e4),
        'l_current_min_scale': (83, 'h', 1e4)}}
VERSIONS = [(5, 3), (6, 0), (6, 2), (6, 5), (6, 6), (7, 0), (7, 1)]
# For the shipped robot: 4 N m and 12 rad/s, gear ratio 50, efficiency 0.9.
ROBOT = {'torque_limit': 4.0 / 45.0, 'speed_limit': 600.0}


def bench_with(**limits):
    """Return a bench whose drive has these limits."""
    bench = Bench('vesc', DriveSettings(torque_limit=ROBOT['torque_limit']), **ROBOT)
    bench.device.limits.update(limits)
    return bench


@pytest.mark.parametrize('version', VERSIONS)
def test_each_limit_stands_where_the_firmware_puts_it(version):
    places = PLACES[max(first for first in PLACES if first <= version)]
    payload = bytearray(bytes((14,)) + bytes(120))
    values = {name: 3.0 + number for number, name in enumerate(places)}
    values.update({name: 0.25 for name in places if places[name][2] == 1e4})
    for name, (place, form, scale) in places.items():
        packed = values[name] * scale
        struct.pack_into(f'>{form}', payload, 1 + place, packed if form == 'f' else int(packed))
    found = settings.parse_limits(bytes(payload), version)
    assert {name: found[name] for name in places} == pytest.approx(values)


@pytest.mark.parametrize('version', VERSIONS)
def test_timeout_kill_switch_and_application_stand_where_the_firmware_puts_them(version):
    place = 28 if version == (5, 3) else 32  # confgenerator_serialize_appconf
    payload = bytearray(bytes((17,)) + bytes(40))
    struct.pack_into('>If', payload, 1 + 5, 90, 0.5)
    payload[1 + place:3 + place] = bytes((4, 5))
    assert settings.parse_application(bytes(payload), version) == (
        0.09, 0.5, 'ADC2 high', 'ADC and UART')
    payload[1 + place:3 + place] = bytes((99, 77))
    assert settings.parse_application(bytes(payload), version)[2:] == ('number 99', 'number 77')


@pytest.mark.parametrize('firmware', VescDevice.firmwares)
def test_settings_of_the_emulated_drive_are_read_back(firmware):
    bench = Bench(f'vesc {firmware}')
    assert bench.driver.identify().firmware == firmware
    assert not bench.refused()
    kept = bench.driver._limits
    assert kept == pytest.approx({name: bench.device.limits[name] for name in kept}, abs=0.05)


@pytest.mark.parametrize('version, test, driven', [
    ((4, 2), 0, False), ((5, 0), 0, False), ((5, 2), 0, False), ((8, 0), 0, False),
    ((5, 3), 2, False), ((6, 5), 30, False), *((version, 0, True) for version in VERSIONS),
    ((7, 1), 1, True)])
def test_a_firmware_that_cannot_be_driven_is_refused(version, test, driven, monkeypatch):
    monkeypatch.setitem(emulated.FIRMWARES, '6.02', version)
    bench = Bench('vesc')
    bench.from_drive = lambda data: b''.join(
        codec.frame(payload[:-3] + bytes((test,)) + payload[-2:] if payload[0] == 0 else payload)
        for payload in codec.parser().feed(data))
    printed = f'{version[0]}.{version[1]:02}'
    if driven:
        assert bench.driver.identify().firmware.startswith(printed)
    else:
        with refused('firmware', 'firmware', DriveError) as caught:
            bench.driver.identify()
        assert printed in str(caught.value)
        assert not test or f' {test},' in str(caught.value)


def test_a_drive_from_the_factory_is_refused_for_two_settings():
    bench = Bench('vesc', DriveSettings(quirks=('factory',)), **ROBOT)
    rows = bench.refused()
    assert set(rows) == {'torque limit', 'watchdog'}
    assert rows['torque limit'].value == '1.5 N m' and rows['watchdog'].value == '1.01 s'


def test_the_factory_limits_suit_the_shipped_robot():
    assert not bench_with().refused()


@pytest.mark.parametrize('limits, name', [
    *(({'l_current_max': value}, 'torque limit') for value in (4.2, math.inf, math.nan)),
    *(({'l_current_min': value}, 'torque limit') for value in (-4.2, -math.inf, math.nan)),
    ({'l_in_current_max': 1.9}, 'driving power'), ({'l_watt_max': 50.0}, 'driving power'),
    ({'l_in_current_min': -0.01}, 'braking power'), ({'l_in_current_min': 0.0}, 'braking power'),
    ({'l_watt_min': -50.0}, 'braking power'),
    ({'l_battery_cut_start': 25.0}, 'supply'), ({'l_max_vin': 24.0}, 'supply'),
    ({'l_max_erpm': 50e3}, 'speed limit'), ({'l_min_erpm': -50e3}, 'speed limit'),
    ({'l_erpm_start': 0.4}, 'speed limit'), ({'l_abs_current_max': 3.5}, 'over-current trip')])
def test_a_limit_that_a_motion_of_the_robot_would_run_into_is_refused(limits, name):
    assert list(bench_with(**limits).refused()) == [name]


def test_a_limit_is_judged_by_what_its_scale_leaves_of_it():
    assert not bench_with(l_current_max=8.0, l_current_min=-8.0, l_current_max_scale=0.4,
                          l_current_min_scale=0.4).refused()


def test_from_6_05_on_the_voltage_above_which_nothing_flows_back_is_judged_too():
    bench = Bench('vesc 6.05')
    bench.device.limits['l_battery_regen_cut_start'] = 23.0
    assert list(bench.refused()) == ['supply']


@pytest.mark.parametrize('changes, name', [
    ({'timeout': 0.0}, 'watchdog'), ({'timeout': 0.095}, 'watchdog'),
    ({'brake_current': 0.5}, 'brake current on timeout'),
    ({'brake_current': math.nan}, 'brake current on timeout'),
    ({'application': 'ADC'}, 'commands from'), ({'application': 'PPM and UART'}, 'commands from'),
    ({'application': 'none'}, None), ({'kill_switch': 'ADC2 low'}, None)])
def test_application_settings_are_judged(changes, name):
    bench = bench_with()
    bench.device.application = bench.device.application._replace(**changes)
    assert list(bench.refused()) == ([] if name is None else [name])


def test_the_10_ms_that_the_drive_takes_to_notice_are_part_of_its_watchdog():
    bench = bench_with()
    found = bench.settings()['watchdog']
    assert found.value == '0.1 s' and 'Timeout 90 ms' in found.remedy
    assert bench.device.application.timeout == pytest.approx(0.09)


@pytest.mark.parametrize('message, accepted', [
    (codec.GET_MCCONF, ['watchdog', 'brake current on timeout', 'commands from', 'kill switch']),
    (codec.GET_APPCONF, ['torque limit', 'driving power', 'braking power', 'supply',
                         'speed limit', 'over-current trip', 'full torque below'])])
def test_settings_that_are_cut_off_are_refused_and_called_unknown(message, accepted):
    bench = bench_with()
    bench.from_drive = lambda data: b''.join(
        codec.frame(payload[:8] if payload[0] == message else payload)
        for payload in codec.parser().feed(data))
    rows = bench.driver.read_settings()
    assert [item.name for item in rows if item.acceptable] == accepted
    assert all(item.acceptable or 'unknown' in item.value or item.name == 'supply'
               for item in rows)


@pytest.mark.parametrize('sensed, warning', [
    ({'temperature': 86.0}, 'MOSFET_TEMP_CUTOFF'),
    ({'motor_temperature': 77.0}, 'MOTOR_TEMP_CUTOFF'),  # driving is cut 15 % of the way to 25
    ({'bus_voltage': 9.5}, 'BATTERY_VOLTAGE_CUTOFF'),
    ({'velocity': 1250.0}, 'ERPM_LIMIT'), ({'velocity': -1250.0}, 'ERPM_LIMIT')])
def test_a_limit_that_is_reached_is_a_warning_while_the_motor_keeps_its_power(sensed, warning):
    bench = bench_with()
    bench.driver.read_settings()
    bench.driver.arm()
    assert bench.cycles(10, torque=0.08).warnings == ()
    bench.sense(**sensed)
    telemetry = bench.cycles(10, torque=math.copysign(0.08, sensed.get('velocity', 1.0)))
    assert telemetry.warnings == (warning,)
    assert telemetry.armed is True and telemetry.faults == ()


@pytest.mark.parametrize('limits, sensed, part', [
    ({}, {'velocity': 600.0}, 1.0), ({}, {'velocity': -600.0}, 1.0),
    ({'l_in_current_min': -0.01}, {'velocity': -600.0}, 0.24 / 53.33),  # braking
    ({'l_in_current_max': 1.0}, {'velocity': 600.0}, 24.0 / 53.33),
    ({}, {'bus_voltage': 9.0, 'velocity': 0.0}, 1.0),
    ({'l_max_erpm': 40107.0, 'l_erpm_start': 0.5}, {'velocity': 450.0}, 0.5),
    ({}, {'temperature': 92.5}, 0.5)])
def test_a_limit_cuts_the_current_and_the_status_stays_clean(limits, sensed, part):
    bench = bench_with(**limits)
    bench.driver.arm()
    bench.sense(**sensed)
    telemetry = bench.cycles(10, torque=ROBOT['torque_limit'])
    assert bench.device.torque() == pytest.approx(part * ROBOT['torque_limit'], rel=0.01)
    assert telemetry.armed is True and telemetry.faults == ()


def test_every_limit_of_every_firmware_has_a_value_from_the_factory():
    own = {'l_current_max', 'l_current_min', 'l_temp_fet_start', 'l_temp_fet_end'}
    for version in VERSIONS:
        assert set(settings.layout_of(version)) <= set(LIMITS) | own
