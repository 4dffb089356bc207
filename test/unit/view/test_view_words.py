# SPDX-License-Identifier: Apache-2.0
"""The page writes known values only, and escapes HTML."""
from dataclasses import replace
import math

import numpy as np
import pytest

pytest.importorskip('viser')

from ballbot_ros.decision.planning.curve import load_curve
from ballbot_ros.view.controls import status_lines
from ballbot_ros.view.frame import DecisionSign, Frame
from ballbot_ros.view.readouts import (
    column, curve_columns, decision_words, numbers, Prospect, prospect_of, thinned, verdict)
from ballbot_ros.view.scene_source import SceneSource
from ballbot_ros.view.source import Health, Idle

CURVE = load_curve('gimball_free')


@pytest.mark.parametrize('prospect, words', [
    (Prospect(0.3), 'No step ahead.'),
    (Prospect(0.3, 0.031, 0.5), 'Step of 31 mm, 0.50 m ahead: requires 0.79 m/s at contact; '
     'now 0.30 m/s.'),
    (Prospect(0.9, 0.031, 0.5), 'fast enough'),
    (Prospect(0.9, 0.2, 0.5), 'above the maximum of 53 mm'),
    (Prospect(0.7, 0.031, 0.1, at_it=True),
     'Step of 31 mm, 0.10 m ahead: the ball is crossing it.'),
    (Prospect(0.9, -0.1, 0.5), 'Drop of 100 mm, 0.50 m ahead.'),
    (Prospect(None, 0.031), 'Step of 31 mm: requires 0.79 m/s at contact.')])
def test_the_step_ahead_in_a_sentence(prospect, words):
    assert words in verdict(CURVE, prospect)


def test_the_sentence_reports_a_missing_curve():
    assert 'no height curve' in verdict(None, Prospect(0.9, 0.031, 0.5))


@pytest.mark.parametrize('prospect', [
    Prospect(), Prospect(0.5), Prospect(0.5, 0.03), Prospect(7.0, 0.03), Prospect(0.5, -0.2),
    Prospect(0.5, 0.5), Prospect(0.5, 0.03, 0.2, 0.7), Prospect(None, 0.03)])
@pytest.mark.parametrize('curve', [CURVE, None])
def test_the_plot_of_the_curve_has_rising_speeds_and_the_step_at_the_present_speed(
        curve, prospect):
    speeds, heights, step, now, expected = curve_columns(curve, prospect)
    assert (np.diff(speeds) > 0.0).all() and speeds[0] == 0.0
    assert np.isfinite(heights).any() == (curve is not None)
    if prospect.speed is not None and prospect.height is not None:
        assert now[speeds == prospect.speed] == max(1e3 * prospect.height, 0.0)
    assert np.isfinite(now).sum() <= 1 and np.isfinite(expected).sum() <= 1
    assert (step == step[0]).all() or np.isnan(step).all()


def test_a_decision_takes_precedence_over_the_ground():
    source = SceneSource('doorstep')
    frame = source.shown
    assert prospect_of(source, frame).height == pytest.approx(0.031)
    seen = DecisionSign('cross', 'likely', height=0.028, distance=0.7, speed=0.8)
    assert prospect_of(source, replace(frame, decision=seen))[:4] == (
        pytest.approx(0.0), 0.028, 0.7, 0.8)


def test_a_decision_is_written_with_its_known_values_only():
    words = decision_words(DecisionSign('go_round', 'not_likely', 'find <b>another</b> way',
                                        margin=-0.012))
    assert 'GO ROUND' in words and 'margin -12 mm' in words and 'not likely' in words
    assert '&lt;b&gt;' in words and '%' not in words


def test_unknown_numbers_are_left_out():
    table = numbers(Frame(1.0, x=0.5))
    assert 'position x' in table and 'pendulum' not in table and 'force' not in table
    assert 'in flight' not in table and 'in flight' in numbers(Frame(1.0, contacts=()))


def test_no_number_is_minus_zero():
    assert '-0' not in numbers(Frame(1.0, x=-1e-9, velocity_x=-1e-5))


def test_unknown_values_are_gaps_in_a_series():
    values = column([Frame(0.0, x=1.0), Frame(1.0)], lambda frame: frame.x)
    assert values[0] == 1.0 and math.isnan(values[1])


def test_a_thinned_series_keeps_its_samples_as_time_goes_on_and_its_end():
    frames = [Frame(0.01 * index) for index in range(1000)]
    shorter, longer = thinned(frames[:900], 0.1), thinned(frames, 0.1)
    assert shorter[:-1] == longer[:len(shorter) - 1] and longer[-1] is frames[-1]
    assert thinned([], 0.1) == []


def test_the_state_of_a_source_is_shown_with_the_error_in_a_readable_unit():
    lines = ' '.join(status_lines(Health(True, 0.98, 3.2e-6, '', ('<note>',)), True))
    assert 'running' in lines and '0.98 x real time' in lines and '3.2 um' in lines
    assert 'e-stop engaged' in lines and '&lt;note&gt;' in lines
    assert 'paused' in status_lines(Health(False), None)[0]


def test_a_robot_at_rest_shows_its_present_reason():
    idle = Idle('The set-point is 0.', 'Drive', (('set_point', 0.5),))
    assert 'The set-point is 0.' in ' '.join(status_lines(Health(True, idle=idle), None))
    assert 'ballbot-idle' not in ' '.join(status_lines(Health(True), None))
