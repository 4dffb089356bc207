# SPDX-License-Identifier: Apache-2.0
"""The README says what the code does."""
from pathlib import Path
import re
import subprocess
import sys

import pytest

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / 'README.md').read_text(encoding='utf-8')


def test_the_parameter_tables_are_those_of_the_code():
    pytest.importorskip('rclpy')
    check = subprocess.run(
        [sys.executable, str(ROOT / 'scripts' / 'tables.py'), '--check'], capture_output=True,
        text=True)
    assert check.returncode == 0, check.stderr


def test_every_topic_in_the_table_of_nodes_stands_in_the_code():
    rows = [line for line in README.splitlines() if line.startswith((
        '| `simulator` |', '| `controller` |', '| `obstacle_decision` |'))]
    topics = {topic for row in rows for cell in row.split('|')[2:]
              for topic in re.findall(r'`(/?[a-z_]+)`', cell)}
    code = ''.join(path.read_text(encoding='utf-8')
                   for folder in ('nodes', 'ros')
                   for path in (ROOT / 'ballbot_ros' / folder).glob('*.py'))
    missing = {topic for topic in topics if f"'{topic}'" not in code}
    assert len(topics) >= 10 and not missing


def test_linked_files_exist():
    links = re.findall(r'\]\(([^)#]+)\)', README)
    missing = [link for link in links if '://' not in link and not (ROOT / link).exists()]
    assert links and not missing


def test_the_python_example_runs():
    example, = re.findall(r'```python\n(.*?)```', README, re.DOTALL)
    result = subprocess.run([sys.executable, '-c', example], capture_output=True, text=True,
                            cwd=ROOT)
    assert result.returncode == 0, result.stderr
    assert float(result.stdout.split()[0]) > 1.0


def test_the_scene_example_is_a_scene_in_which_the_step_is_crossed():
    import yaml

    from ballbot_ros.physics.scene import read_scene
    example, = re.findall(r'```yaml\n(.*?)```', README, re.DOTALL)
    assert read_scene(yaml.safe_load(example), 'README.md', 'example').simulate()['x'][-1] > 1.2
