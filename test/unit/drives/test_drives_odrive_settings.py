# SPDX-License-Identifier: Apache-2.0
"""Required settings of an ODrive for a robot: its own limits, and the energy of braking."""
import math

from drive_bench import Bench
import pytest

from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.drives.emulated_device import DriveSettings
from ballbot_ros.drives.odrive.ascii import codec
from ballbot_ros.physics import load_robot

both = pytest.mark.parametrize('kind', ('odrive 0.5', 'odrive 0.6'))
VELOCITY, OVERSPEED, BRAKING = 'velocity limit in torque mode', 'overspeed error', 'braking'
CONTROLLER = 'axis0.controller.config.'


def bench(kind, *quirks):
    """Return a bench with the options of the hardware file of GimBall."""
    options = load_hardware('gimball_odrive').options()
    return Bench(kind, DriveSettings(
        quirks=quirks, torque_limit=options.torque_limit, boot_time=0.1),
        torque_limit=options.torque_limit, speed_limit=options.speed_limit)


def type_lines(here, remedy):
    """Send the commands of a remedy as lines without checksums, as in a terminal."""
    for line in remedy.split(', '):
        here.device.receive(f'{line}\n'.encode(), here.now)
        here.pass_time(0.01)


def test_the_overspeed_error_of_the_factory_comes_at_7_cm_per_second_of_gimball():
    hardware = load_hardware('gimball_odrive')
    trip = 1.2 * 2.0 * math.tau / hardware.joint.gear_ratio
    assert trip * load_robot('gimball').ball_radius == pytest.approx(0.07, abs=0.005)


@both
def test_all_that_the_factory_leaves_open_is_refused_and_set_right_by_the_remedy(kind):
    here = bench(kind, 'factory')
    wrong = here.refused()
    calibrated = {'odrive 0.5': 'encoder', 'odrive 0.6': 'commutation'}[kind]
    assert set(wrong) == {'torque limit', 'watchdog', VELOCITY, OVERSPEED, BRAKING, calibrated}
    velocity = {'odrive 0.5': '2', 'odrive 0.6': '10'}[kind]
    assert wrong[VELOCITY].value == f'{velocity} turn/s'
    assert wrong[BRAKING].value == '0.01 A into the supply, no brake resistor'
    # An unfed watchdog would disarm the motor during the calibration.
    type_lines(here, wrong.pop(calibrated).remedy)
    here.pass_time(3.0)
    for item in wrong.values():
        type_lines(here, item.remedy)
    assert not here.refused()
    if kind == 'odrive 0.5':  # for an encoder with an index, or an absolute one
        here.device.receive(b'w axis0.encoder.config.pre_calibrated 1\n', here.now)
    here.device.receive(b'ss\n', here.now)
    here.pass_time(0.2)
    assert not here.refused()
    here.driver.arm()


@both
def test_an_unfed_watchdog_spoils_a_calibration(kind):
    here = bench(kind, 'factory')
    remedy = here.refused()['watchdog'].remedy
    type_lines(here, f'{remedy}, w axis0.requested_state 3')
    here.pass_time(3.0)
    assert {'encoder', 'commutation'} & set(here.refused())


@both
def test_an_accepted_limit_acts_only_on_a_runaway_and_lets_it_brake(kind):
    here = bench(kind, 'vel_limit', 'regeneration')
    for item in here.refused().values():
        type_lines(here, item.remedy)
    options = here.driver.options
    here.driver.arm()
    fastest = 1.5 * options.speed_limit
    for velocity, torque in ((fastest, options.torque_limit), (-fastest, options.torque_limit),
                             (fastest, -options.torque_limit), (fastest, 0.0),
                             (fastest, -0.3 * options.torque_limit)):
        here.sense(velocity=velocity)
        here.cycles(5, torque)
        assert here.device.armed and here.device.torque() == pytest.approx(torque, abs=1e-5)


