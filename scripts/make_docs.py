# SPDX-License-Identifier: Apache-2.0
"""
Build the documentation site: install Sphinx into .venv/docs, then run it; a warning is an error.

    .venv/bin/python scripts/make_docs.py [FOLDER]        # build/site by default
"""
import importlib.util
import os
from pathlib import Path
import subprocess
import sys

from host import Problem
from stages import digest, done, ROOT, stage, VENV

PACKAGES = VENV / 'docs'
REQUIREMENTS = ROOT / 'requirements' / 'docs.txt'
NEEDED = ('sphinx', 'myst_parser', 'furo', 'sphinxarg', 'sphinx_copybutton')


def install():
    """Install what builds the site, beside the packages of .venv and not among them."""
    key = digest(REQUIREMENTS, sys.version)
    if done('docs', key):
        return
    with stage('docs', 'Sphinx and its theme, half a minute', key) as command:
        command(sys.executable, '-m', 'pip', '--disable-pip-version-check', 'install',
                '--no-input', '--no-deps', '--upgrade', '--target', PACKAGES, '-r', REQUIREMENTS,
                hint='If this was the network, run again: what is installed is kept.')


def build(folder):
    """Build the site into a folder; return the exit code of Sphinx."""
    path = os.pathsep.join(filter(None, [str(PACKAGES), os.environ.get('PYTHONPATH')]))
    return subprocess.run(
        [sys.executable, '-m', 'sphinx', '-W', '--keep-going', '-q', '-b', 'html',
         '-d', folder.with_name(f'{folder.name}-read'), ROOT / 'docs', folder],
        env={**os.environ, 'PYTHONPATH': path}).returncode


def main():
    """Install, unless Sphinx is there already, and build."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else ROOT / 'build' / 'site').resolve()
    try:
        if not all(importlib.util.find_spec(name) for name in NEEDED):
            install()
    except Problem as problem:
        sys.exit(str(problem))
    code = build(folder)
    if code == 0:
        print(f'the site is {folder / "index.html"}')
    return code


if __name__ == '__main__':
    sys.exit(main())
