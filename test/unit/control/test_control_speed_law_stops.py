# SPDX-License-Identifier: Apache-2.0
"""Stops and places by the speed law on the full model, as the decision runs it: at 50 Hz."""
from copy import copy, deepcopy
from functools import cache
import math

import numpy as np
import pytest
from tiers import pairs

from ballbot_ros.control import (
    JointReadings, load_tuning, Mode, PendulumController, SetPoint, speed_law)
from ballbot_ros.physics import load_robot
from ballbot_ros.physics.simulation.scene import read_scene
from ballbot_ros.plant import Plant

GIMBALL = load_robot('gimball')
RATE, EVERY = 500, 10  # control periods per second, and from one set angle to the next
TUNINGS = ('published', 'gentle')
# From odometry to a set angle that acts [s]: a period on its way, and half of one between two.
REACTION = 1.5 * EVERY / RATE


class Course:
    """
    GimBall on a slope, driven by the speed law from odometry that is a period old.

    The pendulum is not measured: its angle is taken from the set angles.
    """

    def __init__(self, slope, tuning='published', noise=0.0, **changes):
        self.slope, tuning = math.radians(slope), load_tuning(tuning)
        self.plant = Plant(read_scene({
            'robot': 'gimball', 'robot_changes': changes, 'duration': 1.0,
            'terrain': [{'slope': {'length': 60.0, 'angle_deg': slope}}],
            'initial': {'x': 30.0}, 'solver': {'step': 2e-4}}, 'test', 'test'), RATE)
        self.law = speed_law.SpeedLaw.tuned(GIMBALL, tuning)[:]
        self.controller = PendulumController(GIMBALL, tuning)
        self.state = speed_law.speed_law_start(0.0, 0.0, self.slope, self.law)
        self.angles = [0.0]
        self.noise, self.random = noise, np.random.default_rng(1)
        self.begin = self.plant.state.x

    def copy(self):
        """Return a course that continues from here."""
        other = copy(self)
        other.plant, other.controller = copy(self.plant), deepcopy(self.controller)
        other.angles, other.random = [*self.angles], deepcopy(self.random)
        return other

    @property
    def speed(self):
        """Return the speed along the slope [m/s]."""
        return self.plant.state.velocity_x / math.cos(self.slope)

    @property
    def way(self):
        """Return how far the ball is along the slope [m]."""
        return (self.plant.state.x - self.begin) / math.cos(self.slope)

    def run(self, duration, step):
        """Drive for a time by `step`, of state, speed, way; return time, way, speed by rows."""
        rows = []
        for period in range(round(duration * RATE)):
            if period % EVERY == 0:
                seen = self.speed + self.noise * self.random.standard_normal()
                self.state, angle = step(self.state, seen, self.way)
                self.controller.give(SetPoint(Mode.HOLD, self.angles[-1], self.plant.time))
                self.angles.append(angle)
            now = self.plant.state
            self.plant.advance(self.controller.torque(JointReadings(
                now.time, now.ball_angle, now.joint_angle, now.ball_rate, now.joint_rate)))
            rows.append((self.plant.time, self.way, self.speed))
        return np.array(rows)

    def at_speed(self, speed, lean=1.4):
        """Return the step that drives at a speed."""
        return lambda state, seen, way: speed_law.speed_law_step(
            state, seen, math.nan, speed, lean, EVERY / RATE, self.law)

    def to(self, place, top_speed=0.8, lean=1.2):
        """Return the step that comes to rest at a place."""
        return lambda state, seen, way: speed_law.place_law_step(
            state, seen, math.nan, place - way, top_speed, lean, EVERY / RATE, self.law)


@cache
def _at_speed(slope, tuning, speed):
    course = Course(slope, tuning)
    course.run(4.0, course.at_speed(speed))
    return course


def rolling(slope, tuning, speed):
    """Return a course whose ball has a speed."""
    return _at_speed(slope, tuning, speed).copy()


@pytest.mark.slow
@pytest.mark.parametrize('tuning', TUNINGS)
@pytest.mark.parametrize('lean', [0.7, 1.4])
@pytest.mark.parametrize('slope', [-3.0, 0.0, 3.0])
def test_a_ball_stops_within_the_braking_distance_and_stays(slope, lean, tuning):
    for speed in (0.2, 0.5, 0.9):
        course = rolling(slope, tuning, speed)
        rows = course.run(4.0 if slope > -3.0 or lean > 1.0 else 10.0, course.at_speed(0.0, lean))
        rolled, back = rows[:, 1].max() - rows[0, 1], rows[:, 1].max() - rows[-1, 1]
        said = speed_law.braking_distance(
            rows[0, 2], course.slope, lean, REACTION, course.law)
        assert 0.6 * said < rolled < said
        assert back < 0.01 and abs(rows[-1, 2]) < 0.01


