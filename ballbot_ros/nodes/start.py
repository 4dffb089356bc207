# SPDX-License-Identifier: Apache-2.0
"""Entry points of the nodes: during their imports, about a second, Ctrl-C ends them quietly."""
from importlib import import_module


def start(name: str) -> int:
    """Run a node, by the name of its package, and return the exit code."""
    try:
        module = import_module(f'ballbot_ros.nodes.{name}.node')
    except KeyboardInterrupt:
        return 0  # as after Ctrl-C later on
    code: int = module.main()
    return code


def bridge() -> int:
    return start('bridge')


def controller() -> int:
    return start('controller')


def emulated_robot() -> int:
    return start('emulated_robot')


def imu() -> int:
    return start('imu')


def navigator() -> int:
    return start('navigator')


def obstacle_decision() -> int:
    return start('obstacle_decision')


def simulator() -> int:
    return start('simulator')
