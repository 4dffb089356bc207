# SPDX-License-Identifier: Apache-2.0
"""The timeline of a demo: its events, their order, and the criteria of success."""
import pytest

from ballbot_ros.demo.timeline import Expected, Passage, Timeline
from ballbot_ros.msg import BallState, Contact, StepDecision
from ballbot_ros.ros.conversions import to_time

STEPS = ((1.426, 0.031, 0.031, Expected.CROSSED), (4.426, 0.080, 0.111, Expected.REFUSED))
DROP = ((2.5, -0.1, -0.15, Expected.REFUSED),)
RADIUS = 0.226
CROSS = (StepDecision.DECISION_CROSS, StepDecision.REASON_WITHIN_CURVE)
COMMITTED = (StepDecision.DECISION_CROSS, StepDecision.REASON_COMMITTED)
GO_ROUND = (StepDecision.DECISION_GO_ROUND, StepDecision.REASON_TOO_HIGH)


@pytest.fixture
def timeline(gimball):
    """Return a timeline that stores its reports."""
    timeline = Timeline([Passage(*step) for step in STEPS], gimball,
                        lambda *event: timeline.events.append(event))
    timeline.events = []
    return timeline


def ball(stamp, x, y=RADIUS, speed=0.5, touching=()):
    message = BallState(x=x, y=y, velocity_x=speed, contacts=[
        Contact(kind=Contact.KIND_EDGE, x=place) for place in touching])
    message.header.stamp = to_time(stamp)
    return message


def decided(stamp, kind, height=0.031, explanation='because'):
    message = StepDecision(decision=kind[0], reason=kind[1], height=height, distance=1.0,
                           explanation=explanation, plan='swing', probability=0.97,
                           height_limit=0.045)
    message.header.stamp = to_time(stamp)
    return message


def marks(timeline):
    return [mark for _, mark, _ in timeline.events]


def play(timeline, until='rests'):
    """Feed a successful run up to one of its events."""
    events = [
        ('starts', [ball(0.0, 0.0, speed=0.0)]),
        ('CROSS', [decided(0.0, CROSS)]),
        ('rolls', [ball(1.0, 1.0, speed=0.9)]),
        ('touches', [ball(1.5, 1.31, touching=[1.426])]),
        ('crossed', [ball(2.0, 1.43, y=RADIUS + 0.031)]),
        ('GO ROUND', [decided(2.0, GO_ROUND, 0.08)]),
        ('rests', [ball(5.0 + 0.1 * number, 3.9, y=RADIUS + 0.031, speed=0.0)
                   for number in range(12)]),
    ]
    for name, messages in events:
        for message in messages:
            is_state = isinstance(message, BallState)
            (timeline.add_state if is_state else timeline.add_decision)(message)
        if name == until:
            return


def test_a_stop_without_a_step_does_not_count_as_seen(timeline):
    play(timeline, 'crossed')
    stop = decided(2.0, GO_ROUND)
    stop.height = stop.distance = float('nan')
    timeline.add_decision(stop)
    timeline.add_decision(decided(2.1, CROSS, 0.08))
    assert marks(timeline)[-3:] == ['GO ROUND', 'detects', 'CROSS']


def test_a_successful_run_is_reported_without_errors(timeline):
    play(timeline)
    assert marks(timeline) == [
        'detects', 'CROSS', 'touches', 'crossed', 'detects', 'GO ROUND', 'rests']
    sentences = {mark: sentence for _, mark, sentence in timeline.events}
    assert sentences['touches'] == 'the 31 mm step at 0.90 m/s; the plan crosses up to 45 mm'
    assert sentences['rests'] == '0.30 m before the 80 mm step'
    assert [time for time, *_ in timeline.events] == [0.0, 0.0, 1.5, 2.0, 2.0, 2.0, 5.0]
    assert timeline.rested == 5.0 and timeline.verdict() == []


@pytest.mark.parametrize('until, missing', [
    ('starts', ['the 31 mm step was never accepted', 'the 31 mm step was not crossed',
                'the 80 mm step was never refused', 'the robot did not come to rest']),
    ('touches', ['the 31 mm step was not crossed', 'the 80 mm step was never refused',
                 'the robot did not come to rest']),
    ('crossed', ['the 80 mm step was never refused', 'the robot did not come to rest']),
    ('GO ROUND', ['the robot did not come to rest']),
])
def test_a_missing_event_is_an_error(timeline, until, missing):
    play(timeline, until)
    assert timeline.verdict() == missing


def test_the_ball_may_continue_after_the_last_crossed_step(gimball):
    timeline = Timeline([Passage(*STEPS[0])], gimball, lambda *event: None)
    play(timeline, 'touches')
    assert timeline.verdict() == ['the 31 mm step was not crossed']
    timeline.add_state(ball(2.0, 1.43, y=RADIUS + 0.031))
    assert timeline.rested is None and timeline.verdict() == []


