# SPDX-License-Identifier: Apache-2.0
"""
Entry point of the nodes: during their imports, about a second, Ctrl-C ends them quietly.

`demo.processes` runs this module as a program with the name of a node; a user has ``ballbot run``.
"""
from importlib import import_module
from pathlib import Path
import sys


def start(name: str) -> int:
    """Run a node, by the name of its package, and return the exit code."""
    try:
        module = import_module(f'ballbot_ros.nodes.{name}.node')
    except KeyboardInterrupt:
        return 0  # as after Ctrl-C later on
    code: int = module.main()
    return code


def main() -> int:
    """Run the node that the executable is named after."""
    return start(Path(sys.argv[0]).name)


if __name__ == '__main__':
    sys.exit(start(sys.argv.pop(1)))
