# SPDX-License-Identifier: Apache-2.0
"""Which question a reply answers, and when the drive looked at its encoder."""
import pytest

from ballbot_ros.drives.questions import FOLLOW, Questions

PERIOD, USUAL = 0.002, 0.0008


def asked(number, *requests):
    """Return questions that were asked once a period from 0, and a usual time that is known."""
    questions = Questions(0.05)
    questions.usual = USUAL
    for index in range(number):
        questions.ask(*(requests or ('position',)))
        questions.written(index * PERIOD, index * PERIOD)
    return questions


def likely(questions, now, alike=1):
    """Return when that was measured which is read now."""
    return questions.answered('position', now, alike).measured


def test_a_reply_answers_its_question_however_late_it_is_read():
    assert likely(asked(1), USUAL) == 0.0
    assert likely(asked(1), 0.03) == 0.0


def test_a_lost_reply_shifts_nothing():
    questions = asked(2)
    assert likely(questions, PERIOD + USUAL) == PERIOD
    for index in range(2, 100):
        questions.ask('position')
        questions.written(index * PERIOD, index * PERIOD)
        answer = questions.answered('position', index * PERIOD + USUAL)
        assert answer.measured == index * PERIOD
        # Of what is off now one knows only that it was off when the question before was sent.
        assert answer.asked == pytest.approx((index - 1) * PERIOD)


def test_a_reply_that_comes_right_after_a_question_answers_the_one_before():
    questions = asked(2)
    assert likely(questions, PERIOD + 0.4 * USUAL) == 0.0
    assert likely(questions, PERIOD + USUAL) == PERIOD


def test_replies_that_are_read_together_answer_one_question_each():
    questions = asked(3)
    assert [likely(questions, 0.03, left) for left in (3, 2, 1)] == [0.0, PERIOD, 2 * PERIOD]
    questions = asked(4)  # and one of four is lost: the first, as far as anybody knows
    assert [likely(questions, 0.03, left) for left in (3, 2, 1)] == [
        PERIOD, 2 * PERIOD, 3 * PERIOD]


def test_a_late_reply_that_was_taken_for_the_next_one_costs_one_period_once():
    questions = asked(2)
    assert likely(questions, PERIOD + 0.6 * USUAL) == PERIOD  # it was late by a period
    assert likely(questions, PERIOD + USUAL) == PERIOD  # and this is the answer to that
    questions.ask('position')
    questions.written(2 * PERIOD, 2 * PERIOD)
    assert likely(questions, 2 * PERIOD + USUAL) == 2 * PERIOD


def test_a_reply_to_no_question_says_nothing():
    assert asked(0).answered('position', 1.0) == (-float('inf'), None)
    questions = asked(2, 'other')
    assert questions.answered('position', 1.0).measured is None
    assert questions.take_lost(1.0) == 2


def test_a_reply_of_another_kind_gives_up_what_was_asked_before_it():
    questions = asked(1)
    questions.ask('status')
    questions.written(PERIOD, PERIOD)
    assert questions.requests == {'position', 'status'}
    assert questions.answered('status', 2 * PERIOD).measured == PERIOD
    assert questions.take_lost(2 * PERIOD) == 1 and not questions


def test_a_question_that_was_held_up_in_its_write_gives_no_time():
    questions = asked(0)
    questions.ask('position')
    assert questions
    questions.written(0.0, 0.02)
    answer = questions.answered('position', 0.02)
    assert answer.measured is None and answer.asked == 0.0


def test_overdue_questions_are_lost_once():
    questions = asked(3)
    assert questions.take_lost(0.0505) == 1
    assert questions.take_lost(0.06) == 2 and not questions
    assert questions.take_lost(0.07) == 0


def test_those_that_are_given_up_are_lost():
    questions = asked(3)
    questions.clear()
    assert not questions and questions.take_lost(0.0) == 3


def test_the_usual_time_is_the_median_of_answers_that_leave_no_doubt():
    questions = Questions(0.05)
    now = 0.0
    for number in range(300):
        questions.ask('position')
        questions.written(now, now)
        questions.answered('position', now + (0.02 if number % 10 == 9 else 0.0005))
        now += 0.03
    assert 0.0005 / FOLLOW**3 < questions.usual < 0.0005 * FOLLOW**3
    usual = questions.usual
    for _ in range(2):
        questions.ask('position')
        questions.written(now, now)
        now += PERIOD
    questions.answered('position', now)
    assert questions.usual == usual  # which of the two it answers is not certain
