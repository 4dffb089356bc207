# SPDX-License-Identifier: Apache-2.0
"""Behaviour of the ODrive firmware, according to the maker's sources, in the emulated drive."""
import math

import pytest
from refusals import refused

from ballbot_ros.drives import device_class, DRIVES
from ballbot_ros.drives.emulated_device import DriveSettings, Sensed
from ballbot_ros.drives.odrive.ascii.emulated import ODriveDevice
from ballbot_ros.errors import ConfigurationError

GENERATIONS = ('0.5', '0.6')
each = pytest.mark.parametrize('firmware', GENERATIONS)


def drive(firmware='0.5', *quirks, **settings):
    """Return a drive in closed loop, at rest, without a watchdog."""
    device = ODriveDevice(DriveSettings(
        firmware=firmware, quirks=quirks, **{'watchdog': 0.0, **settings}))
    device.properties['axis0.controller.config.control_mode'] = 1
    write(device, 'axis0.requested_state', 8)
    assert device.armed
    return device


def write(device, name, value):
    """Write a property, as in a terminal."""
    device.receive(f'w {name} {value}\n'.encode(), 1.0)


def ask(device, text):
    """Return the reply to a line without a checksum."""
    return device.receive(f'{text}\n'.encode(), 1.0).decode().strip()


def turn(device, velocity, **more):
    """Set the shaft velocity [turn/s], and run a control period of the drive."""
    device.sensed = Sensed(velocity=velocity * math.tau, **more)
    device.tick(1.0)


@pytest.mark.parametrize('protocol', sorted(DRIVES))
def test_every_quirk_says_what_it_does_and_where_that_is_written(protocol):
    found = device_class(protocol)
    for name, quirk in found.quirks.items():
        assert quirk.effect and quirk.source
        assert found(DriveSettings(quirks=(name,))).has(name)
    with refused('unknown_name', 'qirk', ConfigurationError):
        found(DriveSettings(quirks=('qirk',)))


# Velocity limits; controller.cpp, limitVel and overspeed fault

@each
def test_from_the_factory_a_free_shaft_is_braked_though_no_torque_is_commanded(firmware):
    device = drive(firmware, 'vel_limit')
    write(device, 'axis0.controller.config.enable_overspeed_error', 0)
    limit = {'0.5': 2.0, '0.6': 10.0}[firmware]
    for velocity in (0.0, 0.99 * limit, -0.99 * limit):
        turn(device, velocity)
        assert device.torque() == 0.0
    turn(device, limit + 0.3)
    assert device.torque() == pytest.approx(-0.3 / 6.0)
    turn(device, -limit - 0.3)
    assert device.torque() == pytest.approx(0.3 / 6.0)
    turn(device, limit + 100.0)  # limited to the torque limit of the drive: 4 N m at the pendulum
    assert device.torque() == pytest.approx(-0.1) and device.armed
    write(device, 'axis0.controller.config.enable_torque_mode_vel_limit', 0)
    assert device.torque() == 0.0


@pytest.mark.parametrize('firmware, quirks, expected', [
    ('0.5', (), {'axis0.error': 0x200, 'axis0.controller.error': 0x1, 'axis0.motor.error': 0}),
    # motor.cpp and foc.cpp of 0.5.4: no torque, hence no voltage.
    ('0.5', ('0.5.4',), {'axis0.error': 0x40, 'axis0.controller.error': 0x1,
                         'axis0.motor.error': 0x10000000 | 0x100000000}),
    ('0.6', (), {'axis0.active_errors': 0x8000, 'axis0.disarm_reason': 0x8000})])
def test_a_shaft_faster_than_the_velocity_limit_and_its_tolerance_is_disarmed(
        firmware, quirks, expected):
    device = drive(firmware, 'vel_limit', *quirks)
    limit = {'0.5': 2.4, '0.6': 12.0}[firmware]
    turn(device, -0.99 * limit)
    assert device.armed
    turn(device, -1.01 * limit)
    assert not device.armed
    assert {name: device.properties[name] for name in expected} == expected


def test_0_5_4_sends_nine_of_the_ten_digits_of_its_motor_error():
    device = drive('0.5', 'vel_limit', '0.5.4')
    turn(device, 3.0)
    assert str(0x110000000) == '4563402752' and ask(device, 'r axis0.motor.error') == '456340275'


