# SPDX-License-Identifier: Apache-2.0
"""
Entry point of the nodes; Ctrl-C during the imports (about 1 s) ends a node without a traceback.

`demo.processes` runs this module with the name of a node; users call ``ballbot run``.
"""
from importlib import import_module
from pathlib import Path
import sys


def start(name: str) -> int:
    """Run the node in the package `name` and return the exit code."""
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
