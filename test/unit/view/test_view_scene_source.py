# SPDX-License-Identifier: Apache-2.0
"""A scene runs by itself, changes between two frames, and can be reviewed."""
import time

import pytest
from refusals import refused
from waiting import wait_until

from ballbot_ros.errors import SimulationError
from ballbot_ros.view.scene_source import SceneSource


@pytest.fixture
def source():
    made = SceneSource('voltage_start')
    yield made
    made.close()


def test_a_new_source_shows_the_start(source):
    assert source.shown.time == 0.0 and source.history.span == (0.0, 0.0)
    assert source.title == 'Scene voltage_start' and not source.health.running


def test_a_source_runs_until_it_is_paused(source):
    source.start()
    source.apply('pause', False)
    wait_until(lambda: source.shown.time > 0.2)
    source.apply('pause', True)
    stopped = source.shown.time
    time.sleep(0.05)
    assert source.shown.time == stopped and not source.health.running


def test_a_step_advances_by_the_requested_time(source):
    source.apply('step', 0.05)
    assert source.shown.time == pytest.approx(0.05)
    source.apply('pause', False)
    with refused('unavailable', 'step'):
        source.apply('step', 0.05)


def test_reset_starts_a_new_epoch_on_the_same_ground(source):
    source.apply('step', 0.2)
    source.apply('step_height', 0.05)
    epoch = source.history.epoch
    source.apply('reset', True)
    assert source.history.epoch == epoch + 1 and source.shown.time == 0.0
    assert source.controls['step_height'].value == pytest.approx(0.05)


def test_seeking_pauses_and_a_step_continues_from_the_newest_frame(source):
    source.apply('step', 0.2)
    source.apply('seek', 0.1)
    assert source.shown.time == pytest.approx(0.1) and not source.health.running
    source.apply('step', 0.02)
    assert source.shown.time == pytest.approx(0.22)


def test_the_reported_step_ahead_changes_as_the_ball_moves(source):
    assert source.controls['step_height'].value == pytest.approx(0.031)
    source.apply('step', 5.0)
    assert source.shown.x > 1.5 and source.controls['step_height'].value == 0.0


def test_a_free_pendulum_has_no_set_point(source):
    assert source.controls['set_point'].value == 7.0 and source.controls['set_point'].unit == 'V'
    source.apply('law', 'free')
    assert 'has no set-point' in source.controls['set_point'].refusal
    with refused('unavailable', 'set_point'):
        source.apply('set_point', 1.0)


def test_a_robot_without_a_pendulum_has_one_law(source):
    source.apply('robot', 'shellball')
    assert source.controls['law'].choices == ('free',) and source.robot.name == 'shellball'


def test_another_scene_keeps_the_e_stop(source):
    source.apply('e_stop', True)
    source.apply('scene', 'flat')
    assert source.controls['e_stop'].value is True and source.title == 'Scene flat'


def test_a_refusal_during_a_run_reaches_the_caller(source):
    source.start()
    with refused('out_of_range', 'set_point'):
        source.apply('set_point', 400.0)
    with refused('not_a_choice', 'scene'):
        source.apply('scene', 'moon')
    source.apply('pause', False)
    wait_until(lambda: source.shown.time > 0.05)


def test_a_failed_run_is_reported_and_restarts_after_a_reset(source, monkeypatch):
    def fail(periods):
        raise SimulationError(0.1, 'x is not finite', 'take a smaller step', 'not_finite', 'x')
    with monkeypatch.context() as patched:
        patched.setattr(source._run, 'advance', fail)
        source.apply('step', 0.1)
    assert 'x is not finite' in source.health.failure and not source.health.running
    with refused('unavailable', 'pause'):
        source.apply('pause', False)
    source.apply('reset', True)
    assert source.health.failure == ''


def test_history_contains_the_frames_after_a_time(source):
    source.apply('step', 0.1)
    assert [frame.time for frame in source.history.since(0.05)][0] == pytest.approx(0.052)


def test_closing_ends_the_thread_also_while_it_runs(source):
    source.start()
    source.apply('pause', False)
    source.close()
    assert not source._thread.is_alive()


@pytest.mark.slow
def test_a_scene_repeats_after_its_duration_until_a_control_changes_it(source):
    source.start()
    source.apply('step', 4.9)
    source.apply('pause', False)
    epoch = source.history.epoch
    wait_until(lambda: source.history.epoch > epoch)
    assert source.shown.time < 5.0
    source.apply('set_point', 6.0)
    source.apply('pause', True)
    source.apply('step', 5.0)
    source.apply('pause', False)
    wait_until(lambda: source.shown.time > 5.2)


@pytest.mark.slow
def test_a_robot_at_rest_offers_controls_that_move_it():
    source = SceneSource('doorstep')
    assert source.health.idle is None  # paused, as the state shows
    source.start()
    source.apply('pause', False)
    wait_until(lambda: source.health.idle is not None)
    assert 'free' in source.health.idle.reason
    for name, value in source.health.idle.remedy:
        source.apply(name, value)
    wait_until(lambda: source.shown.velocity_x > 0.1)
    assert source.health.idle is None
    source.close()


def test_at_the_e_stop_a_robot_at_rest_offers_its_release():
    source = SceneSource('doorstep')
    source.apply('e_stop', True)
    source.start()
    source.apply('pause', False)
    wait_until(lambda: source.health.idle is not None)
    assert source.health.idle.remedy == (('e_stop', False),)
    source.close()
