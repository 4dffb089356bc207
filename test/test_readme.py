# SPDX-License-Identifier: Apache-2.0
"""README and documents agree with the code."""
import argparse
from pathlib import Path
import re
import subprocess
import sys

import pytest

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / 'README.md').read_text(encoding='utf-8')
DOCUMENTS = [ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', *sorted((ROOT / 'docs').glob('*.md'))]


def test_the_parameter_tables_match_the_code():
    pytest.importorskip('rclpy')
    check = subprocess.run(
        [sys.executable, str(ROOT / 'scripts' / 'tables.py'), '--check'], capture_output=True,
        text=True)
    assert check.returncode == 0, check.stderr


@pytest.mark.parametrize('document', DOCUMENTS, ids=lambda path: path.name)
def test_linked_files_and_pictures_exist(document):
    links = re.findall(r'\]\(([^)#]+)\)', document.read_text(encoding='utf-8'))
    missing = [link for link in links
               if '://' not in link and not (document.parent / link).exists()]
    assert not missing


def test_every_document_can_be_reached_from_the_readme():
    found, new = set(), {ROOT / 'README.md'}
    while new:
        found |= new
        links = {(document.parent / link).resolve() for document in new
                 for link in re.findall(r'\]\(([^)#]+\.md)', document.read_text(encoding='utf-8'))}
        new = links - found
    assert set(DOCUMENTS) <= found


def test_every_command_that_is_printed_has_its_verb_and_options():
    from ballbot_ros.cli.command import load_verb, VERBS
    printed, unknown = 0, []
    for document in DOCUMENTS:
        text = document.read_text(encoding='utf-8').replace('\\\n', ' ')
        for words in re.findall(r'^(?:\.venv/bin/)?ballbot ([a-z].*)$', text, re.M):
            printed += 1
            verb, *rest = words.split('#')[0].split()
            if verb not in VERBS:
                unknown.append(words)
                continue
            parser = argparse.ArgumentParser()
            load_verb(verb).add_arguments(parser)
            options = {option for action in parser._actions for option in action.option_strings}
            if verb == 'run' and '--ros-args' in rest:
                del rest[rest.index('--ros-args'):]  # options of ROS
            unknown += [f'{verb} {word}' for word in rest
                        if word.startswith('--') and word not in options]
    assert printed > 15 and not unknown


def printed_by_the_example_of(document):
    example, = re.findall(
        r'```python\n(.*?)```', (ROOT / document).read_text(encoding='utf-8'), re.DOTALL)
    result = subprocess.run([sys.executable, '-c', example], capture_output=True, text=True,
                            cwd=ROOT)
    assert result.returncode == 0, result.stderr
    return result.stdout


def test_the_python_example_runs():
    crossed, x = printed_by_the_example_of('README.md').split()[:2]
    assert crossed == 'True' and float(x) > 1.0


def test_the_python_example_for_the_highest_step_runs():
    printed_by_the_example_of('docs/max_step_height.md')


def test_the_scene_example_is_a_scene_in_which_the_step_is_crossed():
    import yaml

    from ballbot_ros.physics.simulation.scene import read_scene
    example, = re.findall(r'```yaml\n(.*?)```', README, re.DOTALL)
    assert read_scene(yaml.safe_load(example), 'README.md', 'example').simulate()['x'][-1] > 1.2
