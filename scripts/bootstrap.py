# SPDX-License-Identifier: Apache-2.0
"""
Prepare .venv so that `.venv/bin/ballbot` and `import ballbot_ros.msg` simply work.

The stages: find a Python and the system tools, make the virtual environment, install the pinned
packages, mend the include paths in the ROS wheels, build the messages with colcon. A stage that
is finished leaves a stamp with a hash of its inputs; a stage whose stamp matches is skipped, so
the second run costs nothing and an interrupted one goes on where it was.

Where a ROS 2 installation is sourced, it takes the place of the wheels.

Standard library only, and readable by old interpreters: it is what tells them they are too old.
"""
import contextlib
import fcntl
import hashlib
import json
import os
from pathlib import Path
import re
import shutil
import subprocess
import sys
import time

from host import check_tools, choose_python, Problem, sourced_ros

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / '.venv'
PYTHON = VENV / 'bin' / 'python'
STAMPS = VENV / 'stamps'
LOCK = ROOT / 'requirements' / 'lock.txt'
PACKAGE = 'ballbot_ros'

# The loader reads LD_LIBRARY_PATH at process start only, hence a new start. The wheels bring the
# same trick; this one is for a sourced ROS 2 installation, which knows nothing of .venv/lib.
LIBRARY_PATH_HOOK = """\
import os
import sys

library = os.path.join(sys.prefix, 'lib')
known = [path for path in os.environ.get('LD_LIBRARY_PATH', '').split(os.pathsep) if path]
if library not in known:
    os.environ['LD_LIBRARY_PATH'] = os.pathsep.join([library, *known])
    os.execv(sys.executable, sys.orig_argv)
"""


# --- Running and remembering ----------------------------------------------------------------

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


# --- The stages -----------------------------------------------------------------------------

def make_venv(python, ros, key):
    """Make an empty virtual environment, in place of whatever this script made before."""
    old = ROOT / '.venv-old'
    if VENV.exists():
        if not (VENV / 'made-by-bootstrap').exists():
            raise Problem('%s was not made by this script. Move it away, then run again.' % VENV)
        VENV.rename(old)  # At once, so that an interruption leaves no half of it behind
    shutil.rmtree(str(old), ignore_errors=True)
    VENV.mkdir()
    (VENV / 'made-by-bootstrap').touch()
    with stage('venv', 'Python %d.%d, %s' % (*python['version'], ros or 'ROS 2 from wheels'),
               key) as command:
        command(python['executable'], '-m', 'venv',
                *(['--system-site-packages'] if ros else []), VENV)
    site = site_packages()
    # The checkout itself comes first, so that an edit takes effect without a build. The build
    # folder holds the metadata by which the executables in lib/ballbot_ros find their modules.
    (site / (PACKAGE + '.pth')).write_text('%s\n%s\n' % (ROOT, VENV / 'build' / PACKAGE))
    if ros:
        (site / '_ballbot_ros_library_path.py').write_text(LIBRARY_PATH_HOOK)
        (site / '_ballbot_ros_library_path.pth').write_text('import _ballbot_ros_library_path\n')


def site_packages():
    """Return the directory of the packages in .venv."""
    return next(VENV.glob('lib/python3*/site-packages'))


def missing_packages():
    """Return what a sourced ROS 2 lacks, and pins that leave alone what it has."""
    # Reversed, because of two versions the first on the path is the one that is imported.
    installed = json.loads(subprocess.check_output([str(PYTHON), '-c', (
        'import importlib.metadata as m, json, re\n'
        'print(json.dumps({re.sub("[-_.]+", "-", d.metadata["Name"]).lower(): d.version'
        ' for d in reversed(list(m.distributions())) if d.metadata["Name"]}))')]).decode())

    def name(line):
        return re.sub('[-_.]+', '-', re.match(r'[\w.-]+', line).group()).lower()

    if shutil.which('cmake'):
        installed.setdefault('cmake', '')
    wanted = [line for file in ('app.in', 'build.in')
              for line in (LOCK.parent / file).read_text().splitlines() if line[:1].isalnum()]
    pins = [line for line in LOCK.read_text().splitlines()
            if line[:1].isalnum() and name(line) not in installed]
    pins += ['%s==%s' % item for item in installed.items() if item[1]]
    return [line for line in wanted if name(line) not in installed], pins


