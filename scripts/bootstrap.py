# SPDX-License-Identifier: Apache-2.0
"""
Prepare .venv so that `.venv/bin/ballbot` and `import ballbot_ros.msg` work.

    python3 scripts/bootstrap.py [run|test|bench|fuzz|mutants]

`run` installs the requirements of demo and nodes; `test` (the default) adds those of tests,
documentation and optional features; the other groups add their own packages to `test`.

The stages: find a Python and the system tools, make the virtual environment, install the pinned
packages, adapt the ROS wheels to this machine, and build the messages with colcon while the
kernels of the nodes compile, or while the packages of the tests are installed. A finished stage
writes a stamp with a hash of its inputs, and a stage with a matching stamp is skipped: an
interrupted run resumes.

A sourced ROS 2 installation replaces the wheels and interfaces/. With
BALLBOT_DISTRO=kilted the wheels are those of Kilted, in .venv-kilted.

It uses the standard library only and runs on old interpreters, which it refuses with a message.
"""
import ast
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
from stages import digest, DISTRO, ROOT, run_together, Stage, table, VENV

PYTHON = VENV / 'bin' / 'python'
INTERFACES = ROOT / 'interfaces'
LOCKS = ROOT / 'requirements'
PACKAGE = 'ballbot_ros'
GROUPS = ('run', 'test', 'bench', 'fuzz', 'mutants')
UV = 'uv==0.13.9'
PIP = [PYTHON, '-m', 'pip', '--disable-pip-version-check', 'install', '--no-input']
# The loader reads LD_LIBRARY_PATH only when a process starts, so Python is executed again. The
# wheels do the same; this hook serves a sourced ROS 2 installation, whose path lacks .venv/lib.
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

def make_venv(python, ros):
    """Return the work that replaces the .venv of this script by an empty one."""
    def work(stage):
        old = VENV.with_name(VENV.name + '-old')
        if VENV.exists():
            if not (VENV / 'made-by-bootstrap').exists():
                raise Problem(
                    '%s was not made by this script. Move it away, then run again.' % VENV)
            VENV.rename(old)  # Atomic, so that an interruption leaves no partial .venv
        shutil.rmtree(str(old), ignore_errors=True)
        VENV.mkdir()
        (VENV / 'made-by-bootstrap').touch()
        stage.command(python['executable'], '-m', 'venv',
                      *(['--system-site-packages'] if ros else []), VENV)
        site = site_packages()
        # The checkout precedes the build folder, so that an edit takes effect without a build. The
        # build folder contains the metadata that the executables in lib/ballbot_ros need.
        (site / (PACKAGE + '.pth')).write_text('%s\n%s\n' % (ROOT, VENV / 'build' / PACKAGE))
        if ros:
            (site / '_ballbot_ros_library_path.py').write_text(LIBRARY_PATH_HOOK)
            (site / '_ballbot_ros_library_path.pth').write_text(
                'import _ballbot_ros_library_path\n')
    return work


def site_packages():
    """Return the directory of the packages in .venv."""
    return next(VENV.glob('lib/python3*/site-packages'))


def missing_packages(names):
    """Return the packages of .in files that a sourced ROS 2 lacks, and pins of all packages."""
    # Reversed: of two versions, Python imports the first on the path.
    installed = json.loads(subprocess.check_output([str(PYTHON), '-c', (
        'import importlib.metadata as m, json, re\n'
        'print(json.dumps({re.sub("[-_.]+", "-", d.metadata["Name"]).lower(): d.version'
        ' for d in reversed(list(m.distributions())) if d.metadata["Name"]}))')]).decode())

    def name(line):
        return re.sub('[-_.]+', '-', re.match(r'[\w.-]+', line).group()).lower()

    if shutil.which('cmake'):
        installed.setdefault('cmake', '')
    wanted = [line for file in names
              for line in (LOCKS / file).read_text().splitlines() if line[:1].isalnum()]
    pins = [line for file in ('run.txt', 'test.txt')
            for line in (LOCKS / file).read_text().splitlines()
            if line[:1].isalnum() and name(line) not in installed]
    pins += ['%s==%s' % item for item in installed.items() if item[1]]
    return [line for line in wanted if name(line) not in installed], pins


def install_pinned(stage, lock, *options):
    """Install the pinned packages of a lock file."""
    lines = [line for line in lock.read_text().splitlines() if line[:1].isalnum()]
    tools = [line for line in lines if line.startswith(('packaging==', 'setuptools==', 'wheel=='))]
    # With build isolation, a source package (empy) would fetch unpinned tools.
    steps = [['--no-deps', *tools]] if tools else []
    install(stage, steps + [['--no-deps', '--no-build-isolation', *options, '-r', lock]])


