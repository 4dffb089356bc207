# SPDX-License-Identifier: Apache-2.0
"""
Stages of the set-up: logged, timed, and stamped with a hash of their inputs.

This file must run on old interpreters, like the rest of the set-up.
"""
import argparse
import hashlib
import os
from pathlib import Path
import resource
import subprocess
import sys
import threading
import time

from host import Problem

ROOT = Path(__file__).resolve().parent.parent
DISTRO = os.environ.get('BALLBOT_DISTRO', 'jazzy')  # ROS distribution of the wheels
VENV = ROOT / ('.venv' if DISTRO == 'jazzy' else '.venv-' + DISTRO)
STAMPS = VENV / 'stamps'
INTERRUPTED = threading.Event()


def digest(*parts):
    """Hash strings, and files by name and content, into one short key."""
    total = hashlib.sha256()
    for part in parts:
        name = str(part.relative_to(ROOT)) if isinstance(part, Path) else part
        content = part.read_bytes() if isinstance(part, Path) else b''
        total.update(('%s\0%d\0' % (name, len(content))).encode() + content)
    return total.hexdigest()[:16]


def path_argument(name, default=None):
    """Return the path argument of a script; the help text is the docstring of the script."""
    parser = argparse.ArgumentParser(description=sys.modules['__main__'].__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(name, nargs='?' if default else None, type=Path, default=default)
    return getattr(parser.parse_args(), name)


class Stage:
    """A part of the set-up; a stamp with the hash of its inputs marks it as finished."""

    def __init__(self, name, text, key, work):
        """Store the function `work`, which receives the stage in order to run commands."""
        self.name, self.text, self.key, self._work = name, text, key, work
        self.seconds = self.processor_seconds = 0.0
        self.problem = None

    @property
    def done(self):
        """Return whether the stage has already finished with these inputs."""
        stamp = STAMPS / self.name
        return stamp.exists() and stamp.read_text() == self.key

    def run(self):
        """Do the work and write the stamp; a failure is stored in `problem`."""
        start = time.monotonic()
        stamp = STAMPS / self.name
        if stamp.exists():
            stamp.unlink()
        try:
            self._work(self)
        except Problem as problem:
            self.problem = problem
        self.seconds = time.monotonic() - start
        if not self.problem:
            STAMPS.mkdir(exist_ok=True)
            stamp.write_text(self.key)

    def command(self, *words, **options):
        """
        Run a command with its output in the log file of the stage; return whether it succeeded.

        Raises Problem if it fails, with the end of the log and the option `hint`, unless `check`
        is False. `env` is the environment.
        """
        if INTERRUPTED.is_set():
            raise Problem('interrupted')
        env = dict(options.get('env') or os.environ)
        # Otherwise each start of a node would compile the packages of .venv again.
        env.pop('PYTHONDONTWRITEBYTECODE', None)
        log = VENV / 'log' / (self.name + '.txt')
        log.parent.mkdir(parents=True, exist_ok=True)
        with log.open('a') as out:
            out.write('$ %s\n' % ' '.join(map(str, words)))
            out.flush()
            process = subprocess.Popen([str(word) for word in words], cwd=str(ROOT),
                                       env=env, stdout=out, stderr=subprocess.STDOUT)
            _, status, usage = os.wait4(process.pid, 0)
        process.returncode = status  # so that Popen does not wait for it again
        self.processor_seconds += usage.ru_utime + usage.ru_stime
        if status and options.get('check', True):
            tail = log.read_text(errors='replace').splitlines()[-25:]
            raise Problem('\n'.join(
                ['%s failed. The end of %s:' % (self.name, log)] + ['  ' + line for line in tail]
                + ([options['hint']] if 'hint' in options else [])))
        return not status


def run_together(*stages):
    """Run the unfinished stages in parallel; return them, or raise a Problem."""
    stages = [stage for stage in stages if not stage.done]
    threads = [threading.Thread(target=stage.run) for stage in stages]
    start = time.monotonic()
    for stage, thread in zip(stages, threads):
        print('%-10s %s' % (stage.name, stage.text), flush=True)
        thread.start()
    try:
        for thread in threads:
            while thread.is_alive():
                thread.join(0.2)
                if sys.stdout.isatty():
                    print('\r%d s ' % (time.monotonic() - start), end='', flush=True)
    except KeyboardInterrupt:
        INTERRUPTED.set()
        raise
    finally:
        if sys.stdout.isatty():
            print('\r\033[K', end='')
    for stage in stages:
        if stage.problem:
            raise stage.problem
    return stages


def table(stages, seconds):
    """Return a table of the seconds of the stages."""
    own = resource.getrusage(resource.RUSAGE_SELF)
    lines = ['%-12s %8s %8s' % ('set-up', 'wall s', 'CPU s')]
    lines += ['%-12s %8.1f %8.1f' % (stage.name, stage.seconds, stage.processor_seconds)
              for stage in stages]
    lines.append('%-12s %8.1f %8.1f' % ('together', seconds, own.ru_utime + own.ru_stime + sum(
        stage.processor_seconds for stage in stages)))
    return '\n'.join(lines)
