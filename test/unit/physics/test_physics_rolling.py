# SPDX-License-Identifier: Apache-2.0
"""Rolling without slip: what it neglects, and that it is the full model on its slow states."""
from dataclasses import replace
import math

import numpy as np
import pytest

from ballbot_ros.physics import (
    Actuation, ContactOptions, held_at, load_robot, Model, Solver, Terrain)
from ballbot_ros.physics import contact, dynamics, modes
from ballbot_ros.physics.adaptive import Scratch
from ballbot_ros.physics.embedded import ROWS
from ballbot_ros.physics.reduced import rolling, stepping, track

GIMBALL, SHELLBALL = load_robot('gimball'), load_robot('shellball')
NO_ROWS = np.zeros((0, 2 + dynamics.SIZE))
SLOPE, WEDGE = Terrain.slope(0.1), Terrain([[-1.0, 0.0], [0.0, 0.0], [1.0, -0.5]])
LAWS = [Actuation(), Actuation('torque', torque=0.5), Actuation('voltage', voltage=4.0),
        Actuation('velocity', set_rate=1.0, velocity_kp=0.1),
        held_at(0.5, Actuation(position_kp=1.0, position_kd=0.1))]


class Bench:
    """A ball on one feature of the ground, and the arrays of the kernels."""

    def __init__(self, model, actuation, feature, way, speed, angle=0.4, rate=1.0):
        self.model, size = model, len(model.profile)
        self.drive = actuation.drive(model.robot)
        self.room = np.zeros((stepping.ROOM, dynamics.SIZE))
        self.mode, self.table = modes.mode_table(size), contact.contact_table(size)
        self.slow, self.fast, self.track = (
            self.room[row] for row in (stepping.SLOW, stepping.FAST, stepping.TRACK))
        track.lay_track(feature, model.profile, self.track)
        robot = model.robot
        normal = track.normal_at(way, self.track)
        distance = robot.ball_radius - robot.static_penetration * normal[1]
        state = np.zeros(dynamics.SIZE)
        state[[dynamics.X, dynamics.Y]] = track.centre(way, distance, *normal, self.track)
        state[[dynamics.VELOCITY_X, dynamics.VELOCITY_Y]] = speed * normal[1], -speed * normal[0]
        state[dynamics.BALL_RATE] = -speed / distance
        if robot.has_pendulum:
            state[dynamics.PENDULUM_ANGLE], state[dynamics.PENDULUM_RATE] = angle, rate
        rolling.settle(state, self.track, model.numbers, self.slow)
        rolling.measure(0.0, self.slow, 0, self.track, model.numbers, self.drive, self.fast)
        self.state = np.zeros(dynamics.SIZE)
        self.rates = np.zeros(dynamics.SIZE)
        self.follow()

    def follow(self):
        """Put the ball on the slow state's full one."""
        numbers = self.model.numbers
        rolling.follow(0.0, self.slow, 0, self.track, numbers, self.drive,
                       self.room[stepping.FIRST:], self.fast, self.rates)
        rolling.lift(self.slow, self.fast, self.track, numbers, self.state)

    def roll(self, duration, threshold=1.0, tolerance=1e-13):
        """Return the state after some time of rolling, and why it ended."""
        state, size = self.state.copy(), len(self.model.profile)
        numbers, profile = self.model.numbers, self.model.profile
        count = modes.find_mode(
            0.0, state, numbers, profile, self.drive, self.table, self.mode)
        assert stepping.fits(0.0, state, self.mode, count, threshold, numbers, profile, self.drive,
                             self.room)
        reached, _, _, reason = stepping.advance_slow(
            0.0, state, duration, tolerance, threshold, 1e-3, numbers, profile, self.drive,
            self.table, np.zeros((ROWS, dynamics.SIZE)), self.mode, self.room,
            *np.zeros((2, 4 * size + 8), dtype=np.int64), NO_ROWS, 0.0, 1.0, 0,
            np.zeros(5, dtype=np.int64), 10**9)
        return state, reached, reason

    def simulate(self, duration):
        """Return the state after the same time of the full model."""
        model = replace(self.model, solver=Solver('adaptive', tolerance=1e-13, models='full'))
        state = self.state.copy()
        Scratch(len(model.profile)).advance(model, self.drive, state, 0.0, duration)
        return state

    def gap(self, duration):
        """Return how far both are apart after a time [m]."""
        found, reached, reason = self.roll(duration)
        assert (reached, reason) == (duration, stepping.SETTLED)
        return float(np.max(np.abs(found - self.simulate(duration))[[dynamics.X, dynamics.Y]]))


@pytest.mark.parametrize('terrain, feature, way', [(SLOPE, 0, 0.3), (WEDGE, 1, 0.13)])
@pytest.mark.parametrize('options', [
    ContactOptions(), ContactOptions(friction_ramp='smooth', slip_lever='radius')])
