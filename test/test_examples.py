# SPDX-License-Identifier: Apache-2.0
"""Every example runs as documented, is short, and prints the expected result."""
from pathlib import Path
import re
import subprocess
import sys

from PIL import Image
import pytest

EXAMPLES = Path(__file__).resolve().parent.parent / 'examples'


@pytest.fixture
def run(tmp_path):
    """Return a function that runs an example in an empty folder and returns what it prints."""
    def run_example(name, *arguments):
        done = subprocess.run([sys.executable, EXAMPLES / name, *arguments], cwd=tmp_path,
                              capture_output=True, text=True, timeout=300)
        assert done.returncode == 0, done.stderr
        return done.stdout
    return run_example


def numbers(text):
    """Return the numbers of a line."""
    return [float(number) for number in re.findall(r'-?\d+\.\d+', text)]


def test_each_example_is_short_and_run_by_a_test():
    here = Path(__file__).read_text(encoding='utf-8')
    scripts = sorted(EXAMPLES.glob('*.py'))
    assert len(scripts) >= 5
    for script in scripts:
        assert len(script.read_text(encoding='utf-8').splitlines()) <= 60, script.name
        assert f"run('{script.name}'" in here, script.name


def test_a_run_is_summarized_and_drawn(run, tmp_path):
    assert '21.0 mm' in run('simulate_and_plot.py')
    for name in ('crossing.png', 'time_series.png'):
        with Image.open(tmp_path / name) as picture:
            assert min(picture.size) > 300


def test_a_horizontal_pendulum_and_more_speed_raise_the_maximum_height(run):
    lines = run('maximum_step_height.py').splitlines()
    rows = {line[:13].strip(): numbers(line) for line in lines}
    assert all(high > low for low, high in zip(rows['held down'], rows['held level']))
    assert rows['hangs freely'] == sorted(rows['hangs freely'])


def test_a_custom_robot_rolls_and_a_misspelt_key_is_reported(run):
    printed = run('own_robot.py')
    start, end = numbers(printed)[:2]
    assert start == 0.2 and end > 0.5
    assert 'ball_radios' in printed and "'ball_radius'" in printed


def test_the_closed_loop_crosses_the_low_step_and_stops_before_the_high_one(run):
    *decisions, last = run('closed_loop.py').splitlines()
    kinds = [line.split()[2] for line in decisions]
    assert 'CROSS' in kinds and kinds[-1] == 'GO_ROUND'
    x, speed = numbers(last)[1:]
    assert 0.8 < x < 4.0 and abs(speed) < 0.02


def test_python_names_robots_through_a_process_pool_and_a_run(run):
    *masses, crossed = run('python_api.py').splitlines()[:4]
    heights = [numbers(line)[1] for line in masses]
    assert all(15.0 < height < 25.0 for height in heights)
    assert crossed.startswith('crossed: True, first contact at 0.5')


@pytest.mark.parametrize('protocol', ['odrive', 'vesc_can'])  # a serial line and a bus
def test_an_emulated_drive_turns_its_motor_and_stops(run, protocol):
    positions = [numbers(line)[1] for line in run('emulated_drive.py', protocol).splitlines()
                 if ' rad' in line]
    assert len(positions) == 3 and positions[-1] > positions[0] > 0.0
