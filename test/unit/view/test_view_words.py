# SPDX-License-Identifier: Apache-2.0
"""What the page writes: sentences and numbers, nothing that nobody knows, and no foreign HTML."""
from dataclasses import replace
import math
import xml.etree.ElementTree as ElementTree

import pytest

pytest.importorskip('viser')

from ballbot_ros.decision.planning.curve import load_curve
from ballbot_ros.view.chart import draw, Prospect, prospect_of, verdict
from ballbot_ros.view.controls import status_lines
from ballbot_ros.view.frame import DecisionSign, Frame
from ballbot_ros.view.readouts import column, decision_words, numbers, thinned
from ballbot_ros.view.scene_source import SceneSource
from ballbot_ros.view.source import Health

CURVE = load_curve('gimball_free')


@pytest.mark.parametrize('prospect, words', [
    (Prospect(0.3), 'No step ahead.'),
    (Prospect(0.3, 0.031, 0.5), 'Step of 31 mm, 0.50 m ahead: takes 0.79 m/s at the touch; '
     'now 0.30 m/s, too slow.'),
    (Prospect(0.9, 0.031, 0.5), 'fast enough'),
    (Prospect(0.9, 0.2, 0.5), 'higher than the 53 mm that the curve ends with'),
    (Prospect(0.7, 0.031, 0.1, at_it=True), 'Step of 31 mm, 0.10 m ahead: the ball is at it.'),
    (Prospect(0.9, -0.1, 0.5), 'Drop of 100 mm, 0.50 m ahead.'),
    (Prospect(None, 0.031), 'Step of 31 mm: takes 0.79 m/s at the touch.')])
def test_the_step_ahead_in_a_sentence(prospect, words):
    assert words in verdict(CURVE, prospect)


def test_without_a_curve_the_sentence_says_so():
    assert 'no height curve' in verdict(None, Prospect(0.9, 0.031, 0.5))


@pytest.mark.parametrize('prospect', [
    Prospect(), Prospect(0.5), Prospect(0.5, 0.03), Prospect(7.0, 0.03), Prospect(0.5, -0.2),
    Prospect(0.5, 0.5), Prospect(0.5, 0.03, 0.2, 0.7), Prospect(None, 0.03)])
@pytest.mark.parametrize('curve', [CURVE, None])
def test_the_picture_is_whole_and_inside_its_frame(curve, prospect):
    picture = ElementTree.fromstring(draw(curve, prospect))
    width, height = map(float, picture.get('viewBox').split()[2:])
    for circle in picture.iter('circle'):
        assert 0.0 <= float(circle.get('cx')) <= width
        assert 0.0 <= float(circle.get('cy')) <= height
    for line in picture.iter('polyline'):
        for point in line.get('points').split():
            x, y = map(float, point.split(','))
            assert 0.0 <= x <= width and 0.0 <= y <= height


def test_a_decision_is_asked_before_the_ground():
    source = SceneSource('doorstep', paused=True)
    frame = source.shown
    assert prospect_of(source, frame).height == pytest.approx(0.031)
    seen = DecisionSign('cross', 'likely', height=0.028, distance=0.7, speed=0.8)
    assert prospect_of(source, replace(frame, decision=seen))[:4] == (
        pytest.approx(0.0), 0.028, 0.7, 0.8)


def test_a_decision_is_written_with_what_it_says_and_no_more():
    words = decision_words(DecisionSign('go_round', 'not_likely', 'find <b>another</b> way',
                                        margin=-0.012))
    assert 'GO ROUND' in words and 'margin -12 mm' in words and 'not likely' in words
    assert '&lt;b&gt;' in words and '%' not in words


def test_unknown_numbers_are_left_out():
    table = numbers(Frame(1.0, x=0.5))
    assert 'place x' in table and 'pendulum' not in table and 'force' not in table
    assert 'in flight' not in table and 'in flight' in numbers(Frame(1.0, contacts=()))


def test_no_number_is_minus_zero():
    assert '-0' not in numbers(Frame(1.0, x=-1e-9, velocity_x=-1e-5))


def test_what_is_not_known_is_a_gap_in_a_series():
    values = column([Frame(0.0, x=1.0), Frame(1.0)], lambda frame: frame.x)
    assert values[0] == 1.0 and math.isnan(values[1])


def test_a_thinned_series_keeps_its_samples_as_time_goes_on_and_its_end():
    frames = [Frame(0.01 * index) for index in range(1000)]
    shorter, longer = thinned(frames[:900], 0.1), thinned(frames, 0.1)
    assert shorter[:-1] == longer[:len(shorter) - 1] and longer[-1] is frames[-1]
    assert thinned([], 0.1) == []


def test_how_a_source_is_doing_is_told_with_the_error_in_a_unit_that_people_read():
    lines = ' '.join(status_lines(Health(True, 0.98, 3.2e-6, '', ('<note>',)), True))
    assert 'runs' in lines and '0.98 x real time' in lines and '3.2 um' in lines
    assert 'e-stop engaged' in lines and '&lt;note&gt;' in lines
    assert 'paused' in status_lines(Health(False), None)[0]
