# SPDX-License-Identifier: Apache-2.0
"""
Build the documentation site with the Sphinx of .venv/docs; a warning is an error.

    .venv/bin/python scripts/make_docs.py [FOLDER]        # build/site by default
"""
import os
import subprocess
import sys

from stages import path_argument, ROOT, VENV

PACKAGES = VENV / 'docs'  # of scripts/bootstrap.py


def build(folder):
    """Build the site into a folder; return the exit code of Sphinx."""
    path = os.pathsep.join(filter(None, [str(PACKAGES), os.environ.get('PYTHONPATH')]))
    return subprocess.run(
        [sys.executable, '-m', 'sphinx', '-W', '--keep-going', '-q', '-b', 'html',
         '-d', folder.with_name(f'{folder.name}-read'), ROOT / 'docs', folder],
        env={**os.environ, 'PYTHONPATH': path}).returncode


def main():
    folder = path_argument('folder', ROOT / 'build' / 'site').resolve()
    code = build(folder)
    if code == 0:
        print(f'the site is {folder / "index.html"}')
    return code


if __name__ == '__main__':
    sys.exit(main())
