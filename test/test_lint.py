# SPDX-License-Identifier: Apache-2.0
"""Style and types according to ROS 2, checked with and without the linters of ROS 2."""
import ast
import configparser
import importlib.util
from pathlib import Path
import re
import subprocess
import sys

import pytest
import yaml

ROOT = Path(__file__).resolve().parent.parent
SPDX = '# SPDX-License-Identifier: Apache-2.0'


def project_files(*suffixes):
    """List the files of the project, including new ones, except those that git ignores."""
    try:
        listed = subprocess.run(
            ['git', 'ls-files', '--cached', '--others', '--exclude-standard'],
            cwd=ROOT, check=True, capture_output=True, text=True).stdout.splitlines()
        files = [ROOT / name for name in listed]
    except (OSError, subprocess.CalledProcessError):  # An archive without git history
        folders = ('ballbot_ros', 'bench', 'examples', 'launch', 'scripts', 'test', 'tools', '.ci')
        files = [path for folder in folders for path in (ROOT / folder).rglob('*')]
        files += list(ROOT.glob('*.py'))
    return [path for path in files if path.is_file() and path.suffix in suffixes]


def run_module(*arguments):
    """Run a tool that is a Python module; return its output if it fails."""
    done = subprocess.run([sys.executable, '-m', *map(str, arguments)], cwd=ROOT,
                          capture_output=True, text=True)
    return '' if done.returncode == 0 else done.stdout + done.stderr


def misplaced_imports(*paths):
    """Return the errors of flake8-import-order; flake8 would run all other checks first."""
    from flake8_import_order.checker import ImportOrderChecker
    from flake8_import_order.styles import lookup_entry_point
    config = configparser.ConfigParser()
    config.read(ROOT / 'setup.cfg', encoding='utf-8')
    settings = config['flake8']
    ImportOrderChecker.options = {
        'application_import_names': settings['application-import-names'].split(','),
        'import_order_style': lookup_entry_point(settings['import-order-style'])}
    ignored = settings['extend-ignore'].split(',')

    def checker(path):
        tree = ast.parse(path.read_text(encoding='utf-8'))
        # The checker ignores other statements, but would visit each of their nodes.
        tree.body = [statement for statement in tree.body
                     if isinstance(statement, (ast.Import, ast.ImportFrom, ast.If))]
        return ImportOrderChecker(str(path), tree)
    return [f'{path}:{error.lineno}: {error.code} {error.message}' for path in paths
            for error in checker(path).check_order() if error.code not in ignored]


def has(module):
    """Return whether a module can be imported."""
    return importlib.util.find_spec(module) is not None


def test_each_python_file_starts_with_its_licence():
    missing = [str(path.relative_to(ROOT)) for path in project_files('.py')
               if path.read_text(encoding='utf-8').split('\n')[0] != SPDX
               and path.stat().st_size]
    assert not missing, f'first line must be {SPDX!r} in: ' + ', '.join(missing)


@pytest.mark.skipif(not has('ruff'), reason='ruff is not installed')
def test_ruff_finds_no_errors():
    assert not (report := run_module('ruff', 'check', '--output-format=concise', '.')), report


@pytest.mark.skipif(not has('flake8_import_order'), reason='flake8-import-order is not installed')
def test_imports_are_in_the_order_of_ros_2():
    assert not (found := misplaced_imports(*project_files('.py'))), '\n'.join(found)


@pytest.mark.skipif(not has('flake8_import_order'), reason='flake8-import-order is not installed')
def test_imports_out_of_order_are_found_as_flake8_finds_them(tmp_path):
    path = tmp_path / 'planted.py'
    path.write_text('import os\nimport math\nimport numpy\n\nimport re\n'
                    'from ballbot_ros import errors, config\nimport zlib  # noqa: I100\n')
    done = subprocess.run([sys.executable, '-m', 'flake8', '--select', 'I', path], cwd=ROOT,
                          capture_output=True, text=True)
    by_flake8 = [re.match(r'.*?:(\d+):\d+: (.*)', line).groups()
                 for line in done.stdout.splitlines()]
    assert {said[:4] for _, said in by_flake8} == {'I100', 'I101', 'I201'}
    assert [re.match(r'.*?:(\d+): (.*)', line).groups()
            for line in misplaced_imports(path)] == by_flake8


@pytest.mark.skipif(not has('mypy'), reason='mypy is not installed')
def test_mypy_finds_no_errors():
    # By path: an installed copy must not be checked instead of the checkout.
    paths = ROOT / 'ballbot_ros', *(ROOT / 'examples').glob('*.py')
    assert not (report := run_module('mypy', '--no-error-summary', *paths)), report


@pytest.mark.skipif(not has('ament_flake8'), reason='ament_flake8 is not installed')
def test_ament_flake8_finds_no_errors():
    from ament_flake8.main import main_with_errors
    code, errors = main_with_errors(
        argv=['--config', str(ROOT / 'setup.cfg'), *map(str, project_files('.py'))])
    assert code == 0, '\n'.join(errors)


@pytest.mark.skipif(not has('ament_pep257'), reason='ament_pep257 is not installed')
def test_ament_pep257_finds_no_errors():
    from ament_pep257.main import main
    assert main(argv=[str(path) for path in project_files('.py')]) == 0


@pytest.mark.skipif(not has('ament_xmllint'), reason='ament_xmllint is not installed')
def test_ament_xmllint_finds_no_errors(capfd):
    from ament_xmllint.main import main
    code = main(argv=[str(ROOT / 'package.xml')])
    said = ''.join(capfd.readouterr())
    if 'failed to load' in said or 'Could not find' in said:
        pytest.skip('the schema or xmllint is not available')
    assert code == 0, said


# ament_copyright is not run: it requires the long header and rejects SPDX lines.


def test_shell_scripts_parse():
    scripts = [path for path in [*project_files('.sh', '.bash'), ROOT / '.ci' / 'run']
               if path.exists()]
    assert scripts
    for script in scripts:
        done = subprocess.run(['bash', '-n', script], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr


def test_no_file_names_a_package_host_or_a_home_folder():
    # The pins must install from any mirror, and no path may be specific to one machine.
    pattern = re.compile(r'files\.pythonhosted\.org|--(?:extra-)?index-url|/home/\w|/root/\w')
    here = Path(__file__).name
    found = [f'{path.relative_to(ROOT)}:{number}'
             for path in project_files('.py', '.txt', '.in', '.toml', '.cfg', '.yaml', '.md',
                                       '.xml', '.msg', '.srv', '.sh')
             if path.name != here
             for number, line in enumerate(path.read_text(encoding='utf-8').split('\n'), 1)
             if pattern.search(line)]
    assert not found, found


def test_no_discouraged_word_is_used():
    words = yaml.safe_load((ROOT / 'test' / 'vocabulary.yaml').read_text(encoding='utf-8'))
    found = []
    for path in project_files('.py', '.md', '.yaml', '.msg', '.srv', '.action'):
        # Identifiers are checked as words, too.
        text = path.read_text(encoding='utf-8').lower().replace('_', ' ')
        for word, instead in words.items() if path.name != 'vocabulary.yaml' else ():
            # A lookbehind in the expression would be five times slower.
            found += [f'{path.relative_to(ROOT)}:{text.count(chr(10), 0, match.start()) + 1}: '
                      f'{match[0]!r}; use {instead}'
                      for match in re.finditer(rf'(?:{word})(?![a-z])', text)
                      if not re.match('[a-z]', text[max(match.start() - 1, 0)])]
    assert not found, found
