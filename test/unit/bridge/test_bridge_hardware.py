# SPDX-License-Identifier: Apache-2.0
"""Hardware files, and loops that cannot work and say so."""
from dataclasses import replace

import pytest
from refusals import refused
import serial
from tiers import slow

from ballbot_ros.bridge.feasibility import (
    BAUD_RATES, check_feasible, check_joint_state_rate, onboard_lag, RESERVE, wire_budget)
from ballbot_ros.bridge.hardware_file import (
    Connection, Joint, Limits, load_hardware, read_hardware)
from ballbot_ros.config.files import config_folder, read_yaml
from ballbot_ros.control import load_tuning
from ballbot_ros.errors import ConfigurationError, UnstableLoopError
from ballbot_ros.physics import load_robot

GIMBALL, GENTLE, PUBLISHED = load_robot('gimball'), load_tuning('gentle'), load_tuning('published')
SHIPPED = sorted(path.stem for path in (config_folder() / 'hardware').glob('*.yaml'))


def content(**sections):
    """Return what the shipped file of the ODrive says, with some entries changed."""
    whole = dict(read_yaml(config_folder() / 'hardware/gimball_odrive.yaml'))
    for section, entries in sections.items():
        whole[section] = {**whole[section], **entries}
    return whole


def changed(**connection):
    """Return the shipped hardware with another connection, at 500 Hz unless given."""
    hardware = load_hardware('gimball_odrive')
    return replace(hardware, connection=replace(
        hardware.connection, **{'loop_rate': 500.0, **connection}))


@pytest.mark.parametrize('name', [SHIPPED[0], *slow(*SHIPPED[1:])])
def test_shipped_hardware_works_and_says_what_is_assumed(name):
    hardware = load_hardware(name)
    check_feasible(hardware, load_robot(hardware.robot), GENTLE)
    assert hardware.name == name
    assert hardware.provenance['joint.gear_ratio'].source == 'assumed'
    assert not hardware.limits.rearm and hardware.connection.imu_required


@pytest.mark.parametrize('name', SHIPPED)
def test_the_battery_is_one_for_the_motor_of_the_robot(name):
    hardware = load_hardware(name)
    battery, motor = hardware.battery, load_robot(hardware.robot).motor
    assert battery.low_voltage < motor.maximum_voltage < battery.full_voltage


@pytest.mark.parametrize('limits, factor, sent, own', [
    ({}, 1.0, 4.0, 4.0), ({}, 1.25, 3.2, 4.0), ({}, 0.8, 5.0, 5.0),
    ({'torque_limit': 0.3}, 1.0, 0.3, 4.0),
    ({'torque_limit': 0.3, 'drive_torque_limit': 0.0}, 1.0, 0.3, 0.3),
    ({'torque_limit': 6.0}, 1.0, 6.0, 6.0)])
def test_the_drive_may_keep_its_limit_when_that_of_the_file_is_lowered_or_calibrated(
        limits, factor, sent, own):
    options = read_hardware(content(limits=limits, joint={'torque_factor': factor}),
                            'test').options()
    assert options.torque_limit == pytest.approx(sent / 45.0)
    assert options.own_limit == pytest.approx(own / 45.0)


@pytest.mark.parametrize('name', SHIPPED)
def test_the_gear_is_that_of_the_robot(name):
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


# Section, what else it must have, field, the least and the most that it may be, and beyond.
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
def test_each_value_may_be_what_is_safe_and_nothing_beyond(
        section, needs, field, allowed, beyond):
    for value in allowed:
        assert getattr(section(**needs, **{field: value}), field) == value
    for value in beyond:
        reason = 'not_a_choice' if (field, value) == ('direction', 0) else 'out_of_range'
        with refused(reason, field, ConfigurationError):
            section(**needs, **{field: value})


def test_a_file_that_says_no_more_than_it_must_is_one_of_a_careful_bridge():
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


def test_all_that_is_missing_in_any_section_is_named_together():
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


def test_a_port_and_a_baud_rate_that_are_given_replace_those_of_the_file():
    file = load_hardware('gimball_odrive')
    there = file.at('/dev/other')
    assert (there.connection.port, there.connection.baud) == ('/dev/other', 921600)
    assert file.at(baud=9600).connection == replace(file.connection, baud=9600)
    assert file.at() == file


