# SPDX-License-Identifier: Apache-2.0
"""Hardware files, and the refusal of infeasible control loops."""
from dataclasses import replace

import pytest
from refusals import refused
import serial
from tiers import slow

from ballbot_ros.bridge.feasibility import (
    BAUD_RATES, check_feasible, check_joint_state_rate, onboard_lag, RESERVE, wire_budget)
from ballbot_ros.bridge.hardware_file import (
    Connection, Joint, Limits, load_hardware, read_hardware)
from ballbot_ros.config.files import read_yaml, shipped_files, shipped_folder
from ballbot_ros.control import load_tuning
from ballbot_ros.errors import ConfigurationError, UnstableLoopError
from ballbot_ros.physics import load_robot

GIMBALL, GENTLE, PUBLISHED = load_robot('gimball'), load_tuning('gentle'), load_tuning('published')
SHIPPED = sorted(path.stem for path in shipped_files('hardware'))


def content(**sections):
    """Return the shipped ODrive file with some entries changed."""
    file = dict(read_yaml(shipped_folder('config') / 'hardware/gimball_odrive.yaml'))
    for section, entries in sections.items():
        file[section] = {**file[section], **entries}
    return file


def changed(**connection):
    """Return the shipped hardware with changes to its connection; by default at 500 Hz."""
    hardware = load_hardware('gimball_odrive')
    return replace(hardware, connection=replace(
        hardware.connection, **{'loop_rate': 500.0, **connection}))


@pytest.mark.parametrize('name', [SHIPPED[0], *slow(*SHIPPED[1:])])
def test_shipped_hardware_is_feasible_and_marks_assumed_values(name):
    hardware = load_hardware(name)
    check_feasible(hardware, load_robot(hardware.robot), GENTLE)
    assert hardware.name == name
    assert hardware.provenance['joint.gear_ratio'].source == 'assumed'
    assert not hardware.limits.rearm and hardware.connection.imu_required


@pytest.mark.parametrize('name', SHIPPED)
def test_shipped_files_of_one_robot_differ_only_in_their_drive(name):
    hardware, first = load_hardware(name), load_hardware('gimball_odrive')
    for section in ('joint', 'limits', 'battery', 'thermal'):
        assert getattr(hardware, section) == getattr(first, section), section


@pytest.mark.parametrize('name', SHIPPED)
def test_the_battery_fits_the_motor_of_the_robot(name):
    hardware = load_hardware(name)
    battery, motor = hardware.battery, load_robot(hardware.robot).motor
    assert battery.low_voltage < motor.maximum_voltage < battery.full_voltage


@pytest.mark.parametrize('limits, factor, sent, own', [
    ({}, 1.0, 4.0, 4.0), ({}, 1.25, 3.2, 4.0), ({}, 0.8, 5.0, 5.0),
    ({'torque_limit': 0.3}, 1.0, 0.3, 4.0),
    ({'torque_limit': 0.3, 'drive_torque_limit': 0.0}, 1.0, 0.3, 0.3),
    ({'torque_limit': 6.0}, 1.0, 6.0, 6.0)])
def test_the_limit_of_the_drive_may_exceed_a_lowered_or_calibrated_limit_of_the_file(
        limits, factor, sent, own):
    options = read_hardware(content(limits=limits, joint={'torque_factor': factor}),
                            'test').options()
    assert options.torque_limit == pytest.approx(sent / 45.0)
    assert options.own_limit == pytest.approx(own / 45.0)


@pytest.mark.parametrize('name', SHIPPED)
def test_the_gear_matches_the_robot(name):
    motor = GIMBALL.motor
    joint = load_hardware(name).joint
    assert (joint.gear_ratio, joint.gear_efficiency) == (motor.gear_ratio, motor.gear_efficiency)


@pytest.mark.parametrize('sections, reason, field, proposed', [
    ({'connection': {'protocol': 'oddrive'}}, 'not_a_choice', 'protocol', "'odrive'"),
    ({'connection': {'bauds': 3}}, 'unknown_name', 'bauds', "'baud'"),
    ({'limits': {'torque_limit': -1.0}}, 'out_of_range', 'torque_limit', ''),
    ({'limits': {'torque_limit': float('nan')}}, 'not_finite', 'torque_limit', ''),
    ({'limits': {'on_timeout': 'hope'}}, 'not_a_choice', 'on_timeout', 'coast, brake, settle'),
    ({'limits': {'torque_limit': {'value': 4.0, 'unit': 'Nm'}}}, 'not_a_choice', 'torque_limit',
     "'N m'"),
    ({'joint': {'direction': 0}}, 'not_a_choice', 'direction', ''),
    ({'drive': {'axes': 1}}, 'unknown_name', 'axes', "'axis'"),
    ({'drive': {'axis': 7}}, 'out_of_range', 'axis', '')])
def test_an_invalid_entry_of_a_file_is_named(sections, reason, field, proposed):
    with refused(reason, field, ConfigurationError) as caught:
        read_hardware(content(**sections), 'my.yaml')
    assert str(caught.value).startswith(f'my.yaml: {next(iter(sections))}: ')
    assert proposed in str(caught.value)


