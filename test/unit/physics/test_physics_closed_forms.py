# SPDX-License-Identifier: Apache-2.0
"""Simulated motions agree with their closed-form solutions."""
from dataclasses import replace
import math

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.special import ellipk

from ballbot_ros.physics import (
    Actuation, ContactOptions, load_robot, Model, simulate, Solver, State, Terrain)

GIMBALL = load_robot('gimball')
SHELLBALL = load_robot('shellball')
FREE = Actuation()


def crossings(time, values):
    """Return the times of the upward zero crossings of `values`, by cubic interpolation."""
    found = []
    for index in np.flatnonzero((values[:-1] < 0.0) & (values[1:] >= 0.0)):
        part = slice(max(index - 1, 0), index + 3)
        found.append(float(np.polyval(
            np.polyfit(values[part], time[part] - time[index], 3), 0.0) + time[index]))
    return np.array(found)


def rolling_radius(robot):
    """Return the distance from the centre to a level floor at rest [m]."""
    return robot.ball_radius - robot.static_penetration


# The pendulum -----------------------------------------------------------------------------

@pytest.mark.parametrize('amplitude_deg', [1.0, 30.0, 90.0, 150.0, 175.0])
def test_period_of_the_pendulum_about_a_fixed_pivot(amplitude_deg):
    # A ball far heavier than its pendulum does not move.
    heavy = replace(GIMBALL, ball_mass=1e9, ball_inertia=1e9, contact_stiffness=1e12,
                    contact_damping=1e10, joint_friction=0.0, rolling_friction=0.0)
    model = Model(heavy, Terrain.flat())
    amplitude = math.radians(amplitude_deg)
    run = simulate(model, model.at_rest(0.0, 0.0, -amplitude), FREE, 8.0, accuracy=1e-7)
    moment = heavy.pendulum_mass * heavy.pendulum_length
    inertia = heavy.pendulum_inertia + moment * heavy.pendulum_length
    period = 4.0 * math.sqrt(inertia / (moment * heavy.gravity)) * ellipk(
        math.sin(0.5 * amplitude)**2)
    rising = crossings(run['time'], run['pendulum_angle'])
    assert len(rising) > 1
    assert np.diff(rising) == pytest.approx(period, rel=1e-6)


def test_frequency_of_small_oscillations_of_a_rolling_ball():
    # Rolling without slip: two degrees of freedom, one of which is a free translation.  The
    # friction is high so that the creep of eq. (9) is negligible.
    robot = replace(GIMBALL, joint_friction=0.0, rolling_friction=0.0, surface_friction=5.0)
    model = Model(robot, Terrain.flat())
    run = simulate(model, model.at_rest(0.0, 0.0, -1e-3), FREE, 8.0)
    moment = robot.pendulum_mass * robot.pendulum_length
    swing = robot.pendulum_inertia + moment * robot.pendulum_length
    moved = robot.total_mass + robot.ball_inertia / rolling_radius(robot)**2
    frequency = math.sqrt(moment * robot.gravity / (swing - moment**2 / moved))
    rising = crossings(run['time'], run['pendulum_angle'])
    assert len(rising) > 5
    assert np.diff(rising) == pytest.approx(2.0 * math.pi / frequency, rel=1e-5)
    # The ball moves against the pendulum because their total momentum is conserved.
    ratio = np.polyfit(run['pendulum_rate'], run['velocity_x'], 1)[0]
    assert ratio == pytest.approx(-moment / moved, rel=1e-3)


# In the air -------------------------------------------------------------------------------

def flight(robot, pendulum_rate=5.0, **changes):
    """Return the robot and a run of one second of flight, high above the ground."""
    robot = replace(robot, **changes)
    start = State(y=50.0, velocity_x=1.3, velocity_y=2.0, ball_rate=-7.0, pendulum_angle=0.4,
                  pendulum_rate=pendulum_rate if robot.has_pendulum else 0.0)
    return robot, simulate(Model(robot, Terrain.flat()), start, FREE, 1.0)


def centre_of_mass(robot, run):
    """Return the path of the common centre of mass [m]."""
    share = robot.pendulum_mass * robot.pendulum_length / robot.total_mass
    return (run['x'] + share * np.sin(run['pendulum_angle']),
            run['y'] - share * np.cos(run['pendulum_angle']))


