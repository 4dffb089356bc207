# SPDX-License-Identifier: Apache-2.0
"""The text of pictures matches their content, and a command reproduces each picture."""
import argparse
from pathlib import Path
import re
import shlex

from figure_words import words_of
import numpy as np
import pytest

from ballbot_ros.cli import identify
from ballbot_ros.figures import canvas
from ballbot_ros.figures.drawing import draw_ball, FORCE, legend, PATH, PENDULUM, TURNING
from ballbot_ros.figures.film import Mark, strip
from ballbot_ros.figures.residuals import residual_figure
from ballbot_ros.physics import load_robot, load_scene, Trajectory
from ballbot_ros.studies.identification import channel_fit

ROOT = Path(__file__).resolve().parents[3]
PAGES = [ROOT / 'README.md', *sorted((ROOT / 'docs').glob('*.md'))]
MADE_BY = re.compile(r'`(ballbot |make |(\.venv/bin/)?python |scripts/|bench/)')


def crossing():
    """Return a run over the 56 mm step as a few states, without simulating it."""
    scene = load_scene('fig7_bottom')
    radius = scene.model.robot.ball_radius
    face = scene.model.terrain.vertices
    edge = float(face[np.argmax(np.diff(face[:, 1]) > 0.01) + 1, 0])
    rows = np.zeros((60, 15))
    rows[:, 0] = np.linspace(0.0, 1.2, 60)
    rows[:, 3] = edge - 0.5 + rows[:, 0]  # x at 1 m/s
    rows[:, 4] = radius + np.where(rows[:, 3] > edge - 0.1, 0.0561, -1e-5)
    rows[:, 7] = 1.0
    return Trajectory(scene.model, rows)


def test_the_colour_names_of_a_legend_match_the_drawn_colours():
    class Axes:
        colours = []

        def add_patch(self, patch):
            self.colours.append(patch.get_facecolor())

        def plot(self, *_, color, **__):
            self.colours.append(color)

    axes = Axes()
    draw_ball(axes, load_robot('gimball'), 0.0, 0.0, 0.0, 1.0, 1.0)
    assert {TURNING, PENDULUM} <= {colour for colour in axes.colours if isinstance(colour, str)}
    assert f'{canvas.NAMES[PENDULUM]}: pendulum' in legend()
    assert legend(pendulum=False, force=True) == '; '.join([
        f'{canvas.NAMES[TURNING]}: turns with the ball',
        f'{canvas.NAMES[PATH]}: path of the centre',
        f'{canvas.NAMES[FORCE]}: ground contact force'])
    page = (ROOT / 'docs' / 'view.md').read_text()
    assert f'its pendulum ({canvas.NAMES[canvas.VERMILION]})' in page
    assert f'the ground contact forces ({canvas.NAMES[canvas.ORANGE]})' in page


def test_the_strip_states_the_decision_and_the_result_at_each_step():
    run = crossing()
    words = words_of(strip(run, 'fig7_bottom', [
        Mark(0.1, 'CROSS', True), Mark(0.9, 'GO ROUND', False), Mark(9.0, 'later', True)]))
    assert 'CROSS' in words and 'GO ROUND' in words and 'later' not in words
    result = next(text for text in words if 'mm' in text)
    assert re.fullmatch(r'[\d.]+ mm: (not )?over\nat 1\.00 m/s', result)
    assert legend() in '; '.join(words)


def test_a_residual_plot_states_a_bad_fit_and_its_command():
    time, chance = np.linspace(0.0, 1.0, 400), np.random.default_rng(0)
    motion, noise = np.sin(5.0 * time), chance.normal(0.0, 1e-3, 400)
    channels = {'ball_angle': channel_fit(motion, noise, 1e-3, 0.0),
                'joint_angle': channel_fit(motion, 0.02 * np.cos(9.0 * time), 1e-6, 0.0),
                'x': channel_fit(motion, 0.9 * motion, 1e-6, 0.0)}
    assert [item.verdict for item in channels.values()] == ['good', 'correlated', 'poor']
    figure = residual_figure(dict.fromkeys(channels, (time, noise)), channels, 'mine',
                             'ballbot identify mine.yaml run.csv')
    good, correlated, poor = (axes.get_title('left') for axes in figure.axes)
    assert 'CORRELATED' in correlated and 'POOR FIT' in poor and 'FIT' not in good
    assert 'ballbot identify mine.yaml run.csv' in figure.axes[-1].get_xlabel()


def test_the_complete_command_is_visible_below_a_residual_plot():
    time, command = np.linspace(0.0, 1.0, 9), 'ballbot identify ' + 'runs/measured.csv ' * 12
    channels = {'x': channel_fit(np.sin(time), 1e-3 * np.cos(time), 1e-3, 0.0)}
    figure = residual_figure({'x': (time, time)}, channels, 'mine', command)
    figure.canvas.draw()
    drawn = figure.axes[-1].xaxis.label.get_window_extent()
    assert drawn.x0 >= 0.0 and drawn.x1 <= figure.bbox.width and drawn.y0 >= 0.0
    assert figure.axes[-1].get_xlabel().split()[-12:] == ['runs/measured.csv'] * 12


def test_integration_error_alone_does_not_warn():
    time = np.linspace(0.0, 1.0, 400)
    assert channel_fit(np.sin(time), 1e-8 * np.cos(time), 1e-12, 1e-8).verdict == 'good'


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.name)
def test_every_picture_of_a_document_has_the_command_that_makes_it(page):
    lines = page.read_text(encoding='utf-8').splitlines()
    for number, line in enumerate(lines):
        if line.startswith('!['):
            near = ' '.join(lines[max(number - 4, 0):number] + lines[number + 1:number + 5])
            assert MADE_BY.search(near), f'{page.name}:{number + 1}: {line}'


def test_the_caption_of_residuals_is_the_complete_command():
    words = ['hall.yaml', 'my runs/run.csv', '--estimate', 'joint_friction', 'initial.speed',
             '--channels', 'x', '--recorded-torque']
    parser = argparse.ArgumentParser()
    identify.add_arguments(parser)
    assert shlex.split(identify.command_of(parser.parse_args(words))) == [
        'ballbot', 'identify', *words]
