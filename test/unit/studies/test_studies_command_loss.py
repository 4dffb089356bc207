# SPDX-License-Identifier: Apache-2.0
"""A ball whose commands stop: closed forms of its motion, and the table of the document."""
from dataclasses import replace
import math
from pathlib import Path

import numpy as np
import pytest
from refusals import refused

from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.cli import main
from ballbot_ros.cli.on_timeout import heading, row
from ballbot_ros.physics import load_robot
from ballbot_ros.studies.command_loss import held_angle, lose_commands, Scenario, scenarios

HARDWARE = load_hardware('gimball_odrive')
ROBOT = load_robot('gimball')
SLOPE = math.radians(2.0)
DOCUMENT = Path(__file__).resolve().parents[3] / 'docs' / 'hardware_bridge.md'


def with_limits(**changes):
    """Return the hardware with changed limits."""
    return replace(HARDWARE, limits=replace(HARDWARE.limits, **changes))


@pytest.mark.slow
@pytest.mark.parametrize('policy, damping', [('coast', 0.0), ('brake', 0.3)])
def test_on_a_slope_the_ball_reaches_the_speed_at_which_friction_balances_its_weight(
        policy, damping):
    # About the contact: M g r sin(slope) = (c1 + c2 + damping) v / r with the dented radius r,
    # with joint friction on the pendulum; and the contact creeps.
    response = lose_commands(with_limits(damping_time=60.0), Scenario(policy, -SLOPE, 0.0), 25.0)
    friction = ROBOT.rolling_friction + ROBOT.joint_friction + damping
    lever = ROBOT.ball_radius - ROBOT.static_penetration
    speed = ROBOT.weight * lever**2 * math.sin(SLOPE) / friction
    creep = ROBOT.slip_threshold * math.tan(SLOPE) / ROBOT.surface_friction
    assert response.speed[-1] == pytest.approx(speed + creep, rel=1e-3)
    # The pendulum then has the angle that holds the ball at this speed.
    angle = held_angle(ROBOT, -SLOPE, speed / ROBOT.ball_radius)
    assert response.pendulum_angle[-1] == pytest.approx(angle, rel=0.01)
    assert response.hangs_after is None


@pytest.mark.parametrize('slope, speed', [(SLOPE, 0.0), (-SLOPE, 0.6), (0.0, 0.6), (SLOPE, 0.6)])
def test_before_the_command_timeout_the_motion_does_not_change(slope, speed):
    response = lose_commands(HARDWARE, Scenario('brake', slope, speed), 0.2)
    fresh = response.time < HARDWARE.limits.command_timeout
    assert response.speed[fresh] == pytest.approx(speed, abs=0.012)
    assert np.ptp(response.pendulum_angle[fresh]) < math.radians(0.5)
    assert not response.work[fresh].any() and abs(response.work[~fresh]).max() > 0.0


def test_uphill_at_rest_is_the_mirror_image_of_downhill():
    down, up = (lose_commands(HARDWARE, Scenario('settle', slope, 0.0), 1.0)
                for slope in (-SLOPE, SLOPE))
    assert up.distance == pytest.approx(-down.distance, abs=1e-6)
    assert up.pendulum_angle == pytest.approx(-down.pendulum_angle, abs=1e-6)
    assert up.work == pytest.approx(down.work, abs=1e-6)


def test_a_brake_only_dissipates_energy_and_settle_may_supply_some():
    brake, settle = (lose_commands(HARDWARE, Scenario(policy, 0.0, 0.6), 3.0)
                     for policy in ('brake', 'settle'))
    assert brake.energy_given == 0.0 and (np.diff(brake.work) <= 0.0).all()
    assert settle.energy_given > 0.1


def test_after_the_damping_time_the_motor_does_no_work():
    response = lose_commands(with_limits(damping_time=0.5), Scenario('brake', 0.0, 0.6), 1.5)
    over = response.time > 0.5 + HARDWARE.limits.command_timeout + 2e-3
    assert np.ptp(response.work[over]) == 0.0 < np.ptp(response.work[~over])


def test_the_error_is_far_below_the_printed_resolution():
    assert lose_commands(HARDWARE, Scenario('coast', -math.radians(5.0), 0.6), 2.0).error < 1e-6


def test_the_held_angle_balances_the_slope():
    # On 5.92 degrees GimBall holds its pendulum level; M2 g e = M g R sin(slope).
    steepest = math.asin(ROBOT.largest_gravity_torque / (ROBOT.weight * ROBOT.ball_radius))
    assert math.degrees(steepest) == pytest.approx(5.92, abs=0.01)
    assert held_angle(ROBOT, steepest - 1e-9, 0.0) == pytest.approx(math.pi / 2.0, abs=1e-3)
    assert held_angle(ROBOT, 0.0, 0.0) == 0.0
    with refused('out_of_range', 'slope'):
        held_angle(ROBOT, math.radians(6.0), 0.0)


def test_every_start_is_combined_with_every_policy():
    found = list(scenarios(0.6, [0.0, SLOPE], ('coast', 'brake')))
    assert len(found) == len(set(found)) == 2 * (2 + 3)
    assert {(item.slope, item.speed) for item in found} == {
        (0.0, 0.0), (-SLOPE, 0.0), (0.0, 0.6), (-SLOPE, 0.6), (SLOPE, 0.6)}
    assert len(list(scenarios(0.0, [0.0, SLOPE]))) == 2 * 3


def test_the_table_of_the_document_agrees_with_the_printed_rows():
    lines = DOCUMENT.read_text(encoding='utf-8').splitlines()
    begin = lines.index(next(heading()))
    assert lines[begin:begin + 2] == list(heading())
    rows = len(list(scenarios(0.6, np.radians([0.0, 1.0, 2.0, 5.0]))))
    table = lines[begin + 2:begin + 2 + rows]
    for item in (Scenario('settle', 0.0, 0.6), Scenario('coast', -math.radians(5.0), 0.6),
                 Scenario('brake', math.radians(1.0), 0.6)):
        assert row(lose_commands(HARDWARE, item)) in table


def test_the_command_prints_the_table(capsys):
    words = ['on-timeout', '--slopes-deg', '0', '--speed', '0', '--policy', 'coast',
             '--damping-time', '5']
    assert main(words) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith('gimball_odrive: damping 0.3 N m s/rad for 5 s')
    assert lines[2:4] == list(heading()) and lines[4].startswith('| rest    | level  | coast  |')
    assert len(lines) == 5


@pytest.mark.parametrize('words, reason, field', [
    (['--slopes-deg', '7'], 'out_of_range', '--slopes-deg'),
    (['--slopes-deg', 'nan'], 'wrong_type', '--slopes-deg'),
    (['--speed', '-1'], 'out_of_range', '--speed'),
    (['--damping', 'nan'], 'not_finite', 'damping'),
    (['--damping-time', '61'], 'out_of_range', 'damping_time'),
    (['--hardware', 'nothing'], 'unknown_name', 'hardware'),
    (['--policy', 'hope'], 'usage', '--policy')])
def test_impossible_values_are_refused_before_output(words, reason, field, refuses):
    refuses(reason, field, 'on-timeout', *words)
