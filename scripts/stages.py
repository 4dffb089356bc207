# SPDX-License-Identifier: Apache-2.0
"""
Stages of the set-up: each shown in one line, logged, and stamped with a hash of its inputs.

It must stay readable by old interpreters, as the rest of the set-up.
"""
import contextlib
import hashlib
from pathlib import Path
import subprocess
import sys
import time

from host import Problem

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / '.venv'
STAMPS = VENV / 'stamps'


def digest(*parts):
    """Hash strings, and files by name and content, into one short key."""
    total = hashlib.sha256()
    for part in parts:
        name = str(part.relative_to(ROOT)) if isinstance(part, Path) else part
        content = part.read_bytes() if isinstance(part, Path) else b''
        total.update(('%s\0%d\0' % (name, len(content))).encode() + content)
    return total.hexdigest()[:16]


def done(stage, key):
    """Say whether a stage has finished with these inputs before."""
    stamp = STAMPS / stage
    return stamp.exists() and stamp.read_text() == key


@contextlib.contextmanager
def stage(name, text, key):
    """Show a stage in one line with its seconds, and stamp it once its body is through."""
    label = '%-9s %s ... ' % (name, text)
    print(label, end='', flush=True)
    start = time.monotonic()
    if STAMPS.exists():
        with contextlib.suppress(FileNotFoundError):
            (STAMPS / name).unlink()
    try:
        yield lambda *command, **more: run(name, label, start, command, **more)
    except BaseException:
        print(flush=True)
        raise
    STAMPS.mkdir(exist_ok=True)
    (STAMPS / name).write_text(key)
    print('%s%.1f s' % ('\r' + label if sys.stdout.isatty() else '', time.monotonic() - start))


def run(name, label, start, command, env=None, hint=''):
    """Run a command into a log file, counting seconds on a terminal; raise Problem on failure."""
    log = VENV / 'log' / (name + '.txt')
    log.parent.mkdir(parents=True, exist_ok=True)
    with log.open('a') as out:
        out.write('$ %s\n' % ' '.join(map(str, command)))
        out.flush()
        process = subprocess.Popen([str(word) for word in command], cwd=str(ROOT), env=env,
                                   stdout=out, stderr=subprocess.STDOUT)
        try:
            while process.poll() is None:
                time.sleep(0.05)
                if sys.stdout.isatty():
                    print('\r%s%d s' % (label, time.monotonic() - start), end='', flush=True)
        except KeyboardInterrupt:
            process.wait()  # The terminal has told the child as well
            raise
    if process.returncode:
        tail = log.read_text(errors='replace').splitlines()[-25:]
        raise Problem('\n'.join(['%s failed. The end of %s:' % (name, log)]
                                + ['  ' + line for line in tail] + ([hint] if hint else [])))