# Section, its other required fields, field, allowed extremes, values out of range.
RANGES = [
    (Joint, {'gear_ratio': 50.0}, 'gear_efficiency', (1e-6, 1.0), (0.0, 1.0001)),
    (Joint, {'gear_ratio': 50.0}, 'torque_factor', (1e-6, 10.0), (0.0, 10.001)),
    (Joint, {'gear_ratio': 50.0}, 'encoder_scale', (1e-6, 1e6), (0.0,)),
    (Joint, {'gear_ratio': 50.0}, 'direction', (-1, 1), (-2, 0, 2)),
    (Joint, {}, 'gear_ratio', (1e-6, 1e6), (0.0,)),
    (Limits, {}, 'torque_limit', (1e-6, 1000.0), (0.0, 1000.1)),
    (Limits, {'torque_limit': 1.0}, 'torque_rate_limit', (1e-6, 1e9), (0.0,)),
    (Limits, {'torque_limit': 1.0}, 'angle_limit', (1e-6, 6.3), (0.0, 6.301)),
    (Limits, {'torque_limit': 1.0}, 'speed_limit', (1e-6, 1e6), (0.0,)),
    (Limits, {'torque_limit': 1.0}, 'command_timeout', (0.01, 10.0), (0.0099, 10.01)),
    (Limits, {'torque_limit': 1.0}, 'damping', (0.0, 100.0), (-1e-9, 100.1)),
    (Limits, {'torque_limit': 1.0}, 'damping_time', (0.0, 60.0), (-1e-9, 60.01)),
    (Connection, {'protocol': 'vesc', 'port': 'x'}, 'baud', (300, 20_000_000),
     (299, 20_000_001)),
    (Connection, {'protocol': 'vesc', 'port': 'x'}, 'loop_rate', (1.0, 5000.0),
     (0.999, 5000.1)),
    (Connection, {'protocol': 'vesc', 'port': 'x'}, 'watchdog', (0.01, 1.0), (0.0099, 1.001))]


@pytest.mark.parametrize('section, needs, field, allowed, beyond', RANGES)
def test_each_value_is_accepted_only_within_its_range(
        section, needs, field, allowed, beyond):
    for value in allowed:
        assert getattr(section(**needs, **{field: value}), field) == value
    for value in beyond:
        reason = 'not_a_choice' if (field, value) == ('direction', 0) else 'out_of_range'
        with refused(reason, field, ConfigurationError):
            section(**needs, **{field: value})


def test_a_minimal_file_has_conservative_defaults():
    hardware = read_hardware(
        {'name': 'mine', 'robot': 'gimball', 'connection': {'protocol': 'odrive', 'port': 'x'},
         'joint': {'gear_ratio': 50.0}, 'limits': {'torque_limit': 1.0}}, 'my.yaml')
    assert hardware.connection == Connection(
        'odrive', 'x', baud=115200, loop_rate=200.0, watchdog=0.1, imu_required=True)
    assert hardware.limits == Limits(
        1.0, torque_rate_limit=400.0, angle_limit=1.6, speed_limit=12.0, command_timeout=0.1,
        on_timeout='coast', damping=0.3, damping_time=2.0, rearm=False)
    assert hardware.joint == Joint(
        50.0, gear_efficiency=1.0, direction=1, encoder_scale=None, torque_factor=1.0,
        encoder_zero=None)


def test_all_missing_fields_of_all_sections_are_named_together():
    with pytest.raises(ConfigurationError) as caught:
        read_hardware({'name': 'mine', 'connection': {'protocol': 'vesc'}}, 'my.yaml')
    assert [(problem.reason, problem.field) for problem in caught.value.problems] == [
        ('missing', name) for name in ('robot', 'port', 'gear_ratio', 'torque_limit')]
    for place in ('connection', 'joint', 'limits'):
        assert f'my.yaml: {place}: ' in str(caught.value)


@pytest.mark.parametrize('missing', ['name', 'robot'])
def test_name_and_robot_must_be_text(missing):
    for value in (None, 7):
        with refused('wrong_type', missing, ConfigurationError):
            read_hardware({**content(), missing: value}, 'my.yaml')


def test_a_given_port_and_baud_rate_replace_those_of_the_file():
    file = load_hardware('gimball_odrive')
    there = file.at('/dev/other')
    assert (there.connection.port, there.connection.baud) == ('/dev/other', 921600)
    assert file.at(baud=9600).connection == replace(file.connection, baud=9600)
    assert file.at() == file


@pytest.mark.parametrize('direction', [1, -1])
def test_the_driver_has_the_torque_limit_of_the_pendulum_referred_to_the_motor_shaft(direction):
    hardware = load_hardware('gimball_vesc')
    hardware = replace(hardware, joint=replace(hardware.joint, direction=direction),
                       connection=replace(hardware.connection, watchdog=0.2))
    options = hardware.options()
    assert options.torque_limit == pytest.approx(4.0 / (50.0 * 0.9))
    assert options.watchdog == 0.2 and options.pole_pairs == 7
    assert hardware.provenance['drive.torque_constant'].source == 'assumed'


