# SPDX-License-Identifier: Apache-2.0
"""The documentation site is complete, and is built without a warning."""
import doctest
import importlib
import importlib.util
import os
from pathlib import Path
import re
import subprocess
import sys

import pytest

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / 'docs'
# `make setup` installs Sphinx there.
PACKAGES = ROOT / '.venv' / 'docs'
HAS_SPHINX = importlib.util.find_spec('sphinx') or (PACKAGES / 'sphinx').is_dir()


@pytest.fixture(scope='module')
def site(tmp_path_factory):
    """Return the folder of the built site."""
    if not HAS_SPHINX:
        pytest.skip('Sphinx is not installed; "make setup" installs it')
    folder = tmp_path_factory.mktemp('docs') / 'site'
    done = subprocess.run([sys.executable, str(ROOT / 'scripts' / 'make_docs.py'), str(folder)],
                          capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def test_every_document_is_in_the_contents_of_the_site():
    listed = re.findall(r'^\* \[.+?\]\(([^)]+)\)', (DOCS / 'index.md').read_text(), re.M)
    assert {path.name for path in DOCS.glob('*.md')} - {'index.md'} <= set(listed)
    assert len(listed) == len(set(listed))


def test_a_page_shows_each_figure():
    pages = [ROOT / 'README.md', *DOCS.glob('*.md')]
    shown = {Path(figure).name for page in pages
             for figure in re.findall(r'!\[.*?\]\(([^)]+)\)', page.read_text(encoding='utf-8'))}
    assert {path.name for path in (DOCS / 'figures').iterdir()} == shown


@pytest.mark.parametrize('name', re.findall(
    r'automodule:: ballbot_ros\.(\w+)', (DOCS / 'python.md').read_text(encoding='utf-8')))
def test_each_package_of_the_python_reference_has_examples_and_they_run(name):
    found = doctest.testmod(importlib.import_module(f'ballbot_ros.{name}'))
    assert found.attempted > 0 and found.failed == 0


def test_every_interface_is_in_the_reference():
    text = (DOCS / 'messages.md').read_text(encoding='utf-8')
    assert set(re.findall(r'literalinclude} \.\./(\S+)', text)) == {
        f'{folder}/{path.name}' for folder in ('msg', 'srv', 'action')
        for path in (ROOT / folder).glob(f'*.{folder}')}


def test_every_name_in_the_glossary_of_symbols_exists_in_the_code():
    table = (DOCS / 'glossary.md').read_text(encoding='utf-8').split('## Terms')[0]
    cells = [line.split('|')[2] for line in table.splitlines() if line.startswith('| ')]
    names = {name for cell in cells for name in re.findall(r'`([a-z_0-9]+)`', cell)}
    code = '\n'.join(path.read_text(encoding='utf-8')
                     for path in (ROOT / 'ballbot_ros').rglob('*.py'))
    assert len(names) > 40
    assert names <= set(re.findall(r'\w+', code)), names - set(re.findall(r'\w+', code))


@pytest.mark.parametrize('page', ['files.md', 'nodes.md', 'robot.md', 'hardware.md'])
def test_each_parameter_and_key_is_described_in_a_complete_phrase(page):
    """The phrases are also descriptions of parameters, without the context of a table."""
    rows = re.findall(r'^\| `.*\|$', (DOCS / page).read_text(encoding='utf-8'), re.M)
    cells = [cell for row in rows for cell in re.split(r' *(?<!\\)\| *', row)[2:]]
    assert len(cells) > 50
    fragments = re.compile(r'(of|that|and|likewise|over|beyond|the same|(in|at|by|below|above|'
                           r'after|from) (which|what|a look))\b(?! least| most)')
    assert not [cell for cell in cells if fragments.match(cell)]


def test_files_that_a_document_names_exist():
    folders = ('ballbot_ros', 'test', 'scripts', 'bench', 'launch', 'examples', 'extremes', 'docs',
               'config', 'msg', 'srv', 'action', 'interfaces', 'requirements', 'foxglove',
               'cmake_msgs')
    files = list(ROOT.glob('*.*'))
    for folder in folders:
        files += (ROOT / folder).rglob('*.*')
    # A name without a folder may be a file of the user, unless it is a module.
    named = {(page.name, f'/{name}') for page in [*DOCS.glob('*.md'), ROOT / 'README.md']
             for name in re.findall(
                 r'`([\w/.-]+\.py|[\w-]+(?:/[\w-]+)+\.(?:yaml|json|md|txt|msg|srv|action|ipynb))'
                 r'(?:::\w+)?`', page.read_text('utf-8'))}
    assert len(named) > 50
    assert not [(page, name) for page, name in sorted(named)
                if not any(path.as_posix().endswith(name) for path in files)]


@pytest.mark.slow
@pytest.mark.parametrize('script', ['draw_architecture', 'draw_docs', 'make_docs', 'run_notebook'])
def test_help_of_a_script_that_draws_writes_nothing(tmp_path, script):
    done = subprocess.run([sys.executable, str(ROOT / 'scripts' / f'{script}.py'), '--help'],
                          capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0 and done.stdout.startswith('usage:'), done.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_the_site_is_built_without_a_warning_and_loads_nothing_from_other_machines(site):
    pages = list(site.rglob('*.html'))
    assert len(pages) > 30
    for page in pages:
        text = page.read_text(encoding='utf-8')
        loaded = re.findall(r'<(?:script|img|source)[^>]* src="([^"]+)"', text)
        loaded += re.findall(r'<link[^>]* rel="stylesheet"[^>]* href="([^"]+)"', text)
        assert not [link for link in loaded if link.startswith(('http', '//'))], page.name


@pytest.mark.slow
def test_links_that_leave_the_folder_of_the_documents_stay_in_the_site(site):
    page = (site / 'model.html').read_text(encoding='utf-8')
    assert '_images/conventions.png' in page
    front = (site / 'generated' / 'readme.html').read_text(encoding='utf-8')
    assert 'href="../model.html"' in front and '.md"' not in front


@pytest.mark.slow
def test_the_settings_work_from_another_folder_as_with_rosdoc2(tmp_path):
    """Rosdoc2 executes docs/conf.py from its own file in another folder."""
    if not HAS_SPHINX:
        pytest.skip('Sphinx is not installed; "make setup" installs it')
    script = f'__file__ = {str(tmp_path / "conf.py")!r}; ' \
        f'exec(open({str(DOCS / "conf.py")!r}).read()); print(ROOT, project, html_theme)\n' \
        'assert "index.rst" in exclude_patterns  # rosdoc2 writes one'
    path = os.pathsep.join([str(PACKAGES), str(ROOT), os.environ.get('PYTHONPATH', '')])
    done = subprocess.run([sys.executable, '-c', script], capture_output=True, text=True,
                          cwd=tmp_path, env={**os.environ, 'PYTHONPATH': path})
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == [str(ROOT), 'ballbot_ros', 'furo']