@pytest.mark.parametrize('changes, names', [
    ({'vel_limit': 2.0}, {VELOCITY, OVERSPEED}),
    ({'vel_limit': 2.0, 'enable_torque_mode_vel_limit': 0}, {OVERSPEED}),
    ({'vel_limit': 2.0, 'enable_overspeed_error': 0}, {VELOCITY}),
    ({'vel_limit': 2.0, 'enable_overspeed_error': 0, 'enable_torque_mode_vel_limit': 0}, set()),
    ({'vel_limit_tolerance': 0.5}, {OVERSPEED}),
    ({'vel_limit_tolerance': math.inf, 'vel_limit': math.inf}, set()),
    # 143.3 turn/s, less torque / gain.
    ({'vel_limit': 143.5, 'vel_gain': 1.0 / 6.0}, {VELOCITY}),
    ({'vel_limit': 144.0, 'vel_gain': 1.0 / 6.0}, set()),
    ({'vel_limit': 160.0, 'vel_gain': 1e-3}, {VELOCITY}),
    ({'vel_gain': 0.0}, {VELOCITY})])
@both
def test_a_limit_of_the_drive_counts_where_it_is_switched_on(kind, changes, names):
    here = bench(kind)
    here.device.properties.update({CONTROLLER + name: value for name, value in changes.items()})
    wrong = here.refused()
    assert set(wrong) == names
    for item in wrong.values():
        assert CONTROLLER in item.remedy
        type_lines(here, item.remedy)
    assert not here.refused()


BRAKE = {'odrive 0.5': ('config.enable_brake_resistor', 'config.brake_resistance'),
         'odrive 0.6': ('config.brake_resistor0.enable', 'config.brake_resistor0.resistance')}


@pytest.mark.parametrize('back, allowed, enabled, resistance, accepted', [
    (-0.01, 0.0, 0, 2.0, False), (-0.01, 0.0, 1, 2.0, True), (-0.01, 0.0, 1, 0.0, False),
    (-0.01, 0.1, 1, 2.0, False),  # this current flows back before the resistor absorbs any
    (-0.01, 0.0, 1, 10.0, False),  # absorbs 2.3 A at 24 V; up to 3.3 A are possible
    (-2.0, 0.0, 1, 10.0, True), (-3.0, 0.0, 0, 2.0, False), (-3.5, 0.0, 0, 2.0, True),
    (-math.inf, 0.0, 0, 2.0, True), (0.0, 0.0, 0, 2.0, False)])
@both
def test_the_energy_of_braking_must_go_somewhere(
        kind, back, allowed, enabled, resistance, accepted):
    here = bench(kind)
    here.device.properties.update(dict(zip(BRAKE[kind], (enabled, resistance))))
    here.device.properties.update({
        'config.dc_max_negative_current': back, 'config.max_regen_current': allowed})
    assert ({BRAKING} if not accepted else set()) == set(here.refused())


@both
def test_a_board_without_a_brake_resistor_may_still_charge_a_battery(kind):
    here = bench(kind)
    enabled, resistance = map(codec.read, BRAKE[kind])
    here.to_drive = lambda data: codec.read('blahblah') if data in (enabled, resistance) else data
    assert not here.refused()


@pytest.mark.parametrize('name', [
    CONTROLLER + 'vel_limit', CONTROLLER + 'vel_limit_tolerance', CONTROLLER + 'vel_gain',
    'config.dc_max_negative_current', 'vbus_voltage'])
@both
def test_a_limit_that_is_not_known_is_not_accepted(kind, name):
    here = bench(kind)
    here.to_drive = lambda data: data.replace(codec.read(name), codec.read('blahblah'))
    assert here.refused()


@both
def test_without_a_speed_of_the_robot_any_speed_limit_is_accepted(kind):
    here = Bench(kind, DriveSettings(quirks=('vel_limit', 'regeneration')))
    here.device.properties[CONTROLLER + 'vel_limit'] = 10.0
    assert not here.refused()


def test_firmware_0_5_4_is_accepted():
    assert Bench('odrive 0.5', DriveSettings(quirks=('0.5.4',))).driver.identify().firmware == \
        '0.5.4'


@both
def test_the_braking_that_is_asked_for_is_enough_where_it_is_a_round_number(kind):
    here = bench(kind, 'regeneration')
    options = here.driver.options
    # Half an ampere at a runaway: the checked value must be below that of the remedy.
    here.sense(bus_voltage=1.5 * options.speed_limit * options.torque_limit / 0.5)
    type_lines(here, here.refused()[BRAKING].remedy)
    assert BRAKING not in here.refused()
