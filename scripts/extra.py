# SPDX-License-Identifier: Apache-2.0
"""
Install what one target of the Makefile needs and nothing else does, from requirements/NAME.txt.

    python3 scripts/extra.py fuzz

Done once for each version of that file; where it fails, it says so once.
"""
import sys

from host import Problem
from stages import digest, done, ROOT, stage, VENV


def main(name):
    """Install, unless it is there; return the exit code."""
    wanted = ROOT / 'requirements' / (name + '.txt')
    key = digest(str(VENV), wanted)
    if done(name, key):
        return 0
    try:
        with stage(name, 'for make ' + {'peers': 'bench'}.get(name, name), key) as command:
            command(VENV / 'bin' / 'python', '-m', 'pip', '--disable-pip-version-check', 'install',
                    '--no-input', '-r', wanted,
                    hint='If this was the network, run again: what is installed is kept.')
    except Problem as problem:
        print(problem, file=sys.stderr)
        return 1
    return 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1]))