@pytest.mark.parametrize('direction', [1, -1])
def test_the_driver_has_the_torque_limit_of_the_pendulum_at_the_shaft_of_the_motor(direction):
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
    whole = dict(read_yaml(config_folder() / 'hardware/gimball_odrive.yaml'))
    whole['drive'] = {**whole.get('drive', {}), name: 3.0}
    with refused('inconsistent', name):
        read_hardware(whole, 'here')
    with refused('inconsistent', name):
        replace(load_hardware('gimball_odrive'), drive={name: 3.0}).options()


def test_a_setting_that_a_drive_does_not_have_is_refused_in_the_file():
    with refused('unknown_name', 'poles', ConfigurationError):
        replace(load_hardware('gimball_odrive'), drive={'poles': 7}).options()


def test_a_file_that_does_not_exist_is_answered_with_those_that_do():
    with refused('unknown_name', 'hardware', ConfigurationError) as caught:
        load_hardware('gimball_oddrive')
    assert "'gimball_odrive'" in str(caught.value)


def test_the_joint_turns_shaft_into_pendulum_and_back():
    joint = Joint(gear_ratio=50.0, gear_efficiency=0.8, direction=-1, torque_factor=1.25)
    assert joint.joint_angle(100.0) == -2.0
    assert joint.motor_torque(1.0) == pytest.approx(-0.02)
    assert Joint(gear_ratio=50.0, encoder_scale=1.0).joint_angle(2.0) == 2.0


def test_a_line_that_is_too_slow_is_refused_with_the_baud_that_does():
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


def test_a_line_that_no_rate_of_these_gains_fits_is_refused_with_other_gains():
    with refused('inconsistent', 'loop_rate', ConfigurationError):
        check_feasible(changed(baud=115200), GIMBALL, PUBLISHED)


def test_gains_that_diverge_at_the_rate_of_the_loop_are_refused():
    with refused('unstable', 'loop_rate', UnstableLoopError) as caught:
        check_feasible(changed(), GIMBALL, PUBLISHED)
    for value in ('500 Hz', '1 sample', '548 Hz'):
        assert value in str(caught.value)
    check_feasible(changed(loop_rate=700.0), GIMBALL, PUBLISHED)


@pytest.mark.slow
def test_a_baud_rate_that_is_in_the_way_of_that_rate_is_named():
    with refused('unstable', 'baud', UnstableLoopError):
        check_feasible(changed(baud=115200, loop_rate=80.0), GIMBALL, PUBLISHED)


def test_a_watchdog_shorter_than_three_periods_is_refused():
    with refused('inconsistent', 'watchdog', ConfigurationError):
        check_feasible(changed(loop_rate=100.0, watchdog=0.02), GIMBALL, GENTLE)
    check_feasible(changed(loop_rate=100.0, watchdog=0.03), GIMBALL, GENTLE)


def test_on_board_a_torque_is_late_by_what_is_on_the_line_and_a_reserve():
    budget = wire_budget(changed(), GIMBALL)
    assert onboard_lag(changed(), GIMBALL) == pytest.approx(
        10.0 * (budget.bytes_out + budget.bytes_in) / 921600 + RESERVE)


@pytest.mark.parametrize('name, lowest', [
    ('gimball_odrive', 548.0), *slow(('gimball_vesc', 170.0), ('gimball_roboclaw', 154.4))])
def test_the_published_gains_need_this_rate_on_board(name, lowest):
    hardware = load_hardware(name)
    hardware = replace(hardware, connection=replace(hardware.connection, loop_rate=700.0))
    assert check_feasible(hardware, GIMBALL, PUBLISHED, 0, onboard_lag(hardware, GIMBALL)) \
        == pytest.approx(lowest, rel=5e-3)


def test_gains_that_diverge_on_board_are_refused_with_the_delay_in_milliseconds():
    with refused('unstable', 'loop_rate', UnstableLoopError) as caught:
        check_feasible(changed(), GIMBALL, PUBLISHED, 0, onboard_lag(changed(), GIMBALL))
    for value in ('500 Hz', '1.9 ms', '548 Hz'):
        assert value in str(caught.value)


def test_joint_states_come_at_most_at_the_rate_of_the_loop():
    check_joint_state_rate(changed(), 500.0)
    with refused('inconsistent', 'joint_state_rate', ConfigurationError):
        check_joint_state_rate(changed(), 501.0)