# Supply; low_level.cpp, update_brake_current

def braking(device):
    """Brake the motor at 100 turn/s, so that it returns 0.4 A."""
    turn(device, 0.0)
    device.receive(b'c 0 -0.02\n', 1.0)
    turn(device, 100.0)
    return device


@each
def test_from_the_factory_braking_feeds_the_supply_which_is_an_error(firmware):
    device = braking(drive(firmware, 'regeneration'))
    assert not device.armed
    if firmware == '0.5':
        assert (device.properties['error'], device.properties['axis0.motor.error']) == (
            0x8, 0x1000000)
    else:
        assert device.properties['axis0.disarm_reason'] == 0x800


def test_a_battery_may_be_charged_where_the_drive_is_set_so():
    device = drive('0.5', 'regeneration')
    write(device, 'config.dc_max_negative_current', -2)
    braking(device)
    # 0.02 N m at 628 rad/s, less the losses of 0.8 A in 3.125 ohm, at 24 V.
    power = -0.02 * 100.0 * math.tau + 3.125 * 0.8**2
    assert device.armed and float(ask(device, 'r ibus')) == pytest.approx(power / 24.0, abs=1e-5)


@each
def test_a_brake_resistor_takes_what_comes_back_once_it_is_armed(firmware):
    enable = {'0.5': 'config.enable_brake_resistor', '0.6': 'config.brake_resistor0.enable'}
    device = ODriveDevice(DriveSettings(firmware=firmware, quirks=('regeneration',), watchdog=0.0))
    device.properties['axis0.controller.config.control_mode'] = 1
    write(device, enable[firmware], 1)
    write(device, 'axis0.requested_state', 8)
    assert not device.armed  # the resistor must first be armed, by a restart or by sc
    if firmware == '0.5':  # the axis does not report this
        assert device.properties['axis0.error'] == 0
        assert device.properties['axis0.motor.error'] == 0x800000
    device.receive(b'sc\n', 1.0)
    write(device, 'axis0.requested_state', 8)
    assert braking(device).armed
    write(device, 'config.max_regen_current', 0.1)  # before the resistor absorbs any
    braking(device)
    assert not device.armed


def test_a_hot_drive_takes_current_away_before_it_trips():
    device = drive('0.5', highest_temperature=100.0, torque_limit=1.0, current_limit=4.0)
    device.receive(b'c 0 1.0\n', 1.0)
    limits = []
    for temperature in (35.0, 75.0, 85.0, 95.0, 99.0):
        device.sensed = device.sensed._replace(temperature=temperature)
        limits.append(float(ask(device, 'r axis0.motor.effective_current_lim')))
        assert device.torque() == pytest.approx(0.025 * limits[-1])
    assert limits == [4.0, 4.0, 2.0, 0.0, 0.0] and device.armed


# Settings

def test_ss_keeps_the_settings_over_a_restart_and_nothing_else_does():
    device = ODriveDevice(DriveSettings(quirks=('factory',), boot_time=0.3))
    write(device, 'axis0.controller.config.vel_limit', 150)
    device.receive(b'sr\n', 1.0)
    assert device.receive(b'r axis0.controller.config.vel_limit\n', 1.1) == b''
    assert device.receive(b'r axis0.controller.config.vel_limit\n', 2.0) == b'2.000000\r\n'
    device.receive(b'w axis0.controller.config.vel_limit 150\nss\n', 2.0)
    assert device.receive(b'r axis0.controller.config.vel_limit\n', 3.0) == b'150.00000\r\n'


def test_ss_is_not_obeyed_under_power():
    device = drive()
    device.receive(b'ss\n', 1.0)
    assert device.armed and ask(device, 'r axis0.current_state') == '8'


@each
def test_from_the_factory_the_motor_has_to_be_calibrated_which_takes_a_while(firmware):
    device = ODriveDevice(DriveSettings(firmware=firmware, quirks=('factory',)))
    write(device, 'axis0.requested_state', 8)
    assert not device.armed
    device.receive(b'sc\n', 1.0)
    write(device, 'axis0.requested_state', 3)
    device.tick(2.0)
    assert device.properties['axis0.current_state'] == 3
    device.tick(3.1)
    assert device.properties['axis0.current_state'] == 1
    write(device, 'axis0.requested_state', 8)
    assert device.armed
