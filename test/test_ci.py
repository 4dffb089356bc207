# SPDX-License-Identifier: Apache-2.0
"""Checks of every change: the CI workflow, the pre-commit hooks, and the changelog."""
import os
from pathlib import Path
import re
import shlex
import subprocess
import sys

import pytest
import yaml

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / 'scripts'))

from host import NEWEST, OLDEST  # noqa: E402, I100, I202


def read(name):
    """Return the content of a YAML file of the repository."""
    return yaml.safe_load((ROOT / name).read_text(encoding='utf-8'))


@pytest.fixture
def workflow():
    """Return the workflow."""
    return read('.github/workflows/ci.yml')


def test_the_workflow_tests_every_python_that_make_setup_accepts(workflow):
    pythons = workflow['jobs']['wheels']['strategy']['matrix']['python']
    assert pythons == [f'3.{minor}' for minor in range(OLDEST[1], NEWEST[1] + 1)]


def test_the_workflow_calls_only_existing_files(workflow):
    commands = [step['run'] for job in workflow['jobs'].values() for step in job['steps']
                if 'run' in step]
    assert '.ci/run' in commands
    paths = re.findall(r'src/ballbot_ros/(\S+)', ' '.join(commands)) + ['.ci/run']
    assert len(paths) > 2 and all((ROOT / path).exists() for path in paths), paths
    for command in commands:
        assert subprocess.run(['bash', '-n'], input=command, text=True).returncode == 0


def test_every_step_of_the_workflow_runs_or_uses_something(workflow):
    for job in workflow['jobs'].values():
        assert job['runs-on'] and job['timeout-minutes'] <= 60
        assert all(('run' in step) != ('uses' in step) for step in job['steps'])


@pytest.mark.skipif(not (ROOT / '.venv' / 'bin' / 'python').exists(), reason='no .venv here')
@pytest.mark.parametrize('hook', read('.pre-commit-config.yaml')['repos'][0]['hooks'],
                         ids=lambda hook: hook['id'])
def test_a_hook_calls_an_installed_tool_and_refuses_as_lint_does(hook, tmp_path):
    def hook_succeeds(text):
        path = tmp_path / 'changed.py'
        path.write_text(text, encoding='utf-8')
        done = subprocess.run([*shlex.split(hook['entry']), path], cwd=ROOT, capture_output=True)
        return done.returncode == 0
    if hook.get('pass_filenames', True):
        assert hook_succeeds('import math\nimport os\n\nprint(math.pi, os.sep)\n')
        assert not hook_succeeds('import os\nimport math\n\nprint( "a")\n')
    else:
        files = [word for word in shlex.split(hook['entry']) if word.endswith('.py')]
        assert files and all((ROOT / name).is_file() for name in files)


def test_a_skip_for_a_reason_that_is_not_listed_fails_the_run(tmp_path):
    (tmp_path / 'conftest.py').write_text((ROOT / 'test' / 'conftest.py').read_text())
    (tmp_path / 'skips.txt').write_text('^no wheel of  # a registry lacks it\n')
    test = tmp_path / 'test_some.py'
    for reason, code in (('no wheel of launch_ros', 0), ('dask is not installed', 1)):
        test.write_text(f'import pytest\n\n\ndef test_some():\n    pytest.skip("{reason}")\n')
        done = subprocess.run(
            [sys.executable, '-m', 'pytest', '-q', '-p', 'no:cacheprovider', '--rootdir', tmp_path,
             '--allowed-skips', tmp_path / 'skips.txt', test], capture_output=True, text=True,
            cwd=tmp_path, env={**os.environ, 'PYTHONPATH': str(ROOT)})
        assert done.returncode == code, done.stdout + done.stderr
        assert (f'test_some: {reason}' in done.stdout) is bool(code)


def test_each_allowed_skip_occurs_in_a_test():
    patterns = [line.split('  #')[0] for line in (ROOT / '.ci' / 'skips.txt').read_text(
        encoding='utf-8').splitlines()[1:]]
    sources = [path.read_text(encoding='utf-8') for path in (ROOT / 'test').rglob('test_*.py')]
    assert patterns and not [pattern for pattern in patterns
                             if not any(re.search(pattern, text) for text in sources)]


def test_the_changelog_is_well_formed_and_has_a_section_for_the_next_release():
    core = pytest.importorskip('docutils.core')
    text = (ROOT / 'CHANGELOG.rst').read_text(encoding='utf-8')
    tree = core.publish_doctree(text, settings_overrides={'report_level': 5})
    complaints = [node.astext() for node in tree.findall() if node.tagname == 'system_message']
    assert not complaints, complaints
    titles = [node.astext() for node in tree.findall() if node.tagname in ('title', 'subtitle')]
    assert titles[:2] == ['Changelog for package ballbot_ros', 'Forthcoming']
