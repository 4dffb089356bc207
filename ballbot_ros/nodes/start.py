# SPDX-License-Identifier: Apache-2.0
"""
Entry points of the nodes: during their imports, about a second, Ctrl-C ends them quietly.

`demo.processes` runs this module as a program with the name of a node; a user has ``ballbot run``.
"""
from functools import partial
from importlib import import_module
import sys


def start(name: str) -> int:
    """Run a node, by the name of its package, and return the exit code."""
    try:
        module = import_module(f'ballbot_ros.nodes.{name}.node')
    except KeyboardInterrupt:
        return 0  # as after Ctrl-C later on
    code: int = module.main()
    return code


bridge, controller, emulated_robot, imu, navigator, obstacle_decision, simulator = (
    partial(start, name) for name in (
        'bridge', 'controller', 'emulated_robot', 'imu', 'navigator', 'obstacle_decision',
        'simulator'))

if __name__ == '__main__':
    sys.exit(start(sys.argv.pop(1)))
