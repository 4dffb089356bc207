# SPDX-License-Identifier: Apache-2.0
"""Figures exist for every scene, are not empty and are to scale."""
from functools import lru_cache
import warnings

import numpy as np
import pytest
from refusals import refused
from tiers import slow

from ballbot_ros.config.files import shipped_files
from ballbot_ros.figures.frames import lay_out, MOST_ROWS
from ballbot_ros.figures.run import save, strip, time_series
from ballbot_ros.physics import load_scene, Model, Terrain, Trajectory

SCENES = sorted(path.stem for path in shipped_files('scenes'))


@lru_cache(maxsize=None)
def run_of(name):
    return load_scene(name).simulate()


def pixels(figure):
    figure.set_dpi(60)  # enough to detect an empty figure
    figure.canvas.draw()
    return np.asarray(figure.canvas.buffer_rgba())[..., :3]


@pytest.mark.slow
@pytest.mark.parametrize('draw', [strip, time_series])
@pytest.mark.parametrize('scene', SCENES)
def test_each_scene_gives_a_figure_without_warnings(scene, draw):
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        image = pixels(draw(run_of(scene), scene))
    coloured = np.ptp(image.astype(int), axis=2) > 30
    assert coloured.mean() > 0.001
    border = (image[:2], image[-2:], image[:, :2], image[:, -2:])
    assert all((edge == 255).all() for edge in border), 'the figure is cut off'


@pytest.mark.parametrize('scene', [*SCENES[:2], *slow(*SCENES[2:])])
def test_a_strip_is_true_to_scale(scene):
    figure = strip(run_of(scene))
    width, height = figure.get_size_inches()
    scales = set()
    for axes in figure.axes:
        box = axes.get_position()
        scales.add(round(box.width * width / np.ptp(axes.get_xlim()), 6))
        scales.add(round(box.height * height / np.ptp(axes.get_ylim()), 6))
    assert len(scales) == 1


@pytest.mark.parametrize('scene', SCENES)
def test_outlines_keep_a_distance_and_show_start_and_end(scene):
    run = run_of(scene)
    chosen = lay_out(run)
    assert chosen.rows[0].frames[0] == 0
    if len(chosen.rows) == chosen.of and np.ptp(run['x']) > chosen.gap:
        assert chosen.rows[-1].frames[-1] == len(run) - 1
    for row in chosen.rows:
        places = np.column_stack([run['x'], run['y']])[row.frames]
        apart = np.hypot(*(places[:, None] - places).transpose(2, 0, 1))
        apart[np.diag_indices(len(places))] = np.inf
        assert apart.min() > 0.19 * chosen.gap


def test_a_ball_that_rolls_back_gets_a_separate_row():
    run = run_of('ramp_release')
    rows = lay_out(run).rows
    assert len(rows) == 2
    assert np.ptp(run['x'][rows[0].samples]) > 1.0
    assert run['x'][rows[1].samples[-1]] < run['x'][rows[1].samples[0]]


def far_run(distance, gimball):
    """Return a ball that rolls uniformly, and an edge at two thirds of the distance."""
    edge = 2.0 * distance / 3.0
    model = Model(gimball, Terrain.step(0.02, at=edge))
    start = model.at_rest(0.0)
    rows = np.tile([*start, 0.0], (3001, 1))
    rows[:, 0] = np.linspace(0.0, distance, 3001)
    rows[:, 3] = rows[:, 0]
    return Trajectory(model, rows), edge


@pytest.mark.slow
def test_a_run_too_long_for_a_picture_shows_its_hardest_impact(gimball):
    run, edge = far_run(100.0, gimball)
    chosen = lay_out(run)
    assert len(chosen.rows) == MOST_ROWS < chosen.of
    shown = np.concatenate([run['x'][row.samples] for row in chosen.rows])
    assert shown.min() < edge < shown.max()
    assert 'of 100 s' in ''.join(text.get_text() for text in strip(run).texts)


def test_a_run_that_diverged_can_be_drawn(gimball):
    run = run_of('fig7_top')
    rows = run.rows[:200].copy()
    rows[150:, 3], rows[160:, 4], rows[170:] = 1e200, np.inf, np.nan
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        broken = Trajectory(run.model, rows)
        for draw in (strip, time_series):
            assert np.ptp(pixels(draw(broken))) > 0


def test_a_single_sample_can_be_drawn():
    run = run_of('fig7_top')
    for draw in (strip, time_series):
        assert np.ptp(pixels(draw(Trajectory(run.model, run.rows[:1])))) > 0


@pytest.mark.parametrize('kind, start', [('png', b'\x89PNG'), ('svg', b'<?xml')])
def test_the_same_run_gives_the_same_file(tmp_path, kind, start):
    run = run_of('flat')
    for number in (1, 2):
        save(strip(run), tmp_path / f'{number}.{kind}')
    content = (tmp_path / f'1.{kind}').read_bytes()
    assert content.startswith(start)
    assert content == (tmp_path / f'2.{kind}').read_bytes()


def test_an_unknown_format_is_refused_with_the_known_ones(tmp_path):
    with refused('not_a_choice', 'path'):
        save(strip(run_of('flat')), tmp_path / 'strip.gif')


@pytest.mark.slow
def test_drawing_does_not_change_the_settings_of_matplotlib():
    import matplotlib
    before = dict(matplotlib.rcParams)
    time_series(run_of('flat'))
    assert dict(matplotlib.rcParams) == before
