# SPDX-License-Identifier: Apache-2.0
"""An animation shows the run: number of frames, duration, and the ball where it was."""
from dataclasses import replace
import math
import subprocess

import numpy as np
from PIL import Image
import pytest
from refusals import refused

from ballbot_ros.figures import animation
from ballbot_ros.figures.animation import (
    animate, check_animation, ffmpeg, frame_samples, mean_forces)
from ballbot_ros.physics import load_scene

DURATION = 0.24  # of the run; contact with the step begins at 0.145 s
BALL = (0, 114, 178)  # colour of its outline


@pytest.fixture(scope='module')
def run():
    """Return a run over a step."""
    scene = load_scene('fig7_bottom')
    return replace(scene, run=replace(scene.run, duration=DURATION)).simulate()


def frames_of(path):
    """Return the pictures of a GIF as arrays, and their durations [ms]."""
    with Image.open(path) as image:
        pictures, periods = [], []
        for number in range(image.n_frames):
            image.seek(number)
            pictures.append(np.asarray(image.convert('RGB')).astype(int))
            periods.append(image.info['duration'])
    return pictures, periods


def middle_of_ball(picture):
    """Return the column of the centre of the ball [pixels]."""
    columns = np.flatnonzero((np.abs(picture - BALL).sum(axis=-1) < 12).any(axis=0))
    return 0.5 * (columns[0] + columns[-1])


@pytest.fixture(scope='module')
def gif(run, tmp_path_factory):
    """Return the pictures of the run, and their durations [ms]."""
    path = tmp_path_factory.mktemp('animation') / 'run.gif'
    animate(run, path, 'a step')
    assert path.stat().st_size < 2e6 / 3.0 * DURATION
    return frames_of(path)


@pytest.mark.slow
def test_a_gif_lasts_as_long_as_the_run_and_shows_its_end_for_a_second(gif):
    pictures, periods = gif
    assert sum(periods[:-1]) == pytest.approx(1e3 * DURATION, abs=20.0)
    assert periods[-1] == periods[0] + 1000


@pytest.mark.slow
def test_the_ball_moves_as_far_in_the_pictures_as_in_the_run(run, gif):
    pictures, _ = gif
    diameter = np.ptp(np.flatnonzero(
        (np.abs(pictures[0] - BALL).sum(axis=-1) < 12).any(axis=0)))
    travel = middle_of_ball(pictures[-1]) - middle_of_ball(pictures[0])
    expected = (run['x'][-1] - run['x'][0]) / (2.0 * run.model.robot.ball_radius) * diameter
    assert travel == pytest.approx(expected, abs=3.0)


@pytest.mark.slow
def test_colours_are_those_of_the_figures_in_all_frames(gif):
    for picture in gif[0]:
        assert (picture == 255).all(axis=-1).mean() > 0.4  # paper is white
        for colour in ((213, 94, 0), BALL):
            assert (picture == colour).all(axis=-1).any()


@pytest.mark.slow
def test_playback_stretches_time(run, tmp_path):
    animate(run, tmp_path / 'slow.gif', playback=0.5)
    pictures, periods = frames_of(tmp_path / 'slow.gif')
    assert sum(periods[:-1]) == pytest.approx(2e3 * DURATION, abs=20.0)


def test_frames_are_the_nearest_samples_of_an_uneven_run():
    time = np.array([0.0, 0.001, 0.05, 0.079, 0.08, 0.12])
    assert frame_samples(time, 1.0).tolist() == [0, 2, 4, 5]
    assert frame_samples(time[:1], 1.0).tolist() == [0]


@pytest.mark.slow
def test_a_run_of_one_sample_is_one_picture(run, tmp_path):
    animate(replace(run, rows=run.rows[:1]), tmp_path / 'one.gif')
    assert len(frames_of(tmp_path / 'one.gif')[0]) == 1