@pytest.mark.parametrize('robot', [GIMBALL, SHELLBALL], ids=lambda robot: robot.name)
def test_centre_of_mass_flies_along_a_parabola(robot):
    robot, run = flight(robot)
    time = run['time']
    x, y = centre_of_mass(robot, run)
    share = robot.pendulum_mass * robot.pendulum_length / robot.total_mass
    rate = run['pendulum_rate'][0]
    velocity = 1.3 + share * rate * math.cos(0.4), 2.0 + share * rate * math.sin(0.4)
    np.testing.assert_allclose(x, x[0] + velocity[0] * time, atol=1e-10)
    np.testing.assert_allclose(
        y, y[0] + velocity[1] * time - 0.5 * robot.gravity * time**2, atol=1e-10)


def test_all_rates_are_constant_in_flight_without_friction():
    _, run = flight(GIMBALL, joint_friction=0.0, rolling_friction=0.0)
    np.testing.assert_allclose(run['ball_rate'], -7.0, atol=1e-12)
    np.testing.assert_allclose(run['pendulum_rate'], 5.0, atol=1e-12)


def test_only_friction_changes_the_rates_of_ball_and_pendulum_in_flight():
    robot, run = flight(GIMBALL)
    swing = robot.pendulum_inertia + (robot.pendulum_mass * robot.pendulum_length**2
                                      * robot.ball_mass / robot.total_mass)
    c1, c2 = robot.rolling_friction, robot.joint_friction
    matrix = np.array([[-(c1 + c2) / robot.ball_inertia, c2 / robot.ball_inertia],
                       [c2 / swing, -c2 / swing]])
    rates = np.array([expm(matrix * time) @ [-7.0, 5.0] for time in run['time'][::100]])
    np.testing.assert_allclose(run['ball_rate'][::100], rates[:, 0], rtol=1e-9)
    np.testing.assert_allclose(run['pendulum_rate'][::100], rates[:, 1], rtol=1e-9)


# Against the ground -----------------------------------------------------------------------

def bounce(pulling, step=2e-6):
    """Return exit speed over entry speed and the contact time [s], without gravity."""
    robot = replace(SHELLBALL, gravity=0.0)
    model = Model(robot, Terrain.flat(), ContactOptions(pulling=pulling), Solver(step=step))
    start = State(y=robot.ball_radius, velocity_y=-1.0)
    run = simulate(model, start, FREE, 0.02, step)
    # Contact ends when the force does; if the damper may pull, when the ball leaves the ground.
    force = run['surface_normal_force']
    inside = run['penetration'] > 0.0 if pulling else force > 0.0
    return run['velocity_y'][-1], step * np.count_nonzero(inside)


@pytest.mark.parametrize('pulling', [True, False])
def test_restitution_and_contact_time(pulling):
    # If the damper may not pull, the force reaches zero 2 asin(zeta) of phase before the end of
    # the half wave: it dissipates less, and the ball separates while its shell is deformed.
    zeta = SHELLBALL.damping_ratio
    root = math.sqrt(1.0 - zeta**2)
    natural = math.sqrt(SHELLBALL.contact_stiffness / SHELLBALL.ball_mass)
    phase = math.pi if pulling else math.pi - 2.0 * math.asin(zeta)
    ratio, duration = bounce(pulling)
    assert ratio == pytest.approx(math.exp(-zeta / root * phase), rel=1e-4)
    assert duration == pytest.approx(phase / (natural * root), rel=1e-3)
    assert SHELLBALL.restitution == pytest.approx(math.exp(-math.pi * zeta / root), rel=1e-14)
    assert pulling or ratio > SHELLBALL.restitution * 1.01


def test_the_static_penetration_is_the_weight_over_the_stiffness(robot):
    model = Model(robot, Terrain.flat())
    depth = robot.total_mass * 9.81 / robot.contact_stiffness
    assert robot.static_penetration == pytest.approx(depth, rel=1e-14)
    start = model.at_rest(0.3)
    assert start.y == pytest.approx(robot.ball_radius - depth, abs=1e-15)
    # A ball released above this height settles there.
    run = simulate(model, start._replace(y=start.y + 0.01), FREE, 4.0, accuracy=1e-8)
    assert run['penetration'][-1] == pytest.approx(depth, rel=1e-6)
    assert run['contact_force_y'][-1] == pytest.approx(robot.weight, rel=1e-6)


