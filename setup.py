# SPDX-License-Identifier: Apache-2.0
"""Install the Python package and, where ROS is present, its messages (docs/packaging.md)."""
import os
from pathlib import Path
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree

from setuptools import find_packages, setup

NAME = 'ballbot_ros'
ROOT = Path(__file__).resolve().parent
MANIFEST = ElementTree.parse(ROOT / 'package.xml')
VERSION = MANIFEST.findtext('version')
MAINTAINER = MANIFEST.find('maintainer')

# The executables; a node is a folder. Each lands in lib/ballbot_ros, for `ros2 run`; those in
# ON_PATH land in bin as well, as plain commands. pip supports bin only, installs no others: a
# node may lack rclpy there, and has too common a name; `ballbot run bridge` starts it.
EXECUTABLES = {'ballbot': 'ballbot_ros.cli:main', **{
    path.parent.name: 'ballbot_ros.nodes.start:main'
    for path in sorted(ROOT.glob(f'{NAME}/nodes/*/node.py'))}}
ON_PATH = ('ballbot',)
BY_PIP = bool({'bdist_wheel', 'dist_info', 'editable_wheel'} & set(sys.argv))

# colcon also calls `develop --uninstall` and `--help`, which must build nothing.
INSTALLING = bool({'install', 'develop', 'bdist_wheel'} & set(sys.argv)) \
    and not {'--uninstall', '--help'} & set(sys.argv)


def build_directory():
    """Return the build directory that colcon names on the command line, else ./build."""
    for flag in ('--build-base', '--build-directory'):
        if flag in sys.argv:
            return Path(sys.argv[sys.argv.index(flag) + 1]).resolve()
    return Path.cwd() / 'build'


def tree(folder):
    """List the files below a folder of the source as data_files, keeping its shape."""
    files = {}
    for path in sorted((ROOT / folder).rglob('*')):
        if path.is_file() and '__pycache__' not in path.parts:
            where = Path('share', NAME, path.parent.relative_to(ROOT))
            files.setdefault(str(where), []).append(str(path.relative_to(ROOT)))
    return list(files.items())


def commands():
    """Write the executables that go into bin; pip makes them from the entry points itself."""
    if not INSTALLING or BY_PIP:
        return []
    folder = build_directory() / 'bin'
    folder.mkdir(parents=True, exist_ok=True)
    for name in ON_PATH:
        module, function = EXECUTABLES[name].split(':')
        (folder / name).write_text(
            f'#!{sys.executable}\nimport sys\n\nfrom {module} import {function}\n\n'
            f'sys.exit({function}())\n')
        (folder / name).chmod(0o755)
    return [('bin', [os.path.relpath(folder / name) for name in ON_PATH])]


def messages():
    """Build the messages and list what their CMake project installs as data_files."""
    if not INSTALLING:
        return []
    if not shutil.which('cmake') or not os.environ.get('AMENT_PREFIX_PATH'):
        print(f'{NAME}: no ROS environment, installing without messages', file=sys.stderr)
        return []
    build = build_directory() / 'messages'
    source, stage = build / 'source', build / 'stage'
    # Copied from nothing, so that a deleted message disappears; copies keep their times for make.
    for folder in (source, stage):
        shutil.rmtree(folder, ignore_errors=True)
    for folder in ('msg', 'srv', 'action'):
        shutil.copytree(ROOT / folder, source / folder)
    shutil.copy2(ROOT / 'package.xml', source)
    shutil.copy2(ROOT / 'cmake_msgs' / 'CMakeLists.txt', source)
    # A packager's DESTDIR is for what is installed in the end, which the staging folder is not.
    environment = {name: text for name, text in os.environ.items() if name != 'DESTDIR'}
    for command in (
        ['cmake', '-S', source, '-B', build, f'-DCMAKE_INSTALL_PREFIX={stage}',
         '-DBUILD_TESTING=OFF',
         f'-DPYTHON_ONLY={os.environ.get("BALLBOT_MESSAGES_PYTHON_ONLY", "OFF")}',
         f'-DPython3_EXECUTABLE={sys.executable}'],
        ['cmake', '--build', build, '--parallel', str(os.cpu_count() or 1)],
        ['cmake', '--install', build],
    ):
        subprocess.run([str(word) for word in command], check=True, env=environment)
    files = {}
    for path in sorted(stage.rglob('*')):
        where = path.relative_to(stage)
        # Left out: what this file installs itself, the generated empty __init__.py among it.
        ours = where.parts[-2:] == (NAME, '__init__.py') \
            or where == Path('share', NAME, 'package.xml') \
            or where.parts[:4] == ('share', 'ament_index', 'resource_index', 'packages')
        noise = any(part == '__pycache__' or '.egg-info' in part for part in where.parts)
        if path.is_file() and not ours and not noise:
            files.setdefault(str(where.parent), []).append(os.path.relpath(path))
    return list(files.items())


setup(
    name=NAME,
    version=VERSION,
    description='Simulator, controller and obstacle decision for a pendulum-driven ball robot',
    maintainer=MAINTAINER.text,
    maintainer_email=MAINTAINER.get('email'),
    url=MANIFEST.findtext("url[@type='repository']"),
    license='Apache-2.0',
    python_requires='>=3.10',
    install_requires=[
        'matplotlib', 'numba', 'numpy', 'pillow', 'pyserial', 'python-can', 'PyYAML', 'rich',
        'rosbags', 'scipy'],
    # colcon test runs pytest where the extra `test` asks for it.
    extras_require={
        'test': ['hypothesis', 'pytest', 'sympy'], 'sweep': ['pyarrow'],
        'cluster': ['dask[distributed]', 'pyarrow'], 'view': ['viser']},
    zip_safe=False,
    packages=find_packages(include=[NAME, f'{NAME}.*']),
    package_data={NAME: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        *tree('config'),
        *tree('launch'),
        *tree('rviz'),
        *tree('foxglove'),
        *tree('plotjuggler'),
        *commands(),
        *messages(),
    ],
    entry_points={
        'console_scripts': [f'{name} = {target}' for name, target in EXECUTABLES.items()
                            if name in ON_PATH or not BY_PIP],
    },
)
