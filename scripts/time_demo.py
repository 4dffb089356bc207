# SPDX-License-Identifier: Apache-2.0
"""
Print where the seconds of a first and of a second `make demo` go.

    python3 scripts/time_demo.py

Clones the last commit into a temporary folder and runs the demo there twice, with an empty cache
of kernels. Packages that uv or pip have downloaded before come from their caches.
"""
import os
from pathlib import Path
import subprocess
import sys
import tempfile
import time

ROOT = Path(__file__).resolve().parent.parent


def main():
    """Return the exit code of the first run that fails, else 0."""
    with tempfile.TemporaryDirectory(prefix='ballbot_demo_') as folder:
        clone = Path(folder) / 'clone'
        subprocess.run(['git', 'clone', '--quiet', '--depth', '1', ROOT.as_uri(), str(clone)],
                       check=True)
        env = dict(os.environ, XDG_CACHE_HOME=str(Path(folder) / 'cache'))
        # uv keeps its downloads there, which are no part of the kernels.
        env.setdefault('UV_CACHE_DIR', str(Path(os.environ.get(
            'XDG_CACHE_HOME') or Path.home() / '.cache') / 'uv'))
        for name in ('first', 'second'):
            before, start = os.times(), time.monotonic()
            code = subprocess.run(['make', 'demo', 'PYTHON=' + sys.executable], cwd=str(clone),
                                  env=env).returncode
            after = os.times()
            spent = sum(after[2:4]) - sum(before[2:4])
            print('\n%s make demo: %.1f s, %.1f CPU s, load of this machine %.1f\n'
                  % (name, time.monotonic() - start, spent, os.getloadavg()[0]), flush=True)
            if code:
                return code
    return 0


if __name__ == '__main__':
    sys.exit(main())