def install(stage, steps):
    """
    Run installations given by their options, with uv if available, otherwise with pip.

    uv takes a fifth of the time of pip. It does not read the settings of pip, so the package
    indexes are passed on the command line.
    """
    uv = shutil.which('uv') or shutil.which(str(VENV / 'bin' / 'uv'))
    if not uv and stage.command(*PIP, '--no-deps', '--only-binary', ':all:', UV, check=False):
        uv = VENV / 'bin' / 'uv'
    if uv:
        settings = pip_settings()
        env = dict(os.environ)
        if 'cert' in settings:
            env.setdefault('SSL_CERT_FILE', settings['cert'])
        indexes = ['--index-strategy', 'unsafe-best-match']
        for name in ('index-url', 'extra-index-url', 'find-links'):
            for value in settings.get(name, '').split():
                indexes += ['--' + name, value]
        if all(stage.command(uv, 'pip', 'install', '--python', PYTHON, *indexes, *step, env=env,
                             check=False) for step in steps):
            return
    for step in steps:
        stage.command(*PIP, '--no-compile', *step,
                      hint='If this was the network, run again: installed packages are kept.')


def pip_settings():
    """Return the settings of pip by name."""
    lines = subprocess.check_output([str(PYTHON), '-m', 'pip', 'config', 'list']).decode()
    found = {}
    # The environment overrides the section of the command, which overrides the global section.
    for key, value in sorted((line.partition('=')[::2] for line in lines.splitlines()),
                             key=lambda item: (item[0].startswith(':env:'), item[0])):
        section, _, name = key.rpartition('.')
        if section in ('global', 'install', ':env:'):
            found[name] = ast.literal_eval(value)
    return found


def run_lock():
    """Return the file that pins the run group, with the ROS packages of the distribution."""
    lock = LOCKS / 'run.txt'
    if DISTRO == 'jazzy':
        return lock
    own = LOCKS / (DISTRO + '.txt')
    if not own.exists():
        raise Problem('BALLBOT_DISTRO must be jazzy or kilted, got %r' % DISTRO)
    lines = [line for line in lock.read_text().splitlines() if not line.startswith('ros-')]
    merged = VENV / own.name
    merged.write_text('\n'.join(lines + own.read_text().splitlines()) + '\n')
    return merged


def install_run_packages(ros):
    """Return the work that installs the run group, or only those missing in the sourced ROS 2."""
    def work(stage):
        remove_half_installed()
        if not ros:
            install_pinned(stage, run_lock())
            correct_include_paths()
            accelerate_parser()
            return
        install_missing(stage, 'run.in', 'build.in')
    return work


def install_test_packages(ros):
    """Return the work that installs the test group beyond the run group."""
    def work(stage):
        remove_half_installed()
        if ros:
            install_missing(stage, 'test.in')
        else:
            install_pinned(stage, LOCKS / 'test.txt')
    return work


def install_docs_packages(stage):
    """Install the packages that build the site into .venv/docs, separate from those of .venv."""
    install_pinned(stage, LOCKS / 'docs.txt', '--target', VENV / 'docs')


def install_missing(stage, *names):
    """Install packages that a sourced ROS 2 lacks; pins keep its own packages unchanged."""
    lacking, pins = missing_packages(names)
    if lacking:
        constraints = VENV / ('pins_%s.txt' % stage.name)
        constraints.write_text('\n'.join(pins) + '\n')
        stage.command(*PIP, '-c', constraints, *lacking,
                      hint='If this was the network, run again: installed packages are kept.')


def remove_half_installed():
    """Remove the partial packages of an interrupted pip, which writes INSTALLER last."""
    for info in site_packages().glob('*.dist-info'):
        if not (info / 'INSTALLER').exists():
            shutil.rmtree(str(info))


def rewrite(path, text):
    """Replace a file, which may be a hard link into the cache of uv."""
    path.unlink()
    path.write_text(text)


def correct_include_paths():
    """Replace the Python of the build machine in the wheels' CMake files by this Python."""
    python, numpy = subprocess.check_output([str(PYTHON), '-c', (
        'import numpy, sysconfig; print(sysconfig.get_path("include")); '
        'print(numpy.get_include())')]).decode().split('\n')[:2]
    for path in (VENV / 'share').rglob('*.cmake'):
        old = path.read_text()
        new = re.sub(r'/opt/[^;"\s]*/numpy/(?:_core|core)/include', lambda _: numpy, old)
        new = re.sub(r'/opt/(?:python|_internal)/[^;"\s]*/include/python3\.\d+', lambda _: python,
                     new)
        if new != old:
            rewrite(path, new)


