# SPDX-License-Identifier: Apache-2.0
"""The commands of the tutorial work as printed and described."""
import importlib.util
from pathlib import Path
import re
import subprocess
import sys

import pytest

ROOT = Path(__file__).resolve().parent.parent
TUTORIAL = (ROOT / 'docs' / 'tutorial.md').read_text(encoding='utf-8')


def blocks(text, language):
    """Return the fenced blocks of a language; commands have none."""
    return [content for marked, content in re.findall(
        r'^```(\w*)\n(.*?)^```$', text, re.DOTALL | re.MULTILINE) if marked == language]


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """Return a folder shared by the steps of the tutorial, with its YAML files."""
    place = tmp_path_factory.mktemp('tutorial')
    for content in blocks(TUTORIAL, 'yaml'):
        name = re.match(r'# (\S+\.yaml)\n', content).group(1)
        (place / name).write_text(content, encoding='utf-8')
    return place


def alike(shown, printed):
    """Return whether words are equal, and numbers within 1 % (another processor)."""
    def value(word):
        try:
            return pytest.approx(float(word), rel=0.01)
        except ValueError:
            return word
    return list(map(value, shown)) == [
        float(word) if isinstance(value(word), type(pytest.approx(0.0))) else word
        for word in printed]


def follow(folder, step):
    """Run the commands of a step in a shell; return their output."""
    body = re.search(rf'^## {step}\. .*?\n(.*?)(?=^## |\Z)', TUTORIAL, re.DOTALL | re.M).group(1)
    commands = ''.join(blocks(body, ''))
    assert 'ballbot ' in commands
    script = f'set -e\nballbot() {{ "{sys.executable}" -m ballbot_ros.cli "$@"; }}\n{commands}'
    done = subprocess.run(['bash', '-c', script], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    printed = [line.split() for line in done.stdout.splitlines()]
    for line in ''.join(blocks(body, 'text')).splitlines():
        assert line == '...' or any(alike(line.split(), found) for found in printed), line
    return done.stdout


@pytest.mark.slow
def test_the_first_three_steps_make_a_robot_a_run_and_a_curve(folder):
    assert 'slope_limit' in follow(folder, 1)
    assert re.search(r'20\.0 mm .* no', follow(folder, 2))
    heights = follow(folder, 3)
    assert (folder / 'tumbler_down.yaml').is_file() and 'tumbler_down.yaml' in heights


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec('rclpy') is None, reason='rclpy is not installed')
def test_the_fourth_step_crosses_the_door_step_and_stops_before_the_stair(folder):
    printed = follow(folder, 4)
    assert 'crossed' in printed and 'GO ROUND' in printed


@pytest.mark.slow
def test_the_fifth_step_runs_six_cases(folder):
    pytest.importorskip('pyarrow')
    follow(folder, 5)
    from pyarrow.parquet import read_table
    assert read_table(folder / 'heights.parquet').num_rows == 6


@pytest.mark.slow
def test_the_sixth_step_identifies_the_joint_friction(folder):
    printed = follow(folder, 6)
    found = float(re.search(r'joint_friction\s+[\d.]+\s+([\d.]+)', printed).group(1))
    assert found == pytest.approx(0.05, rel=0.02)


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec('rclpy') is None, reason='rclpy is not installed')
def test_the_seventh_step_drives_through_a_house(folder):
    if not (folder / 'tumbler_down.yaml').is_file():
        pytest.skip('needs the curve of the third step')
    printed = follow(folder, 7)
    assert re.search(r'crosses .*kitchen threshold(.*\n)*.*arrives', printed)