@pytest.mark.parametrize('actuation', LAWS, ids=lambda law: law.law)
def test_the_slow_state_changes_as_the_full_model_changes_it(terrain, feature, way, options,
                                                             actuation):
    bench = Bench(Model(GIMBALL, terrain, options), actuation, feature, way, 0.3)
    model, full, later = bench.model, np.zeros(dynamics.SIZE), np.zeros((2, dynamics.SIZE))
    dynamics.derivative(0.0, bench.state, model.numbers, model.profile, bench.drive, bench.table,
                        full)
    for side, sign in enumerate((-1.0, 1.0)):
        rolling.settle(bench.state + sign * 1e-6 * full, bench.track, model.numbers, later[side])
    found = (later[1] - later[0]) / 2e-6
    assert found == pytest.approx(bench.rates, abs=1e-6)


@pytest.mark.parametrize('terrain, feature, way, duration', [
    (Terrain.flat(), 0, 0.0, 1.5), (SLOPE, 0, 0.0, 1.0), (WEDGE, 1, 0.05, 0.15)],
    ids=['floor', 'slope', 'edge'])
def test_it_comes_to_the_full_model_as_the_contact_hardens(terrain, feature, way, duration):
    gaps = []
    for harder in (1.0, 16.0):
        robot = replace(GIMBALL, contact_stiffness=harder * GIMBALL.contact_stiffness,
                        contact_damping=math.sqrt(harder) * GIMBALL.contact_damping,
                        slip_threshold=GIMBALL.slip_threshold / harder)
        gaps.append(Bench(Model(robot, terrain), Actuation(), feature, way, 0.3).gap(duration))
    assert gaps[0] < 1e-5 and gaps[1] < gaps[0] / 16.0


def test_a_ball_on_a_slope_speeds_up_as_the_books_say_less_its_creep():
    robot = replace(SHELLBALL, rolling_friction=0.0)
    model = Model(robot, SLOPE)
    bench = Bench(model, Actuation(), 0, 0.0, 0.2)
    lever = robot.ball_radius - robot.static_penetration * math.cos(0.1)
    speeding = -robot.gravity * math.sin(0.1) / (
        1.0 + robot.ball_inertia / (robot.ball_mass * lever**2))
    # With a constant speeding up the slip is constant: nothing is neglected.
    assert bench.fast[rolling.NEGLECTED] < 1e-15
    state, _, _ = bench.roll(0.2)
    speed = math.hypot(*state[[dynamics.VELOCITY_X, dynamics.VELOCITY_Y]])
    first = math.hypot(*bench.state[[dynamics.VELOCITY_X, dynamics.VELOCITY_Y]])
    assert speed == pytest.approx(first + 0.2 * speeding, abs=1e-12)
    assert 1e-4 < abs(bench.fast[rolling.SLIP]) < robot.slip_threshold
    assert state == pytest.approx(bench.simulate(0.2), abs=1e-9)


def test_the_losses_balance_the_energy():
    bench = Bench(Model(GIMBALL, Terrain.flat()), Actuation('torque', torque=0.3), 0, 0.0, 0.3)
    state, _, _ = bench.roll(2.0)

    def ledger(vector):
        numbers = bench.model.numbers
        return (dynamics.kinetic_energy(vector, numbers)
                + dynamics.potential_energy(vector, numbers)
                + contact.spring_energy(numbers, bench.model.profile, bench.table,
                                        vector[dynamics.X], vector[dynamics.Y])
                + vector[8:12].sum() - vector[12])
    assert ledger(state) == pytest.approx(ledger(bench.state), abs=1e-5)


@pytest.mark.parametrize('terrain, feature, way, speed, reason', [
    (Terrain.step(0.03, at=0.4), 0, 0.6, 0.5, stepping.GROUND),
    (Terrain([[-1.0, 0.0], [0.0, 0.0], [1.0, -0.1]]), 1, 0.01, 0.3, stepping.GROUND),
    (WEDGE, 1, 0.05, 0.3, stepping.CONE)], ids=['step', 'past an edge', 'steep edge'])
def test_a_monitor_ends_it_before_an_assumption_breaks(terrain, feature, way, speed, reason):
    bench = Bench(Model(GIMBALL, terrain), Actuation(), feature, way, speed, 0.0, 0.0)
    state, reached, why = bench.roll(3.0, tolerance=1e-9)
    assert 0.01 < reached < 3.0 and why == reason
    # At the rim of the cone the slip no longer follows so well.
    assert state == pytest.approx(bench.simulate(reached), abs=1e-3)
    count = modes.find_mode(reached, state, bench.model.numbers, bench.model.profile, bench.drive,
                            bench.table, bench.mode)
    assert count == 1 and tuple(bench.mode[0]) == (feature, 1, 0)


def test_it_is_not_entered_while_the_dent_rings():
    model = Model(GIMBALL, Terrain.flat())
    bench = Bench(model, Actuation(), 0, 0.0, 0.5, 0.0, 0.0)

    def fits(state, threshold):
        count = modes.find_mode(0.0, state, model.numbers, model.profile, bench.drive,
                                bench.table, bench.mode)
        return stepping.fits(0.0, state, bench.mode, count, threshold, model.numbers,
                             model.profile, bench.drive, bench.room)
    ringing = bench.state.copy()
    ringing[dynamics.Y] += 2e-6
    assert fits(bench.state, 1e-6)
    assert fits(ringing, 4e-6) and not fits(ringing, 1e-6)