@pytest.mark.parametrize('slope, tuning', pairs([-5.0, -3.0, -1.0, 0.0, 3.0, 5.0], TUNINGS))
def test_a_ball_stands_on_a_slope_without_creeping(slope, tuning):
    course = Course(slope, tuning)
    course.run(0.5, course.at_speed(0.0))
    begin = course.way
    rows = course.run(12.0, course.at_speed(0.0))
    # The pendulum hung down at first, so the ball rolls a little until it stands.
    assert np.ptp(rows[-5 * RATE:, 1]) < 1e-3
    assert abs(rows[-1, 2]) < 1e-3
    assert abs(rows[-1, 1] - begin) < (0.01 if abs(slope) <= 1.0 else 0.1)


@pytest.mark.slow
@pytest.mark.parametrize('tuning', TUNINGS)
@pytest.mark.parametrize('slope', [-3.0, 0.0, 3.0])
@pytest.mark.parametrize('before, gap', [(0.0, 0.4), (0.4, 0.6), (0.8, 1.5)])
def test_a_place_is_reached_from_one_side_and_kept(slope, tuning, before, gap):
    course = rolling(slope, tuning, before) if before else Course(slope, tuning)
    place = course.way + gap
    rows = course.run(9.0, course.to(place))
    assert rows[:, 1].max() < place + 0.001
    standing = rows[-3 * RATE:]
    assert abs(standing[:, 1] - place).max() < 0.01  # no drift, and there
    assert abs(standing[:, 2]).max() < 0.003 and abs(standing[-1, 2]) < 0.001


def test_a_place_behind_is_reached_backwards():
    course = Course(2.0)
    rows = course.run(9.0, course.to(-0.5, top_speed=0.2))
    assert abs(rows[-1, 1] + 0.5) < 0.005 and rows[:, 1].min() > -0.502
    assert rows[:, 2].min() > -0.25


@pytest.mark.slow
@pytest.mark.parametrize('pendulum_mass', [1.25, 2.1])
def test_robots_at_the_ends_of_their_ranges_keep_to_a_place_too(pendulum_mass):
    for slope in (-2.0, 2.0):
        course = Course(slope, pendulum_mass=pendulum_mass, ball_mass=5.4 - pendulum_mass)
        course.run(6.0, course.at_speed(0.4))
        place = course.way + 0.6
        rows = course.run(9.0, course.to(place))
        assert rows[:, 1].max() < place + 0.005
        assert abs(rows[-1, 1] - place) < 0.01


def test_a_speed_that_is_measured_with_noise_still_stands():
    course = Course(-3.0, noise=0.02)
    course.run(3.0, course.at_speed(0.0))
    begin = course.way
    rows = course.run(6.0, course.at_speed(0.0))
    assert abs(rows[:, 2]).max() < 0.03 and abs(rows[-1, 1] - begin) < 0.02


def test_at_50_hz_without_and_at_500_hz_with_the_pendulum_measured_the_ball_does_the_same():
    course = Course(2.0)
    slow = course.run(4.0, course.at_speed(0.4))
    plant, law = Course(2.0).plant, course.law
    controller = PendulumController(GIMBALL, load_tuning('published'))
    state, fast = speed_law.speed_law_start(0.0, 0.0, course.slope, law), []
    for _ in range(4 * RATE):
        now = plant.state
        speed = now.velocity_x / math.cos(course.slope)
        state, angle = speed_law.speed_law_step(
            state, speed, now.pendulum_angle, 0.4, 1.4, 1.0 / RATE, law)
        controller.give(SetPoint(Mode.HOLD, angle, now.time))
        plant.advance(controller.torque(JointReadings(
            now.time, now.ball_angle, now.joint_angle, now.ball_rate, now.joint_rate)))
        fast.append(plant.state.velocity_x / math.cos(course.slope))
    assert np.abs(slow[:, 2] - fast).max() < 0.06
    assert np.abs(slow[-RATE:, 2] - fast[-RATE:]).max() < 0.002
    assert speed_law.estimated_slope(state, law) == pytest.approx(course.slope, abs=1e-3)
    assert speed_law.estimated_slope(course.state, law) == pytest.approx(course.slope, abs=2e-3)
