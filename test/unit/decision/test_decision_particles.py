# SPDX-License-Identifier: Apache-2.0
"""Particles of uncertain robot parameters: sampling, weighting and resampling."""
from dataclasses import replace
from time import perf_counter

from hypothesis import given, settings, strategies as st
import numpy as np
import pytest
from refusals import refused

from ballbot_ros.config.fields import Provenance
from ballbot_ros.decision.learning.particles import Particles
from ballbot_ros.physics import load_robot
from ballbot_ros.physics.model.robot import ContactOptions, Parameters

GIMBALL, SHELLBALL = load_robot('gimball'), load_robot('shellball')
PARTICLES = Particles.of(GIMBALL, 0.0005)


def pulled(particles, name, middle, deviation):
    """Return particles after a measurement of a column with normal errors."""
    return particles.reweighted(-0.5 * ((particles.column(name) - middle) / deviation)**2)


def test_each_row_contains_the_kernel_parameters_of_its_robot():
    for particles in (PARTICLES, Particles.of(SHELLBALL, 0.0),
                      pulled(PARTICLES, 'pendulum_mass', 1.4, 0.02)):
        for index in (0, 7, len(particles) - 1):
            robot = particles.one(index)
            assert particles.rows[index] == pytest.approx(
                Parameters.of(robot, ContactOptions())[:], rel=1e-14)
            assert robot.total_mass == pytest.approx(particles.robot.total_mass, rel=1e-14)
            assert robot.edge_friction == particles.column('edge_friction')[index]


def test_the_samples_fill_the_ranges_evenly():
    assert set(PARTICLES.names) == {'ball_inertia', 'pendulum_mass', 'surface_friction',
                                    'edge_friction', 'height_bias'}
    for name in PARTICLES.names[:-1]:
        column = PARTICLES.column(name)
        index = PARTICLES.names.index(name)
        low, high = PARTICLES.lows[index], PARTICLES.highs[index]
        counts, _ = np.histogram(column, 8, (low, high))
        assert counts.tolist() == [32] * 8, name
    bias = abs(PARTICLES.column('height_bias'))
    assert np.quantile(bias, 0.6) == pytest.approx(0.0005, rel=0.1)  # about one deviation
    assert bias.max() > 0.006
    assert abs(PARTICLES.mean('height_bias')) < 1e-4
    assert (PARTICLES.column('ball_radius') == GIMBALL.ball_radius).all()


def test_a_range_in_the_robot_file_takes_precedence_over_the_assumed_one():
    known = {**GIMBALL.provenance,
             'edge_friction': Provenance('measured', 0.13, 0.15)}
    particles = Particles.of(replace(GIMBALL, provenance=known), 0.0005)
    assert 0.13 <= particles.column('edge_friction').min() < 0.131
    assert 0.149 < particles.column('edge_friction').max() <= 0.15


def test_particles_are_created_within_50_ms():
    start = perf_counter()
    for _ in range(5):
        Particles.of(GIMBALL, 0.0005)
    assert (perf_counter() - start) / 5 < 0.05


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 600), st.integers(0, 99))
def test_each_particle_is_drawn_in_proportion_to_its_weight(number, seed):
    particles = pulled(PARTICLES, 'edge_friction', 0.12, 0.02)
    drawn = particles.draw(number, seed)
    counts = np.bincount(drawn, minlength=len(particles))
    assert len(drawn) == number
    assert (abs(counts - number * particles.weights) < 1.0 + 1e-9).all()
    assert (drawn == particles.draw(number, seed)).all()


@pytest.mark.parametrize('deviation', [0.006, 0.003])
def test_resampling_keeps_mean_and_deviation_and_a_tenth_of_the_particles(deviation):
    weights = np.exp(-0.5 * ((PARTICLES.column('edge_friction') - 0.12) / deviation)**2)
    after = pulled(PARTICLES, 'edge_friction', 0.12, deviation)
    assert after.effective_size == pytest.approx(len(after))
    new = (after.values != PARTICLES.values).any(axis=1)
    assert np.count_nonzero(~new) == 26
    friction = after.column('edge_friction')[new]
    assert friction.mean() == pytest.approx(0.12, abs=0.2 * deviation)
    assert friction.std() == pytest.approx(deviation, rel=0.2)
    expected = np.average(PARTICLES.values, axis=0, weights=weights)
    for name, found, mean in zip(after.names, after.values[new].mean(axis=0), expected):
        assert found == pytest.approx(mean, abs=0.3 * PARTICLES.deviation(name)), name
    assert (after.values >= after.lows).all() and (after.values <= after.highs).all()


def test_after_hundreds_of_outcomes_the_particles_differ_and_are_in_range():
    particles = PARTICLES
    for number in range(300):
        particles = pulled(particles, particles.names[number % 5],
                           particles.highs[number % 5] * 1.2, 0.05 * particles.highs[number % 5])
        assert particles.weights.sum() == pytest.approx(1.0, abs=1e-12)
    assert particles.outcomes == 300
    assert (particles.values <= particles.highs).all()
    assert len(np.unique(particles.values[:, 0])) > 100


@pytest.mark.parametrize('wrong', [[0.0], [np.nan] * 256, [np.inf] * 256, [-np.inf] * 256])
def test_an_invalid_likelihood_is_refused(wrong):
    with refused('wrong_type', 'log_likelihood'):
        PARTICLES.reweighted(wrong)


def test_arrays_are_read_only():
    for array in (PARTICLES.values, PARTICLES.weights, PARTICLES.rows):
        with pytest.raises(ValueError):
            array[0] = 0.0


def test_a_range_that_contradicts_the_robot_is_refused():
    known = {**GIMBALL.provenance, 'pendulum_length': Provenance('derived', 0.05, 0.3)}
    with refused('inconsistent', 'pendulum_length'):
        Particles.of(replace(GIMBALL, provenance=known), 0.0005)
