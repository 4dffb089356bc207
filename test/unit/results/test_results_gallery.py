# SPDX-License-Identifier: Apache-2.0
"""The figures are drawn, state that they are simulated, and are kept after an interruption."""
import sys

from figure_words import words_of
import numpy as np
import pytest

from ballbot_ros.cli import main
from ballbot_ros.figures import command_loss, steering
from ballbot_ros.paper import design, figures as paper, heights
from ballbot_ros.paper.procedure import run_tests
from ballbot_ros.paper.test_bench import Ramp, Roll
from ballbot_ros.physics import load_robot

FEW = np.array([0.4, 0.6, 0.8, 1.0, 1.1])


@pytest.fixture
def coarse(monkeypatch):
    """Reduce the cost of every figure."""
    for module in (paper, design):
        monkeypatch.setattr(module, 'SPEEDS', FEW)
    monkeypatch.setattr(paper, 'MUJOCO_SPEEDS', FEW[:1])
    monkeypatch.setattr(paper, 'MUJOCO_STEP', 1e-3)
    monkeypatch.setattr(paper, 'run_tests', lambda bench, robot: run_tests(
        bench, robot, (0.01,), fine_rolls=2))
    monkeypatch.setattr(command_loss, 'COLUMNS', command_loss.COLUMNS[:2])
    monkeypatch.setattr(steering, 'TURNING_SPEEDS', steering.TURNING_SPEEDS[:1])
    monkeypatch.setattr(design, 'SAMPLES', 4)
    monkeypatch.setattr(design, 'SLOPE_SPEEDS', FEW[:2])
    monkeypatch.setattr(design, 'LENGTHS', np.linspace(0.02, 0.16, 3))
    monkeypatch.setattr(design, 'MASSES', np.linspace(0.5, 4.0, 3))


@pytest.mark.parametrize('name', [
    pytest.param(name, marks=() if name in ('fig6', 'design') else pytest.mark.slow)
    for name in paper.FIGURES])
def test_every_figure_states_its_origin_and_reports_its_progress(name, coarse):
    fractions = []
    text = '\n'.join(words_of(paper.FIGURES[name](fractions.append)))
    assert ('re-simulated' if name.startswith('fig') else 'simulated with the full') in text
    assert fractions == sorted(fractions) and fractions[-1] == pytest.approx(1.0)


def test_figure_6_has_the_three_printed_points(coarse):
    axes = paper.figure_6().axes[0]
    stars = next(line for line in axes.lines if line.get_marker() == '*')
    np.testing.assert_allclose(stars.get_xydata(), [[0.76, 21.0], [0.78, 31.0], [1.09, 56.0]])


def test_figure_8_reports_a_missing_second_simulator(coarse, monkeypatch):
    monkeypatch.setitem(sys.modules, 'mujoco', None)
    assert 'MuJoCo is not installed' in '\n'.join(words_of(paper.figure_8()))


def test_rolls_are_drawn_according_to_their_outcome():
    nan = float('nan')
    figure = heights.bench_figure(load_robot('shellball'), Ramp(), [
        Roll(0.01, 1.0, 0.5, True, 0.4, 0.0), Roll(0.01, 1.0, 0.3, False, 0.2, 0.0),
        Roll(0.01, 1.0, nan, False, nan, nan)], 'a test')
    _, passed, failed = figure.axes[0].lines
    assert passed.get_xydata()[:, 0].tolist() == [0.5]
    assert failed.get_xydata()[0, 0] == 0.3 and len(failed.get_xydata()) == 2


def test_the_command_lists_the_figures(capsys):
    assert main(['figures', '--list']) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == list(
        paper.FIGURES)
    assert main(['figures', '--list', 'fig7']) == 2


def test_an_unknown_figure_is_refused_with_the_nearest(capsys, tmp_path):
    assert main(['figures', 'fig9', '--out', str(tmp_path)]) == 2
    assert 'did you mean' in capsys.readouterr().err


def test_an_interruption_keeps_the_completed_figures(capsys, tmp_path, monkeypatch, coarse):
    def stop(progress):
        raise KeyboardInterrupt

    monkeypatch.setattr(paper, 'FIGURES', {'slope': design.slope, 'never': stop})
    assert main(['figures', '--quiet', '--out', str(tmp_path)]) == 130
    assert sorted(path.name for path in tmp_path.iterdir()) == ['slope.png', 'slope.svg']
    assert 'slope.png, slope.svg are in' in capsys.readouterr().err


def test_one_format_is_enough(tmp_path, coarse, capsys):
    assert main(['figures', 'slope', '--format', 'svg', '--out', str(tmp_path)]) == 0
    assert [path.name for path in tmp_path.iterdir()] == ['slope.svg']
    assert 'slope.svg' in capsys.readouterr().out