# Changes that make the grammar of interfaces LALR(1): each integer literal is a single token.
# Its trees are the same (test/test_bootstrap.py), see https://github.com/ros2/rosidl/pull/986.
LALR_GRAMMAR = [
    ('decimal_literal: DIGIT\n  | "1".."9" DIGIT+', 'decimal_literal: /0|[1-9][0-9]*/'),
    ('octal_literal: "0" "0".."7"+', 'octal_literal: /0[0-7]+/'),
    ('DECIMAL "d"i\n  | INT "d"i', 'DECIMAL "d"i')]
EARLEY, LALR = 'maybe_placeholders=False)', "maybe_placeholders=False, parser='lalr')"


def accelerate_parser():
    """
    Change the parser of interfaces from Earley to LALR(1).

    Six generators parse each interface, which takes half of the time of the build. Another
    version of the parser is left as it is.
    """
    folder = site_packages() / 'rosidl_parser'
    grammar, parser = ((folder / name).read_text() for name in ('grammar.lark', 'parser.py'))
    if EARLEY in parser and all(old in grammar for old, _ in LALR_GRAMMAR):
        for old, new in LALR_GRAMMAR:
            grammar = grammar.replace(old, new)
        rewrite(folder / 'grammar.lark', grammar)
        rewrite(folder / 'parser.py', parser.replace(EARLEY, LALR))


def remove_built(package):
    """Remove the files of an earlier build from .venv, so that a deleted message disappears."""
    for pattern in ('share/%s', 'include/%s', 'lib/%s', 'lib/lib%s__*',
                    'lib/python3*/site-packages/%s/'):
        for path in VENV.glob(pattern % package):
            shutil.rmtree(str(path)) if path.is_dir() else path.unlink()


def colcon(stage, ros, build, *paths):
    """Build packages into .venv itself, which serves as their install prefix."""
    # If this file is missing, colcon writes it in place, where a second build may read it half
    # written: two builds run at the same time.
    layout = VENV / '.colcon_install_layout'
    if not layout.exists():
        complete = VENV / ('layout_' + stage.name)
        complete.write_text('merged\n')
        complete.replace(layout)
    env = dict(os.environ, PATH='%s%s%s' % (PYTHON.parent, os.pathsep, os.environ['PATH']),
               BALLBOT_MESSAGES_PYTHON_ONLY='ON')
    # Without a number of jobs, colcon limits make according to the load of the machine.
    env.setdefault('MAKEFLAGS', '-j%d' % (os.cpu_count() or 1))
    for name in ('PYTHONPATH', 'COLCON_PREFIX_PATH', 'AMENT_PREFIX_PATH', 'CMAKE_PREFIX_PATH'):
        if not ros:
            env.pop(name, None)
    for name in ('AMENT_PREFIX_PATH', 'CMAKE_PREFIX_PATH'):
        env[name] = os.pathsep.join(filter(None, [str(VENV), env.get(name)]))
    stage.command(
        PYTHON, '-c', 'import sys; from colcon_core.command import main; sys.exit(main())',
        '--log-base', VENV / 'log' / ('colcon_' + stage.name), 'build', '--paths', *paths,
        '--build-base', build, '--install-base', VENV,
        '--merge-install', '--symlink-install', '--event-handlers', 'console_direct+',
        '--cmake-args', '-DPython3_EXECUTABLE=%s' % PYTHON, '-DBUILD_TESTING=OFF', env=env)


def build_interface(package):
    """Return the work that builds a package of interfaces/, unless a wheel contains it."""
    def work(stage):
        build = VENV / ('build_' + package)
        if build.exists():  # Built by an earlier run
            shutil.rmtree(str(build))
            remove_built(package)
        if not any(VENV.glob('lib/python3*/site-packages/%s' % package)):
            colcon(stage, '', build, INTERFACES / package)
            stage.command(PYTHON, '-c', 'import ' + package)
    return work


