# SPDX-License-Identifier: Apache-2.0
"""
Find a suitable Python and the system tools that the set-up needs.

Run as a program, it describes its interpreter as JSON. It must run on old interpreters, because it
reports that they are too old.
"""
import importlib.util
import json
import os
import platform
import shutil
import subprocess
import sys
import sysconfig

OLDEST, NEWEST = (3, 10), (3, 13)  # For the ROS wheels; a sourced ROS 2 may use a newer Python


class Problem(Exception):
    """A problem that the user has to solve; the message names it and its solution."""


def sourced_ros():
    """Return the name of the ROS 2 distribution that is sourced in this shell, else ''."""
    return os.environ.get('ROS_DISTRO', '') if os.environ.get('AMENT_PREFIX_PATH') else ''


def describe():
    """Describe the running interpreter, as required to choose one."""
    rclpy = importlib.util.find_spec('rclpy')
    return {
        'version': list(sys.version_info[:2]),
        # In a virtual environment, its base interpreter, which outlives .venv.
        'executable': os.path.realpath(getattr(sys, '_base_executable', None) or sys.executable),
        'venv': all(importlib.util.find_spec(name) for name in ('venv', 'ensurepip')),
        'headers': os.path.exists(os.path.join(sysconfig.get_path('include'), 'Python.h')),
        'rclpy': rclpy and rclpy.origin,
    }


def describe_other(python):
    """Return the description of another interpreter, None if it does not run."""
    try:
        out = subprocess.check_output([python, os.path.abspath(__file__)],
                                      stderr=subprocess.DEVNULL)
        return json.loads(out.decode())
    except (OSError, ValueError, subprocess.CalledProcessError):
        return None


def choose_python(ros):
    """Return the description of the first suitable interpreter, starting with the running one."""
    if not ros and platform.machine() != 'x86_64':
        raise Problem(
            'ROS 2 as Python wheels exists for x86_64 only, and this is %s.\n'
            'Install ROS 2 Jazzy or later, source its setup file, then run this again: the\n'
            'set-up uses the ROS 2 that is sourced.' % platform.machine())
    names = ['python3.%d' % minor for minor in range(NEWEST[1], OLDEST[1] - 1, -1)]
    others = [shutil.which(name) for name in names] + ['/usr/bin/python3']
    for python in [None] + [path for path in others if path]:
        python = describe_other(python) if python else describe()
        if not python or tuple(python['version']) < OLDEST:
            continue
        if python['rclpy'] if ros else tuple(python['version']) <= NEWEST:
            return python
    if ros:
        raise Problem(
            'ROS 2 %s is sourced, but no Python on PATH that is 3.%d or newer can import rclpy.\n'
            'Put the Python of that ROS 2 first on PATH, or use a shell without ROS 2: the\n'
            'set-up then brings its own.' % (ros, OLDEST[1]))
    raise Problem(
        'Python 3.%d to 3.%d is needed; %s is %s, and no other was found on PATH.\n'
        'Install one, for instance\n'
        '  sudo apt-get update && sudo apt-get install python3.12 python3.12-venv python3.12-dev\n'
        'or name one: make PYTHON=/path/to/python3.12'
        % (OLDEST[1], NEWEST[1], sys.executable, sys.version.split()[0]))


def check_tools(python):
    """Raise `Problem` if system tools are missing; name all and the command to install them."""
    name = 'python%d.%d' % tuple(python['version'])
    tools = [
        (python['venv'], 'the venv module of %s' % name, name + '-venv'),
        (python['headers'], 'the C headers of %s' % name, name + '-dev'),
        (shutil.which(os.environ.get('CC', 'cc')), 'a C compiler', 'gcc'),
        (shutil.which(os.environ.get('CXX', 'c++')), 'a C++ compiler', 'g++'),
        (shutil.which('make'), 'make', 'make'),
    ]
    missing = [(tool, package) for present, tool, package in tools if not present]
    if missing:
        raise Problem(
            'Missing here: %s.\nInstall with\n  sudo apt-get update && sudo apt-get install %s'
            % (', '.join(item[0] for item in missing), ' '.join(item[1] for item in missing)))


if __name__ == '__main__':
    print(json.dumps(describe()))