def test_no_attempt_at_all_is_not_a_success(timeline):
    assert len(timeline.verdict()) == 4


def test_the_second_step_must_be_neither_accepted_nor_touched(timeline):
    play(timeline)
    timeline.add_decision(decided(5.5, CROSS, 0.08))
    timeline.add_state(ball(9.0, 4.3, touching=[4.426]))
    assert timeline.verdict() == ['the 80 mm step was accepted, but must be refused',
                                  'the 80 mm step was touched']


def test_rest_before_the_first_step_is_not_the_end(timeline):
    for number in range(30):
        timeline.add_state(ball(0.1 * number, 0.0, speed=0.0))
    assert timeline.rested is None


def test_a_momentary_standstill_is_not_rest(timeline):
    play(timeline, 'GO ROUND')
    for number, speed in enumerate((0.0, 0.01, 0.5, 0.0, -0.01)):
        timeline.add_state(ball(3.0 + 0.4 * number, 3.0, y=RADIUS + 0.031, speed=speed))
    assert timeline.rested is None


def test_only_a_change_of_decision_is_reported(timeline):
    timeline.add_state(ball(0.0, 0.0))
    for number in range(50):
        timeline.add_decision(decided(0.02 * number, CROSS, explanation=f'look {number}'))
    timeline.add_decision(decided(1.0, COMMITTED))
    assert marks(timeline) == ['detects', 'CROSS', 'CROSS']
    assert timeline.events[-1][2] == 'too late to stop: because'


def test_a_touch_is_reported_once_and_only_at_its_step(timeline):
    play(timeline, 'rolls')
    timeline.add_state(ball(1.1, 1.1, touching=[1.2]))
    assert timeline.passages[0].touched is None
    for stamp in (1.5, 1.6):
        timeline.add_state(ball(stamp, 1.31, touching=[1.426]))
    touch, = (sentence for _, mark, sentence in timeline.events if mark == 'touches')
    assert touch.startswith('the 31 mm step at 0.50 m/s')


def test_a_ball_above_the_face_but_below_the_top_has_not_crossed(timeline):
    play(timeline, 'rolls')
    timeline.add_state(ball(2.0, 1.43, y=0.1))
    assert timeline.next_step == 0


def test_a_decision_counts_from_the_first_state_on(timeline):
    timeline.add_decision(decided(999.9, CROSS))
    timeline.add_state(ball(1000.0, 0.0))
    assert marks(timeline) == []
    timeline.add_decision(decided(1000.1, CROSS))
    assert marks(timeline)[-1] == 'CROSS'


def test_times_count_from_the_first_state(timeline):
    timeline.add_state(ball(1000.0, 0.0))
    assert timeline.now == 0.0
    timeline.add_decision(decided(1000.5, CROSS))
    assert [(time, mark) for time, mark, _ in timeline.events] == [
        (0.5, 'detects'), (0.5, 'CROSS')]


def test_a_stop_before_a_drop_is_a_success_and_a_fall_is_not(gimball):
    def new():
        return Timeline([Passage(*face) for face in DROP], gimball, lambda *event: None)

    stop = (StepDecision.DECISION_STOP, StepDecision.REASON_DROP)
    right, wrong = new(), new()
    for timeline in (right, wrong):
        timeline.add_state(ball(0.0, 0.0, speed=0.0))
        timeline.add_decision(decided(0.0, stop, -0.1))
        assert timeline.rested is None
    for number in range(12):
        right.add_state(ball(5.0 + 0.1 * number, 2.0, y=0.18, speed=0.0))
    assert right.rested == 5.0 and right.verdict() == []
    wrong.add_state(ball(5.0, 2.6, y=0.07))
    assert 'the 100 mm drop was touched' in wrong.verdict()


@pytest.mark.parametrize('seconds, rests', [(4, False), (6, True)])
def test_a_ball_refused_at_its_start_counts_as_at_rest_after_a_delay(gimball, seconds, rests):
    timeline = Timeline([Passage(*STEPS[1][:3], None)], gimball, lambda *event: None)
    timeline.add_state(ball(0.0, 0.0, speed=0.0))
    timeline.add_decision(decided(0.0, GO_ROUND, 0.08))
    for number in range(1, 10 * seconds):
        timeline.add_state(ball(0.1 * number, 0.0, speed=0.0))
    assert (timeline.rested is not None) is rests


def test_a_ball_that_was_not_driven_yet_does_not_rest(gimball):
    timeline = Timeline([Passage(*face) for face in DROP], gimball, lambda *event: None)
    for number in range(30):
        timeline.add_state(ball(0.1 * number, 0.1, speed=0.0))
    assert timeline.rested is None
