# SPDX-License-Identifier: Apache-2.0
"""
Print the durations of the parts of a first and a second `make demo`.

    python3 scripts/time_demo.py

Clones the last commit into a temporary folder and runs the demo there twice, first with an empty
kernel cache. Packages in the caches of uv and pip are not downloaded again.
"""
import os
from pathlib import Path
import subprocess
import sys
import tempfile
import time

ROOT = Path(__file__).resolve().parent.parent


def main():
    """Print the tables; return the exit code of the first part that fails, else 0."""
    with tempfile.TemporaryDirectory(prefix='ballbot_demo_') as folder:
        clone = Path(folder) / 'clone'
        subprocess.run(['git', 'clone', '--quiet', '--depth', '1', ROOT.as_uri(), str(clone)],
                       check=True)
        env = dict(os.environ, XDG_CACHE_HOME=str(Path(folder) / 'cache'))
        # Keep the downloads of uv: only the kernel cache is empty.
        env.setdefault('UV_CACHE_DIR', str(Path(os.environ.get(
            'XDG_CACHE_HOME') or Path.home() / '.cache') / 'uv'))
        env.pop('ROS_DOMAIN_ID', None)  # with it, the scenes run sequentially
        # With it, every demo compiles the modules that the set-up has not imported.
        env.pop('PYTHONDONTWRITEBYTECODE', None)
        rows = []
        for name in ('first', 'second'):
            for part, target in (('set-up', 'setup-run'), ('demo', 'demo')):
                before, start = os.times(), time.monotonic()
                code = subprocess.run(['make', target, 'PYTHON=' + sys.executable],
                                      cwd=str(clone), env=env).returncode
                if code:
                    return code
                rows.append(('%s %s' % (name, part), time.monotonic() - start,
                             sum(os.times()[2:4]) - sum(before[2:4])))
            rows.append(('%s make demo' % name, *map(sum, zip(rows[-2][1:], rows[-1][1:]))))
        print('\n%-18s %8s %8s' % ('', 'wall s', 'CPU s'))
        for row in rows:
            print('%-18s %8.1f %8.1f' % row)
        print('load of this machine %.1f on %d processors' % (os.getloadavg()[0], os.cpu_count()))
    return 0


if __name__ == '__main__':
    sys.exit(main())