def test_sliding_turns_into_rolling():
    robot = replace(SHELLBALL, rolling_friction=0.0)
    model = Model(robot, Terrain.flat())
    speed, radius = 1.5, rolling_radius(robot)
    run = simulate(model, model.at_rest(0.0)._replace(velocity_x=speed), FREE, 1.0, 1e-4)
    ratio = robot.ball_inertia / (robot.ball_mass * radius**2)  # kappa
    # Full friction acts until the slip falls to the threshold; then the slip decays.
    slip = run['slip_velocity']
    sliding = slip > robot.slip_threshold
    closing = robot.surface_friction * robot.gravity * (1.0 + 1.0 / ratio)
    assert run['time'][sliding][-1] == pytest.approx(
        (speed - robot.slip_threshold) / closing, abs=1.5e-4)
    np.testing.assert_allclose(
        run['velocity_x'][sliding],
        speed - robot.surface_friction * robot.gravity * run['time'][sliding], rtol=1e-9)
    after = np.flatnonzero(~sliding)[0] + 200
    assert slip[after] == pytest.approx(slip[after - 200] * math.exp(
        -closing / robot.slip_threshold * 0.02), rel=1e-2)
    # The angular momentum about the contact point is conserved.
    assert run['velocity_x'][-1] == pytest.approx(speed / (1.0 + ratio), rel=1e-9)
    assert run['ball_rate'][-1] * radius == pytest.approx(-run['velocity_x'][-1], rel=1e-9)


def test_rolling_resistance_slows_a_free_ball_through_the_creep_of_its_contact():
    # Below the threshold friction is viscous, b = mu M g / threshold, so the system is linear.
    robot, radius = SHELLBALL, rolling_radius(SHELLBALL)
    model = Model(robot, Terrain.flat())
    run = simulate(model, model.at_rest(0.0, 1.0), FREE, 3.0)
    assert np.abs(run['slip_velocity']).max() < robot.slip_threshold
    grip = robot.surface_friction * robot.weight / robot.slip_threshold
    mass, inertia, resistance = robot.ball_mass, robot.ball_inertia, robot.rolling_friction
    matrix = np.array([
        [-grip / mass, -grip * radius / mass],
        [-grip * radius / inertia, -(grip * radius**2 + resistance) / inertia]])
    expected = np.array([
        expm(matrix * time) @ [1.0, -1.0 / radius] for time in run['time'][::50]])
    np.testing.assert_allclose(run['velocity_x'][::50], expected[:, 0], rtol=1e-9)
    np.testing.assert_allclose(run['ball_rate'][::50], expected[:, 1], rtol=1e-9)
    # The slow mode is rolling with a time constant of (M R^2 + J) / c1.
    tail = np.polyfit(run['time'][500:], np.log(run['velocity_x'][500:]), 1)[0]
    assert tail == pytest.approx(-resistance / (mass * radius**2 + inertia), rel=1e-3)


# Slopes -----------------------------------------------------------------------------------

@pytest.mark.parametrize('angle_deg', [-1.0, -5.0, -15.0])
def test_acceleration_and_creep_down_a_slope(angle_deg):
    robot = replace(SHELLBALL, rolling_friction=0.0)
    angle = math.radians(angle_deg)
    model = Model(robot, Terrain.slope(angle))
    run = simulate(model, model.at_rest(0.0), FREE, 3.0)
    settled = run['time'] >= 2.0
    pressed = robot.weight * math.cos(angle)
    radius = robot.ball_radius - pressed / robot.contact_stiffness
    ratio = robot.ball_inertia / (robot.ball_mass * radius**2)
    along = run['velocity_x'] * math.cos(angle) + run['velocity_y'] * math.sin(angle)
    acceleration = -robot.gravity * math.sin(angle) / (1.0 + ratio)
    slope, _ = np.polyfit(run['time'][settled], along[settled], 1)
    assert slope == pytest.approx(acceleration, rel=1e-8)
    # Friction accelerates the rotation, so by eq. (9) the ball slips at a small constant speed.
    friction = robot.ball_mass * acceleration * ratio
    np.testing.assert_allclose(
        run['slip_velocity'][settled],
        robot.slip_threshold * friction / (robot.surface_friction * pressed), rtol=1e-6)


def test_a_ball_on_a_steep_slope_accelerates_like_a_sliding_body():
    # On slopes steeper than tan(angle) = mu (1 + 1/kappa), friction cannot prevent slip.
    robot = replace(SHELLBALL, rolling_friction=0.0)
    ratio = robot.ball_inertia / (robot.ball_mass * robot.ball_radius**2)
    limit = math.atan(robot.surface_friction * (1.0 + 1.0 / ratio))
    angle = limit + math.radians(5.0)
    model = Model(robot, Terrain.slope(-angle))
    run = simulate(model, model.at_rest(0.0), FREE, 2.0)
    settled = run['time'] >= 1.5
    along = run['velocity_x'] * math.cos(angle) - run['velocity_y'] * math.sin(angle)
    slope, _ = np.polyfit(run['time'][settled], along[settled], 1)
    assert slope == pytest.approx(robot.gravity * (
        math.sin(angle) - robot.surface_friction * math.cos(angle)), rel=1e-6)


