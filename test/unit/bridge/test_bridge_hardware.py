# SPDX-License-Identifier: Apache-2.0
"""Hardware files, and loops that cannot work and say so."""
from dataclasses import replace

import pytest

from ballbot_ros.bridge.feasibility import check_feasible, wire_budget
from ballbot_ros.bridge.hardware_file import Joint, load_hardware, read_hardware
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
    """Return the shipped hardware with another connection."""
    hardware = load_hardware('gimball_odrive')
    return replace(hardware, connection=replace(hardware.connection, **connection))


@pytest.mark.parametrize('name', SHIPPED)
def test_shipped_hardware_works_and_says_what_is_assumed(name):
    hardware = load_hardware(name)
    check_feasible(hardware, load_robot(hardware.robot), GENTLE)
    assert hardware.name == name
    assert hardware.provenance['joint.gear_ratio'].source == 'assumed'
    assert not hardware.limits.rearm and hardware.connection.imu_required


@pytest.mark.parametrize('name', SHIPPED)
def test_the_gear_is_that_of_the_robot(name):
    motor = GIMBALL.motor
    joint = load_hardware(name).joint
    assert (joint.gear_ratio, joint.gear_efficiency) == (motor.gear_ratio, motor.gear_efficiency)


@pytest.mark.parametrize('sections, complaint', [
    ({'connection': {'protocol': 'oddrive'}}, "protocol must be one of .* did you mean 'odrive'"),
    ({'connection': {'bauds': 3}}, "'bauds' is not known here; did you mean 'baud'"),
    ({'limits': {'torque_limit': -1.0}}, 'limits: torque_limit must be more than 0'),
    ({'limits': {'torque_limit': float('nan')}}, 'torque_limit'),
    ({'limits': {'on_timeout': 'hope'}}, 'coast, brake, settle'),
    ({'limits': {'torque_limit': {'value': 4.0, 'unit': 'Nm'}}}, "unit must be 'N m'"),
    ({'joint': {'direction': 0}}, 'direction must be 1 or -1'),
    ({'drive': {'axes': 1}}, 'axes'), ({'drive': {'axis': 7}}, 'axis')])
def test_what_is_wrong_in_a_file_is_named(sections, complaint):
    with pytest.raises(ConfigurationError, match=complaint):
        read_hardware(content(**sections), 'my.yaml')


def test_a_file_that_does_not_exist_is_answered_with_those_that_do():
    with pytest.raises(ConfigurationError, match='no hardware named .* known are gimball_odrive'):
        load_hardware('gimball_oddrive')


def test_the_joint_turns_shaft_into_pendulum_and_back():
    joint = Joint(gear_ratio=50.0, gear_efficiency=0.8, direction=-1, torque_factor=1.25)
    assert joint.joint_angle(100.0) == -2.0
    assert joint.motor_torque(1.0) == pytest.approx(-0.02)
    assert Joint(gear_ratio=50.0, encoder_scale=1.0).joint_angle(2.0) == 2.0


def test_a_line_that_is_too_slow_is_refused_with_the_baud_that_does():
    budget = wire_budget(changed())
    assert budget.duration(921600) == pytest.approx(
        10.0 * (budget.bytes_out + budget.bytes_in) / 921600)
    top = int(budget.highest_rate(115200))
    with pytest.raises(ConfigurationError, match=f'115200 baud carry {top} Hz at most .* set baud '
                       f'to 921600, or set loop_rate to {top} Hz or less'):
        check_feasible(changed(baud=115200), GIMBALL, GENTLE)
    check_feasible(changed(baud=115200, loop_rate=float(top)), GIMBALL, GENTLE)


def test_a_line_that_no_rate_of_these_gains_fits_is_refused_with_other_gains():
    with pytest.raises(ConfigurationError, match='gentler gains, for these need 548 Hz'):
        check_feasible(changed(baud=115200), GIMBALL, PUBLISHED)


def test_gains_that_diverge_at_the_rate_of_the_loop_are_refused():
    with pytest.raises(UnstableLoopError, match='diverges .* at 500 Hz with 1 sample .* 548 Hz'):
        check_feasible(changed(), GIMBALL, PUBLISHED)
    check_feasible(changed(loop_rate=700.0), GIMBALL, PUBLISHED)


def test_a_watchdog_shorter_than_three_periods_is_refused():
    with pytest.raises(ConfigurationError, match='three periods'):
        check_feasible(changed(loop_rate=100.0, watchdog=0.02), GIMBALL, GENTLE)
