# SPDX-License-Identifier: Apache-2.0
"""Stopping and positioning by the speed law at 50 Hz on the full model."""
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
# Reaction time [s] from odometry to set angle: one period of delay and half a period of hold.
REACTION = 1.5 * EVERY / RATE


class Course:
    """
    GimBall on a slope, driven by the speed law with odometry delayed by one period.

    The pendulum angle is not measured but predicted from the set angles.
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
        self.start = self.plant.state.x

    def copy(self):
        """Return an independent copy of the course in its present state."""
        other = copy(self)
        other.plant, other.controller = copy(self.plant), deepcopy(self.controller)
        other.angles, other.random = [*self.angles], deepcopy(self.random)
        return other

    @property
    def speed(self):
        """Return the speed along the slope [m/s]."""
        return self.plant.state.velocity_x / math.cos(self.slope)

    @property
    def distance(self):
        """Return the distance travelled along the slope [m]."""
        return (self.plant.state.x - self.start) / math.cos(self.slope)

    def run(self, duration, step):
        """Drive by `step(state, speed, distance)`; return rows of time, distance and speed."""
        rows = []
        for period in range(round(duration * RATE)):
            if period % EVERY == 0:
                measured = self.speed + self.noise * self.random.standard_normal()
                self.state, angle = step(self.state, measured, self.distance)
                self.controller.give(SetPoint(Mode.HOLD, self.angles[-1], self.plant.time))
                self.angles.append(angle)
            self.plant.advance(self.controller.torque(JointReadings.of(self.plant.state)))
            rows.append((self.plant.time, self.distance, self.speed))
        return np.array(rows)

    def at_speed(self, speed, lean=1.4):
        """Return a step function that drives at a speed [m/s]."""
        return lambda state, measured, distance: speed_law.speed_law_step(
            state, measured, math.nan, speed, lean, EVERY / RATE, self.law)

    def to(self, place, top_speed=0.8, lean=1.2):
        """Return a step function that comes to rest at the distance `place` [m]."""
        return lambda state, measured, distance: speed_law.place_law_step(
            state, measured, math.nan, place - distance, top_speed, lean, EVERY / RATE, self.law)


@cache
def _at_speed(slope, tuning, speed):
    course = Course(slope, tuning)
    course.run(4.0, course.at_speed(speed))
    return course


def rolling(slope, tuning, speed):
    """Return a course on which the ball rolls at a speed [m/s]."""
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
        predicted = speed_law.braking_distance(
            rows[0, 2], course.slope, lean, REACTION, course.law)
        assert 0.6 * predicted < rolled < predicted
        assert back < 0.01 and abs(rows[-1, 2]) < 0.01


@pytest.mark.parametrize('slope, tuning', pairs([-5.0, -3.0, -1.0, 0.0, 3.0, 5.0], TUNINGS))
def test_a_ball_stays_at_rest_on_a_slope_without_creep(slope, tuning):
    course = Course(slope, tuning)
    course.run(0.5, course.at_speed(0.0))
    start = course.distance
    rows = course.run(12.0, course.at_speed(0.0))
    # The pendulum hangs initially, so the ball rolls a little before it stops.
    assert np.ptp(rows[-5 * RATE:, 1]) < 1e-3
    assert abs(rows[-1, 2]) < 1e-3
    assert abs(rows[-1, 1] - start) < (0.01 if abs(slope) <= 1.0 else 0.1)


@pytest.mark.slow
@pytest.mark.parametrize('tuning', TUNINGS)
@pytest.mark.parametrize('slope', [-3.0, 0.0, 3.0])
@pytest.mark.parametrize('before, gap', [(0.0, 0.4), (0.4, 0.6), (0.8, 1.5)])
def test_a_target_position_is_reached_without_overshoot_and_held(slope, tuning, before, gap):
    course = rolling(slope, tuning, before) if before else Course(slope, tuning)
    place = course.distance + gap
    rows = course.run(9.0, course.to(place))
    assert rows[:, 1].max() < place + 0.001
    standing = rows[-3 * RATE:]
    assert abs(standing[:, 1] - place).max() < 0.01  # at the target, without drift
    assert abs(standing[:, 2]).max() < 0.003 and abs(standing[-1, 2]) < 0.001


def test_a_target_position_behind_the_ball_is_reached_in_reverse():
    course = Course(2.0)
    rows = course.run(9.0, course.to(-0.5, top_speed=0.2))
    assert abs(rows[-1, 1] + 0.5) < 0.005 and rows[:, 1].min() > -0.502
    assert rows[:, 2].min() > -0.25


@pytest.mark.slow
@pytest.mark.parametrize('pendulum_mass', [1.25, 2.1])
def test_robots_at_the_ends_of_their_ranges_hold_a_target_position(pendulum_mass):
    for slope in (-2.0, 2.0):
        course = Course(slope, pendulum_mass=pendulum_mass, ball_mass=5.4 - pendulum_mass)
        course.run(6.0, course.at_speed(0.4))
        place = course.distance + 0.6
        rows = course.run(9.0, course.to(place))
        assert rows[:, 1].max() < place + 0.005
        assert abs(rows[-1, 1] - place) < 0.01


def test_a_ball_stays_at_rest_despite_speed_noise():
    course = Course(-3.0, noise=0.02)
    course.run(3.0, course.at_speed(0.0))
    start = course.distance
    rows = course.run(6.0, course.at_speed(0.0))
    assert abs(rows[:, 2]).max() < 0.03 and abs(rows[-1, 1] - start) < 0.02


def test_motion_at_50_hz_without_pendulum_angle_agrees_with_500_hz_with_it():
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
        plant.advance(controller.torque(JointReadings.of(now)))
        fast.append(plant.state.velocity_x / math.cos(course.slope))
    assert np.abs(slow[:, 2] - fast).max() < 0.06
    assert np.abs(slow[-RATE:, 2] - fast[-RATE:]).max() < 0.002
    assert speed_law.estimated_slope(state, law) == pytest.approx(course.slope, abs=1e-3)
    assert speed_law.estimated_slope(course.state, law) == pytest.approx(course.slope, abs=2e-3)
