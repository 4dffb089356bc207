# SPDX-License-Identifier: Apache-2.0
"""Frames are found by their time, and an earlier time starts a new epoch."""
from ballbot_ros.view.frame import Frame
from ballbot_ros.view.source import FrameHistory


def filled(*times, most=100):
    history = FrameHistory(most)
    for time in times:
        history.add(Frame(time))
    return history


def times(frames):
    return [frame.time for frame in frames]


def test_without_frames_nothing_is_shown():
    history = FrameHistory()
    assert history.newest is None and history.at(1.0) is None
    assert history.span == (0.0, 0.0) and history.since(-1.0) == []


def test_the_frame_at_a_time_is_the_last_one_before_it():
    history = filled(1.0, 2.0, 3.0)
    assert history.at(2.5).time == 2.0 and history.at(2.0).time == 2.0
    assert history.at(0.0).time == 1.0 and history.at(9.0).time == 3.0


def test_history_starts_after_the_given_time():
    history = filled(1.0, 2.0, 3.0)
    assert times(history.since(1.0)) == [2.0, 3.0]


def test_a_jump_back_in_time_starts_a_new_epoch():
    history = filled(1.0, 2.0, 0.5)
    assert history.epoch == 1 and history.span == (0.5, 0.5)
    history.forget()
    assert history.epoch == 2 and history.newest is None


def test_a_thinned_history_keeps_the_first_and_every_second_frame():
    history = filled(1.0, 2.0, 3.0, 4.0, 5.0)
    history.thin()
    assert times(history.since(0.0)) == [1.0, 3.0, 5.0] and len(history) == 3


def test_the_number_of_frames_is_bounded():
    history = filled(*map(float, range(1000)), most=100)
    assert 100 <= len(history.since(-1.0)) <= 110 and history.newest.time == 999.0
