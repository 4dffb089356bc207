# SPDX-License-Identifier: Apache-2.0
"""
Prepare .venv so that `.venv/bin/ballbot` and `import ballbot_ros.msg` simply work.

The stages: find a Python and the system tools, make the virtual environment, install the pinned
packages, mend the include paths in the ROS wheels, build interfaces that have no wheel and the
messages with colcon. A stage that is finished leaves a stamp with a hash of its inputs; a stage
whose stamp matches is skipped, so the second run costs nothing and an interrupted one goes on
where it was.

Where a ROS 2 installation is sourced, it takes the place of the wheels and of those interfaces.

Standard library only, and readable by old interpreters: it is what tells them they are too old.
"""
import fcntl
import json
import os
from pathlib import Path
import re
import shutil
import subprocess
import sys
import time

from host import check_tools, choose_python, Problem, sourced_ros
from stages import digest, done, ROOT, stage, STAMPS, VENV

PYTHON = VENV / 'bin' / 'python'
INTERFACES = ROOT / 'interfaces'
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


def remove_built(package):
    """Remove what a build has put into .venv, so that a deleted message disappears."""
    for pattern in ('share/%s', 'include/%s', 'lib/%s', 'lib/lib%s__*',
                    'lib/python3*/site-packages/%s/'):
        for path in VENV.glob(pattern % package):
            shutil.rmtree(str(path)) if path.is_dir() else path.unlink()


def colcon(command, ros, build, *paths):
    """Build packages into .venv itself, which serves as their install prefix."""
    env = dict(os.environ, PATH='%s%s%s' % (PYTHON.parent, os.pathsep, os.environ['PATH']))
    # colcon would have make wait while other work loads the machine.
    env.setdefault('MAKEFLAGS', '-j%d' % (os.cpu_count() or 1))
    for name in ('PYTHONPATH', 'COLCON_PREFIX_PATH', 'AMENT_PREFIX_PATH', 'CMAKE_PREFIX_PATH'):
        if not ros:
            env.pop(name, None)
    for name in ('AMENT_PREFIX_PATH', 'CMAKE_PREFIX_PATH'):
        env[name] = os.pathsep.join(filter(None, [str(VENV), env.get(name)]))
    command(PYTHON, '-c', 'import sys; from colcon_core.command import main; sys.exit(main())',
            '--log-base', VENV / 'log' / 'colcon', 'build', '--paths', *paths,
            '--build-base', build, '--install-base', VENV,
            '--merge-install', '--symlink-install', '--event-handlers', 'console_direct+',
            '--cmake-args', '-DPython3_EXECUTABLE=%s' % PYTHON, '-DBUILD_TESTING=OFF', env=env)


def build_interfaces(key):
    """Build the packages of interfaces/ that no wheel has brought."""
    build = VENV / 'build-interfaces'
    lacking = []
    for path in sorted(INTERFACES.glob('*/package.xml')):
        package = path.parent.name
        if (build / package).exists():  # Made by this script before
            shutil.rmtree(str(build / package))
            remove_built(package)
        if not any(VENV.glob('lib/python3*/site-packages/%s' % package)):
            lacking.append(path.parent)
    with stage('interfaces', '%d that have no wheel, half a minute' % len(lacking),
               key) as command:
        if lacking:
            colcon(command, '', build, *lacking)
            command(PYTHON, '-c', 'import ' + ', '.join(path.name for path in lacking))


def build_messages(ros, key):
    """Build the messages of the package itself."""
    if not done('messages', key):
        shutil.rmtree(str(VENV / 'build'), ignore_errors=True)
    remove_built(PACKAGE)
    with stage('messages', 'built with colcon, up to a minute', key) as command:
        colcon(command, ros, VENV / 'build', ROOT)
        command(PYTHON, '-c', 'import rclpy, %s.msg, %s.srv, %s.action' % ((PACKAGE,) * 3))


def set_up():
    """Bring .venv up to date; return whether anything had to be done."""
    ros = sourced_ros()
    python = choose_python(ros)
    venv_key = digest(str(VENV), python['executable'], str(python['version']), ros,
                      ros and str(python['rclpy']), LOCK, LOCK.parent / 'app.in',
                      LOCK.parent / 'build.in')
    sources = [ROOT / 'package.xml', ROOT / 'setup.py', ROOT / 'setup.cfg', Path(__file__)]
    for folder in ('msg', 'srv', 'action', 'cmake_msgs'):
        sources += sorted(path for path in (ROOT / folder).iterdir() if path.is_file())
    messages_key = digest(venv_key, *sources)
    interfaces_key = digest(venv_key, Path(__file__), *sorted(
        path for path in INTERFACES.rglob('*.*') if path.is_file()))
    # Of these only the names matter: they are installed as links.
    links_key = digest(*sorted(str(path) for folder in ('config', 'launch')
                               for path in (ROOT / folder).rglob('[!._]*.*')))
    interfaces = bool(ros) or done('interfaces', interfaces_key)
    if interfaces and done('messages', messages_key) and done('links', links_key):
        return False
    check_tools(python)
    if not done('venv', venv_key):
        make_venv(python, ros, venv_key)
    if not done('packages', venv_key):
        install_packages(ros, venv_key)
    if not (ros or done('interfaces', interfaces_key)):
        build_interfaces(interfaces_key)
    if not (done('messages', messages_key) and done('links', links_key)):
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