def install_packages(ros, key):
    """Install everything pinned, or only what the sourced ROS 2 lacks."""
    # pip writes INSTALLER last: without it an interruption has left the package half installed,
    # and pip would take it for complete.
    for info in site_packages().glob('*.dist-info'):
        if not (info / 'INSTALLER').exists():
            shutil.rmtree(str(info))
    hint = 'If this was the network, run again: what is installed is kept.'
    pip = [PYTHON, '-m', 'pip', '--disable-pip-version-check', 'install', '--no-input']
    if ros:
        lacking, pins = missing_packages()
        if lacking:
            (VENV / 'pins.txt').write_text('\n'.join(pins) + '\n')
            with stage('packages', '%d that ROS 2 lacks' % len(lacking), key) as command:
                command(*pip, '-c', VENV / 'pins.txt', *lacking, hint=hint)
        return
    lines = [line for line in LOCK.read_text().splitlines() if line[:1].isalnum()]
    tools = [line for line in lines if line.startswith(('packaging==', 'setuptools==', 'wheel=='))]
    with stage('packages', '%d pinned, a minute or so' % len(lines), key) as command:
        # Isolated, the one source package among them (empy) would fetch tools without a pin.
        command(*pip, '--no-deps', *tools, hint=hint)
        # pip would compile the modules one after the other, this does it on all processors.
        command(*pip, '--no-deps', '--no-build-isolation', '--no-compile', '-r', LOCK, hint=hint)
        command(PYTHON, '-c', 'import compileall, sys; '
                'compileall.compile_dir(sys.argv[1], quiet=2, workers=0)', site_packages())
        mend_include_paths()


def mend_include_paths():
    """Point the wheels' CMake files to this Python, not to that of the machine that built them."""
    python, numpy = subprocess.check_output([str(PYTHON), '-c', (
        'import numpy, sysconfig; print(sysconfig.get_path("include")); '
        'print(numpy.get_include())')]).decode().split('\n')[:2]
    for path in (VENV / 'share').rglob('*.cmake'):
        old = path.read_text()
        new = re.sub(r'/opt/[^;"\s]*/numpy/(?:_core|core)/include', lambda _: numpy, old)
        new = re.sub(r'/opt/(?:python|_internal)/[^;"\s]*/include/python3\.\d+', lambda _: python,
                     new)
        if new != old:
            path.write_text(new)


def build_messages(ros, key):
    """Build the package with colcon into .venv itself, which serves as its install prefix."""
    if not done('messages', key):
        shutil.rmtree(str(VENV / 'build'), ignore_errors=True)
    for pattern in ('share/%s', 'include/%s', 'lib/%s', 'lib/lib%s__*',
                    'lib/python3*/site-packages/%s/'):
        for path in VENV.glob(pattern % PACKAGE):  # So that a deleted message disappears
            shutil.rmtree(str(path)) if path.is_dir() else path.unlink()
    env = dict(os.environ, PATH='%s%s%s' % (PYTHON.parent, os.pathsep, os.environ['PATH']))
    for name in ('PYTHONPATH', 'COLCON_PREFIX_PATH', 'AMENT_PREFIX_PATH', 'CMAKE_PREFIX_PATH'):
        if not ros:
            env.pop(name, None)
    for name in ('AMENT_PREFIX_PATH', 'CMAKE_PREFIX_PATH'):
        env[name] = os.pathsep.join(filter(None, [str(VENV), env.get(name)]))
    with stage('messages', 'built with colcon, up to a minute', key) as command:
        command(PYTHON, '-c', 'import sys; from colcon_core.command import main; sys.exit(main())',
                '--log-base', VENV / 'log' / 'colcon', 'build', '--paths', ROOT,
                '--build-base', VENV / 'build', '--install-base', VENV,
                '--merge-install', '--symlink-install', '--event-handlers', 'console_direct+',
                env=env)
        command(PYTHON, '-c', 'import rclpy, %s.msg, %s.srv' % (PACKAGE, PACKAGE))


def set_up():
    """Bring .venv up to date; return whether anything had to be done."""
    ros = sourced_ros()
    python = choose_python(ros)
    venv_key = digest(str(VENV), python['executable'], str(python['version']), ros,
                      ros and str(python['rclpy']), LOCK, LOCK.parent / 'app.in',
                      LOCK.parent / 'build.in')
    sources = [ROOT / 'package.xml', ROOT / 'setup.py', ROOT / 'setup.cfg', Path(__file__)]
    for folder in ('msg', 'srv', 'cmake_msgs'):
        sources += sorted(path for path in (ROOT / folder).iterdir() if path.is_file())
    messages_key = digest(venv_key, *sources)
    # Of these only the names matter: they are installed as links.
    links_key = digest(*sorted(str(path) for folder in ('config', 'launch')
                               for path in (ROOT / folder).rglob('[!._]*.*')))
    if done('messages', messages_key) and done('links', links_key):
        return False
    check_tools(python)
    if not done('venv', venv_key):
        make_venv(python, ros, venv_key)
    if not done('packages', venv_key):
        install_packages(ros, venv_key)
    build_messages(ros, messages_key)
    (STAMPS / 'links').write_text(links_key)
    return True


def main():
    """Set up, one process at a time."""
    start = time.monotonic()
    try:
        with open(__file__) as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                print('waiting for another set-up of this checkout', flush=True)
                fcntl.flock(lock, fcntl.LOCK_EX)
            if set_up():
                print('ready in %.0f s' % (time.monotonic() - start))
    except Problem as problem:
        print(problem, file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print('interrupted; run the same again to go on', file=sys.stderr)
        return 130
    return 0


if __name__ == '__main__':
    sys.exit(main())
