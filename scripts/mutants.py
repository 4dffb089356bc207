# SPDX-License-Identifier: Apache-2.0
"""
Run cosmic-ray on a random sample of mutations of one package, in a copy of the checkout.

    make mutants ARGS='control --count 40 --seed 2'

Kernels run uncompiled.  The session is kept in build/mutants, and the same command resumes it;
``cr-html`` and ``cosmic-ray dump`` read it.  Exits with 1 if more than --fail-over survive.
"""
import argparse
from pathlib import Path
import random
import shutil
import sqlite3
import subprocess
import sys
from time import monotonic

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ('bridge', 'control', 'decision', 'drives', 'estimation', 'imus', 'physics')
CONFIG = """\
[cosmic-ray]
module-path = ["ballbot_ros/{package}"]
timeout = {timeout:.0f}
excluded-modules = []
test-command = "{command}"

[cosmic-ray.distributor]
name = "local"
"""


def sample(session, count, seed):
    """Keep a random sample of the mutations of a session."""
    with sqlite3.connect(session) as connection:
        jobs = sorted(job for job, in connection.execute('select job_id from work_items'))
        kept = set(random.Random(seed).sample(jobs, min(count, len(jobs))))
        dropped = [(job,) for job in jobs if job not in kept]
        for table in ('mutation_specs', 'work_items'):
            connection.executemany(f'delete from {table} where job_id = ?', dropped)


def main(argv=None):
    """Make or resume a session, print each survivor and the survival rate."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('package', choices=PACKAGES)
    parser.add_argument('--count', type=int, default=40, help='mutations (default: %(default)s)')
    parser.add_argument('--seed', type=int, default=1, help='of the sample (default: %(default)s)')
    parser.add_argument('--fail-over', type=float, default=10.0, metavar='PERCENT',
                        help='largest accepted survival rate (default: %(default)s)')
    arguments = parser.parse_args(argv)
    folder = ROOT / 'build' / 'mutants' / f'{arguments.package}-{arguments.seed}'
    copy, session = folder / 'checkout', folder / 'session.sqlite'

    tests = [sys.executable, '-m', 'pytest', '-x', '-q', '-p', 'no:cacheprovider',
             f'test/unit/{arguments.package}']

    def run(*words):
        return subprocess.run(
            [str(word) for word in words], cwd=copy,
            env={'PATH': '/usr/bin:/bin', 'PYTHONPATH': str(copy), 'BALLBOT_UNCOMPILED': '1'})

    def cosmic_ray(tool, *words):
        return run(Path(sys.executable).with_name(tool), *words)
    if not session.exists():
        shutil.rmtree(folder, ignore_errors=True)
        copy.mkdir(parents=True)
        files = subprocess.run(['git', 'ls-files'], cwd=ROOT, check=True, capture_output=True,
                               text=True).stdout.splitlines()
        present = '\0'.join(name for name in files if (ROOT / name).exists())
        subprocess.run(['xargs', '-0', 'cp', '--parents', '-t', copy], cwd=ROOT, text=True,
                       input=present, check=True)
        start = monotonic()
        if run(*tests).returncode:
            shutil.rmtree(folder)
            sys.exit('the tests fail without any mutation: repair them first')
        # A mutation that takes much longer than the original code counts as detected.
        (folder / 'config.toml').write_text(CONFIG.format(
            package=arguments.package, timeout=60.0 + 3.0 * (monotonic() - start),
            command=' '.join(tests)))
        new = folder / 'new.sqlite'
        cosmic_ray('cosmic-ray', 'init', folder / 'config.toml', new).check_returncode()
        sample(new, arguments.count, arguments.seed)
        new.rename(session)
    cosmic_ray('cosmic-ray', 'exec', folder / 'config.toml', session).check_returncode()
    cosmic_ray('cr-report', '--surviving-only', '--show-diff', session)
    return cosmic_ray('cr-rate', '--fail-over', arguments.fail_over, session).returncode


if __name__ == '__main__':
    sys.exit(main())