def build_messages(ros):
    """Return the work that builds the messages of the package itself, and those of /tf."""
    def work(stage):
        built = [PACKAGE]
        paths = [ROOT]
        tf = 'tf2_msgs'
        if (VENV / 'build' / tf).exists():  # Built by an earlier run
            built.append(tf)
        shutil.rmtree(str(VENV / 'build'), ignore_errors=True)
        for package in built:
            remove_built(package)
        if not ros and not any(VENV.glob('lib/python3*/site-packages/%s' % tf)):
            paths.append(INTERFACES / tf)
        colcon(stage, ros, VENV / 'build', *paths)
        stage.command(PYTHON, '-c', 'import rclpy, %s.msg, %s.srv, %s.action' % ((PACKAGE,) * 3))
    return work


def compile_kernels(nodes):
    """Return the work that compiles the kernels of some nodes of the demo."""
    def work(stage):
        stage.command(PYTHON, '-m', 'ballbot_ros.demo.prepare', *nodes)
    return work


def files(folder, pattern='*.*'):
    """Return the files below a folder, in order."""
    return sorted(path for path in (ROOT / folder).rglob(pattern) if path.is_file())


def set_up(group):
    """Bring .venv up to date for a group; return the stages that ran."""
    ros = sourced_ros()
    python = choose_python(ros)
    this = [Path(__file__), Path(__file__).with_name('stages.py')]
    venv = digest(str(VENV), python['executable'], str(python['version']), ros,
                  ros and str(python['rclpy']))
    pins = digest(venv, *[LOCKS / name for name in ('run.txt', 'run.in', 'build.in')],
                  *LOCKS.glob(DISTRO + '.txt'))

    def key(*sources):
        return digest(pins, *this, *sources)
    messages = [ROOT / name for name in ('package.xml', 'setup.py', 'setup.cfg')]
    for folder in ('msg', 'srv', 'action', 'cmake_msgs', 'interfaces/tf2_msgs'):
        messages += files(folder)
    # Only the names of these matter: they are installed as links.
    links = [str(path) for folder in ('config', 'launch') for path in files(folder, '[!._]*.*')]
    cache = os.environ.get('XDG_CACHE_HOME', '')
    sources = files(PACKAGE, '*.py')
    steps = [
        [Stage('venv', 'Python %d.%d, %s' % (
            python['version'][0], python['version'][1], ros or 'ROS 2 from wheels'),
            venv, make_venv(python, ros))],
        [Stage('packages', 'pinned ones that the nodes import', pins, install_run_packages(ros))],
        [Stage('messages', 'of this package, built with colcon', key(*(messages + links)),
               build_messages(ros))]]
    if group == 'run':  # The tests compile their kernels; a process uses one core
        steps[2] += [
            Stage('kernels', 'of the decision, compiled for this processor', key(cache, *sources),
                  compile_kernels(['decision'])),
            Stage('kernels_2', 'of simulator and controller, likewise', key(cache, *sources),
                  compile_kernels(['simulator', 'controller']))]
    else:
        steps[2] += [
            Stage('tests', 'packages that only the tests import',
                  digest(pins, LOCKS / 'test.txt', LOCKS / 'test.in'), install_test_packages(ros)),
            Stage('docs', 'Sphinx and its theme', digest(pins, LOCKS / 'docs.txt'),
                  install_docs_packages)]
        if not ros:
            name = 'simulation_interfaces'
            steps[2] += [Stage('interfaces', name + ', built with colcon',
                               key(*files(INTERFACES / name)), build_interface(name))]
    if group in ('bench', 'fuzz', 'mutants'):
        lock = LOCKS / (group + '.txt')
        steps += [[Stage(group, 'packages for make ' + group, digest(pins, lock),
                         lambda stage: install(stage, [[
                             '-r', lock, '-c', LOCKS / 'run.txt', '-c', LOCKS / 'test.txt']]))]]
    if not all(stage.done for step in steps for stage in step):
        check_tools(python)
    return [stage for step in steps for stage in run_together(*step)]


def main(group):
    """Set up for a group, one process at a time."""
    start = time.monotonic()
    try:
        with open(__file__) as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                print('waiting for another set-up of this checkout', flush=True)
                fcntl.flock(lock, fcntl.LOCK_EX)
            ran = set_up(group)
            if ran:
                print(table(ran, time.monotonic() - start))
    except Problem as problem:
        print(problem, file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print('interrupted; run the same command again to continue', file=sys.stderr)
        return 130
    return 0


if __name__ == '__main__':
    if sys.argv[1:] not in [[]] + [[name] for name in GROUPS]:
        sys.exit('usage: bootstrap.py [%s]' % '|'.join(GROUPS))
    sys.exit(main((sys.argv[1:] or ['test'])[0]))