@pytest.mark.parametrize('name', [
    'torque_limit', 'drive_torque_limit', 'speed_limit', 'watchdog'])
def test_the_section_drive_does_not_override_a_safety_setting(name):
    file = dict(read_yaml(shipped_folder('config') / 'hardware/gimball_odrive.yaml'))
    file['drive'] = {**file.get('drive', {}), name: 3.0}
    with refused('inconsistent', name):
        read_hardware(file, 'here')
    with refused('inconsistent', name):
        replace(load_hardware('gimball_odrive'), drive={name: 3.0}).options()


def test_a_setting_that_a_drive_does_not_have_is_refused_in_the_file():
    with refused('unknown_name', 'poles', ConfigurationError):
        replace(load_hardware('gimball_odrive'), drive={'poles': 7}).options()


def test_a_missing_file_is_refused_with_the_available_files():
    with refused('unknown_name', 'hardware', ConfigurationError) as caught:
        load_hardware('gimball_oddrive')
    assert "'gimball_odrive'" in str(caught.value)


def test_the_joint_converts_between_motor_shaft_and_pendulum():
    joint = Joint(gear_ratio=50.0, gear_efficiency=0.8, direction=-1, torque_factor=1.25)
    assert joint.joint_angle(100.0) == -2.0
    assert joint.motor_torque(1.0) == pytest.approx(-0.02)
    assert Joint(gear_ratio=50.0, encoder_scale=1.0).joint_angle(2.0) == 2.0


def test_a_line_that_is_too_slow_is_refused_with_a_sufficient_baud_rate():
    budget = wire_budget(changed(), GIMBALL)
    assert budget.duration(921600) == pytest.approx(
        10.0 * (budget.bytes_out + budget.bytes_in) / 921600)
    top = int(budget.highest_rate(115200))
    with refused('inconsistent', 'loop_rate', ConfigurationError) as caught:
        check_feasible(changed(baud=115200), GIMBALL, GENTLE)
    for value in ('115200 baud', f'{top} Hz', '921600'):
        assert value in str(caught.value)
    for rate in (float(top), budget.highest_rate(115200)):
        check_feasible(changed(baud=115200, loop_rate=rate), GIMBALL, GENTLE)
    assert set(BAUD_RATES) <= set(serial.Serial.BAUDRATES)


def test_a_line_that_is_too_slow_for_any_rate_of_the_gains_is_refused():
    with refused('inconsistent', 'loop_rate', ConfigurationError):
        check_feasible(changed(baud=115200), GIMBALL, PUBLISHED)


def test_gains_that_diverge_at_the_rate_of_the_loop_are_refused():
    with refused('unstable', 'loop_rate', UnstableLoopError) as caught:
        check_feasible(changed(), GIMBALL, PUBLISHED)
    for value in ('500 Hz', '1 sample', '548 Hz'):
        assert value in str(caught.value)
    check_feasible(changed(loop_rate=700.0), GIMBALL, PUBLISHED)


@pytest.mark.slow
def test_a_baud_rate_that_prevents_a_stable_loop_rate_is_named():
    with refused('unstable', 'baud', UnstableLoopError):
        check_feasible(changed(baud=115200, loop_rate=80.0), GIMBALL, PUBLISHED)


def test_a_watchdog_shorter_than_three_periods_is_refused():
    with refused('inconsistent', 'watchdog', ConfigurationError):
        check_feasible(changed(loop_rate=100.0, watchdog=0.02), GIMBALL, GENTLE)
    check_feasible(changed(loop_rate=100.0, watchdog=0.03), GIMBALL, GENTLE)


def test_the_onboard_lag_is_the_time_on_the_line_plus_a_reserve():
    budget = wire_budget(changed(), GIMBALL)
    assert onboard_lag(changed(), GIMBALL) == pytest.approx(
        10.0 * (budget.bytes_out + budget.bytes_in) / 921600 + RESERVE)


@pytest.mark.parametrize('name, lowest', [
    ('gimball_odrive', 548.0), *slow(('gimball_vesc', 170.0), ('gimball_roboclaw', 154.4))])
def test_the_published_gains_need_a_minimum_rate_on_board(name, lowest):
    hardware = load_hardware(name)
    hardware = replace(hardware, connection=replace(hardware.connection, loop_rate=700.0))
    assert check_feasible(hardware, GIMBALL, PUBLISHED, 0, onboard_lag(hardware, GIMBALL)) \
        == pytest.approx(lowest, rel=5e-3)


def test_gains_that_diverge_on_board_are_refused_with_the_delay_in_milliseconds():
    with refused('unstable', 'loop_rate', UnstableLoopError) as caught:
        check_feasible(changed(), GIMBALL, PUBLISHED, 0, onboard_lag(changed(), GIMBALL))
    for value in ('500 Hz', '1.9 ms', '548 Hz'):
        assert value in str(caught.value)


def test_the_joint_state_rate_must_not_exceed_the_loop_rate():
    check_joint_state_rate(changed(), 500.0)
    with refused('inconsistent', 'joint_state_rate', ConfigurationError):
        check_joint_state_rate(changed(), 501.0)
