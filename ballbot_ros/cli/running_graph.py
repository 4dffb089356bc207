# SPDX-License-Identifier: Apache-2.0
"""What the verbs for a running graph share: ROS, which is imported only for them."""
from importlib import import_module
import sys
from typing import Any, Callable

from ballbot_ros.errors import ConfigurationError


def tool(name: str) -> Any:
    """
    Return a module of `ros.tools`.

    Raises
    ------
    ConfigurationError
        Where ROS cannot be imported, with the remedy.

    """
    return from_ros(f'ballbot_ros.ros.tools.{name}')


def from_ros(module: str) -> Any:
    """Return a module that needs ROS; raises as `tool` does."""
    try:
        return import_module(module)
    except ImportError as error:
        raise ConfigurationError(
            f'this needs ROS 2, and {error.name or error} cannot be imported; source '
            '/opt/ros/jazzy/setup.bash and the workspace, or run "make setup" in a checkout and '
            'use .venv/bin/ballbot') from error


def once(sentence: str) -> Callable[[], None]:
    """Return a function that says a sentence on standard error the first time."""
    said = []

    def say() -> None:
        if not said:
            said.append(sentence)
            tell(sentence)
    return say


def tell(sentence: str) -> None:
    """Say something that is no result."""
    print(sentence, file=sys.stderr, flush=True)
