# SPDX-License-Identifier: Apache-2.0
"""Learning of robot and sensor parameters from outcomes; a single outlier has little effect."""
from dataclasses import replace

import numpy as np
import pytest

from ballbot_ros.crossing import held_at, max_step_height, try_step
from ballbot_ros.decision.learning.chances import (
    Chances, MODEL_SD, probability, score_of, SPEED_SD, Touching)
from ballbot_ros.decision.learning.learner import learned, Learner
from ballbot_ros.decision.learning.outcomes import Outcome
from ballbot_ros.decision.learning.particles import Particles
from ballbot_ros.decision.values import Plan, Strategy
from ballbot_ros.physics import load_robot
from ballbot_ros.studies.learning import study

GIMBALL = load_robot('gimball')
PARTICLES = Particles.of(GIMBALL, 0.0005)
TOUCHING = Touching(0.036, 0.001, 0.8, 0.4, 0.7)


def outcome(touching, result, passed=None, **more):
    return Outcome(stamp=1.0, result=result, face=1, position=1.0, height=touching.height,
                   height_sd=touching.height_sd, touch_speed=touching.speed,
                   touch_angle=touching.angle, held_angle=touching.set_angle,
                   passed_speed=passed, **more)


@pytest.mark.parametrize('height', [0.030, 0.036, 0.045])
@pytest.mark.parametrize('robot', [GIMBALL, replace(GIMBALL, edge_friction=0.1)])
def test_the_score_of_an_attempt_is_that_of_the_crossing_search(robot, height):
    over, score = try_step(robot, 0.8, height, held_at(0.7), 0.4, tolerance=1e-4)
    found, _ = score_of(robot, TOUCHING._replace(height=height))
    assert found == pytest.approx(score, rel=1e-12) and over == (found > 0.0)


def test_the_probability_is_the_fraction_of_sampled_robots_and_measurements_that_cross():
    random = np.random.default_rng(0)
    for height in (0.034, 0.037, 0.040):
        touching = TOUCHING._replace(height=height)
        overs = []
        for index in random.permutation(len(PARTICLES)).tolist():
            noise = random.standard_normal(3)
            true = (height - PARTICLES.column('height_bias')[index]
                    + touching.height_sd * noise[0] + MODEL_SD * noise[1])
            overs.append(try_step(
                PARTICLES.one(index), 0.8 + SPEED_SD * noise[2], true,
                held_at(0.7), 0.4, tolerance=1e-4)[0])
        assert probability(PARTICLES, touching) == pytest.approx(np.mean(overs), abs=0.06)


def test_the_probability_is_one_half_at_the_maximum_step_height_of_a_certain_robot(monkeypatch):
    alike = replace(PARTICLES, rows=np.tile(PARTICLES.rows[0], (256, 1)),
                    values=np.tile([0.08, 1.6, 0.2, 0.12, 0.0], (256, 1)))
    robot = replace(PARTICLES.one(0), surface_friction=0.2, edge_friction=0.12)
    found = max_step_height(robot, 0.8, held_at(0.7), 0.4).height
    touching = TOUCHING._replace(height=found)
    assert probability(alike, touching) == pytest.approx(0.5, abs=0.06)
    # One standard deviation below that height, the probability is 84 %.
    monkeypatch.setattr('ballbot_ros.decision.learning.chances.SPEED_SD', 0.0)
    monkeypatch.setattr('ballbot_ros.decision.learning.chances.MODEL_SD', 1e-6)
    lower = touching._replace(height=found - touching.height_sd)
    assert probability(alike, lower) == pytest.approx(0.84, abs=0.06)


def test_a_higher_step_is_less_probable():
    chances = [probability(PARTICLES, TOUCHING._replace(height=height))
               for height in np.arange(0.02, 0.056, 0.003)]
    assert (np.diff(chances) <= 1e-9).all() and chances[0] > 0.99 and chances[-1] < 0.01


def test_incremental_learning_gives_the_same_result_and_keeps_its_work_limit():
    done = outcome(TOUCHING, 'over', 0.4)
    whole, parts = learned(PARTICLES, [done, done]), Learner(PARTICLES)
    parts.take(done), parts.take(done)
    calls = changes = 0
    while changes < 2:
        changes += parts.advance(8)
        calls += 1
    assert calls == 2 * -(-(256 + 4) // 8)
    assert not parts.advance(8)
    assert (parts.particles.weights == whole.weights).all()
    assert whole.outcomes == 2


@pytest.mark.parametrize('wrong', [
    outcome(TOUCHING._replace(height=-0.1), 'fell'),
    outcome(TOUCHING._replace(height=0.3), 'stuck'),
    outcome(TOUCHING._replace(speed=0.05), 'stuck'),
    outcome(TOUCHING, 'over', robot='0123456789abcdef')])
def test_uninformative_attempts_are_not_learned_from(wrong):
    learner = Learner(PARTICLES)
    assert not learner.take(wrong) and not learner.advance()
    assert learner.particles is PARTICLES


def test_one_implausible_outcome_has_little_effect():
    easy = TOUCHING._replace(height=0.008, speed=1.0)
    assert probability(PARTICLES, easy) > 0.999
    after = learned(PARTICLES, [outcome(easy, 'stuck')])
    for touching in (TOUCHING._replace(height=height) for height in (0.030, 0.034, 0.038)):
        assert probability(after, touching) == pytest.approx(
            probability(PARTICLES, touching), abs=0.05)
    hopeless = TOUCHING._replace(height=0.09, speed=0.4)
    after = learned(PARTICLES, [outcome(hopeless, 'over', 0.5)])
    assert probability(after, TOUCHING) == pytest.approx(
        probability(PARTICLES, TOUCHING), abs=0.05)


def test_an_attempt_with_a_swing_has_the_angle_of_its_plan():
    plan = Plan(Strategy.SWING, swing_position=0.9, swing_angle=1.5)
    assert Touching.of(outcome(TOUCHING, 'over', plan=plan)).set_angle == 1.5
    assert Touching.of(outcome(TOUCHING, 'over')).set_angle == 0.7


def test_the_speed_past_the_face_is_more_informative_than_the_result():
    touching = TOUCHING._replace(height=0.030)
    dull = learned(PARTICLES, [outcome(touching, 'over')])
    slow = learned(PARTICLES, [outcome(touching, 'over', 0.1)])
    fast = learned(PARTICLES, [outcome(touching, 'over', 0.6)])
    harder = TOUCHING._replace(height=0.036)
    assert probability(slow, harder) < probability(dull, harder) - 0.2
    assert probability(fast, harder) > probability(dull, harder) + 0.1


def test_learning_works_for_a_ball_without_a_pendulum():
    robot = load_robot('shellball')
    particles = Particles.of(robot, 0.0005, 64)
    touching = Touching(0.015, 0.001, 0.7, 0.0, 0.0)
    chances = Chances(particles, touching)
    assert chances.advance()
    after = learned(particles, [outcome(touching, 'stuck')])
    assert probability(after, touching) < probability(particles, touching)


@pytest.mark.slow
@pytest.mark.parametrize('case', ['friction 30 % lower', 'heights reported 4 mm too low'])
def test_after_twenty_attempts_the_predicted_probabilities_are_accurate(case):
    found, = study(GIMBALL, 3, 20, cases=[case], particles=128)
    tried = found.after >= 0.9
    assert np.count_nonzero(tried) > 10
    assert abs(found.after[tried].mean() - found.observed[tried].mean()) < 0.04
    before, after = (np.sqrt(np.mean((predicted - found.observed)**2))
                     for predicted in (found.before, found.after))
    assert after < 0.75 * before