@pytest.mark.slow
def test_the_view_follows_the_ball_over_a_long_distance(run, tmp_path):
    rows = run.rows[:3].copy()
    rows[:, 0], rows[:, 1] = (0.0, 0.04, 0.08), (0.0, 50.0, 100.0)
    animate(replace(run, rows=rows), tmp_path / 'far.gif')
    pictures, _ = frames_of(tmp_path / 'far.gif')
    places = [middle_of_ball(picture) for picture in pictures]
    assert np.ptp(places) <= 2.0
    assert places[0] == pytest.approx(0.5 * pictures[0].shape[1], rel=0.1)


def test_mean_forces_carry_the_momentum_of_the_run(run):
    frames = np.arange(0, len(run), 40)
    forces = mean_forces(run, frames)
    robot = run.model.robot
    lift = 0.04 * sum(force.force_y for arrows in forces[1:] for force in arrows)
    masses = robot.ball_mass, robot.pendulum_mass
    bob = (run['velocity_y'] + robot.pendulum_length * run['pendulum_rate']
           * np.sin(run['pendulum_angle']))
    momentum = masses[0] * run['velocity_y'] + masses[1] * bob
    gained = momentum[frames[-1]] - momentum[0]
    span = run['time'][frames[-1]] - run['time'][0]
    assert lift == pytest.approx(gained + robot.total_mass * robot.gravity * span, rel=0.02)


def test_arrows_start_on_the_shell_one_each_for_edge_and_floor(run):
    touch = int(np.flatnonzero(run['edge_normal_force'] > 0.0)[0])
    arrows = mean_forces(run, np.array([touch]))[0]
    assert len(arrows) == 2
    for arrow in arrows:
        away = math.hypot(arrow.x - run['x'][touch], arrow.y - run['y'][touch])
        assert away == pytest.approx(run.model.robot.ball_radius)


@pytest.mark.slow
def test_progress_is_reported_up_to_the_end(run, tmp_path):
    fractions = []
    animate(run, tmp_path / 'run.gif', playback=5.0, progress=fractions.append)
    assert fractions == sorted(fractions) and fractions[-1] == 1.0


@pytest.mark.slow
def test_an_interruption_leaves_no_file(run, tmp_path):
    def stop(done):
        raise KeyboardInterrupt

    for kind in ('gif', 'mp4') if ffmpeg() else ('gif',):
        with pytest.raises(KeyboardInterrupt):
            animate(run, tmp_path / f'run.{kind}', progress=stop)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.skipif(ffmpeg() is None, reason='ffmpeg is not installed')
def test_an_mp4_has_the_frames_of_the_run(run, tmp_path):
    animate(run, tmp_path / 'run.mp4')
    answer = subprocess.run(
        [ffmpeg(), '-loglevel', 'error', '-i', tmp_path / 'run.mp4', '-f', 'rawvideo', '-pix_fmt',
         'gray', '-s', '8x8', '-'], capture_output=True, check=True)
    assert len(answer.stdout) // 64 == len(frame_samples(run['time'], 1.0))


@pytest.mark.parametrize('name, duration, playback, reason, field, remedy', [
    ('run.avi', 1.0, 1.0, 'not_a_choice', 'path', '.gif or .mp4'),
    ('run.gif', 1.0, 0.0, 'out_of_range', 'playback', 'at least 0.01'),
    ('run.gif', 1.0, float('nan'), 'out_of_range', 'playback', 'at least 0.01'),
    ('run.gif', 130.0, 1.0, 'out_of_range', 'playback', 'a playback of 3 or more')])
def test_an_unwritable_path_is_refused_with_the_remedy(
        name, duration, playback, reason, field, remedy):
    with refused(reason, field) as caught:
        check_animation(name, duration, playback)
    assert remedy in str(caught.value)


def test_without_ffmpeg_an_mp4_is_refused_with_the_remedy(monkeypatch, tmp_path):
    monkeypatch.setattr(animation, 'ffmpeg', lambda: None)
    with refused('not_installed', 'ffmpeg'):
        check_animation('run.mp4', 1.0)
