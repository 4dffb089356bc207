# SPDX-License-Identifier: Apache-2.0
"""Import of optional packages."""
from importlib import import_module
from typing import Any

from ballbot_ros.errors import ConfigurationError


def load_optional(module: str, package: str, remedy: str, user: str = 'this') -> Any:
    """
    Return a module that needs an optional package.

    Raises `ConfigurationError` with reason ``not_installed`` if it cannot be imported; the message
    names the user of the package, and the remedy, for instance the command that installs it.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise ConfigurationError(
            f'{user} needs {package}, and {error.name or error} cannot be imported; {remedy}',
            'not_installed', package) from error