@pytest.mark.parametrize('share, climbs', [(0.9, True), (0.97, True), (1.03, False), (1.1, False)])
def test_a_level_pendulum_climbs_slopes_below_the_slope_limit_only(share, climbs):
    moment = GIMBALL.pendulum_mass * GIMBALL.pendulum_length
    limit = math.asin(moment / (GIMBALL.total_mass * GIMBALL.ball_radius))
    assert GIMBALL.slope_limit == pytest.approx(limit, rel=1e-14)
    model = Model(GIMBALL, Terrain.slope(share * limit))
    level = Actuation('position', set_angle=math.pi / 2)
    run = simulate(model, model.at_rest(0.0, 0.0, math.pi / 2), level, 5.0)
    assert (run['velocity_x'][-1] > 0.0) == climbs
    assert (run['x'][-1] > 0.0) == climbs


# The motor --------------------------------------------------------------------------------

def test_stall_torque_of_the_motor():
    motor = GIMBALL.motor
    stall = (motor.gear_ratio * motor.gear_efficiency * motor.torque_constant
             * 6.0 / motor.resistance)
    model = Model(GIMBALL, Terrain.flat())
    drive = Actuation('voltage', voltage=6.0).actuator(GIMBALL)
    assert model.torque(State(), drive) == pytest.approx(stall, rel=1e-14)
    # At full voltage the torque limit of the gear is below the motor torque.
    full = Actuation('voltage', voltage=12.0).actuator(GIMBALL)
    assert model.torque(State(), full) == motor.maximum_torque < 2.0 * stall


def test_idle_speed_of_the_motor():
    motor = GIMBALL.motor
    idle = 6.0 / (motor.gear_ratio * motor.speed_constant)
    model = Model(GIMBALL, Terrain.flat())
    drive = Actuation('voltage', voltage=6.0).actuator(GIMBALL)
    assert model.torque(State(ball_rate=-idle), drive) == pytest.approx(0.0, abs=1e-14)
    robot = replace(GIMBALL, joint_friction=0.0, rolling_friction=0.0)
    model = Model(robot, Terrain.flat())
    run = simulate(model, model.at_rest(0.0), Actuation('voltage', voltage=6.0), 60.0, 1e-2)
    assert -run['ball_rate'][-1] == pytest.approx(idle, rel=1e-6)


def test_steady_speed_under_a_voltage_with_all_friction():
    # Nothing accelerates, so the floor exerts no friction and the pendulum balances c1 alone.
    motor, robot = GIMBALL.motor, GIMBALL
    back = motor.gear_ratio * motor.speed_constant
    per_volt = motor.gear_ratio * motor.gear_efficiency * motor.torque_constant / motor.resistance
    rate = per_volt * 6.0 / (per_volt * back + robot.joint_friction + robot.rolling_friction)
    model = Model(robot, Terrain.flat())
    run = simulate(model, model.at_rest(0.0), Actuation('voltage', voltage=6.0), 60.0, 1e-2)
    assert -run['ball_rate'][-1] == pytest.approx(rate, rel=1e-6)
    assert run['velocity_x'][-1] == pytest.approx(rate * rolling_radius(robot), rel=1e-6)
    lean = robot.rolling_friction * rate / robot.largest_gravity_torque
    assert math.sin(run['pendulum_angle'][-1]) == pytest.approx(lean, rel=1e-4)


def test_the_velocity_law_reaches_its_set_rate():
    # The integral removes the error, but slowly, because the oscillation is lightly damped.
    model = Model(GIMBALL, Terrain.flat(), solver=Solver(step=1e-3))
    drive = Actuation('velocity', set_rate=4.0, velocity_ki=5.0, gravity_compensation=False)
    run = simulate(model, model.at_rest(0.0), drive, 400.0, 1e-1)
    joint_rate = run['pendulum_rate'] - run['ball_rate']
    assert joint_rate[-1] == pytest.approx(4.0, rel=1e-6)


def test_position_law_holds_the_absolute_angle():
    model = Model(GIMBALL, Terrain.flat())
    drive = Actuation('position', set_angle=0.5)
    run = simulate(model, model.at_rest(0.0), drive, 0.5, 1e-3)
    # The proportional error against the accelerating ball at kP = 40 N m/rad is within 0.15 rad.
    assert run['pendulum_angle'][-1] == pytest.approx(0.5, abs=0.15)
    unlimited = Actuation('position', set_angle=0.5, position_kp=4000.0, position_kd=100.0)
    run = simulate(model, model.at_rest(0.0), unlimited, 0.5, 1e-3)
    assert run['pendulum_angle'][-1] == pytest.approx(0.5, abs=1e-3)
