# SPDX-License-Identifier: Apache-2.0
"""Packages that not every installation has."""
from importlib import import_module
from typing import Any

from ballbot_ros.errors import ConfigurationError


def load_optional(module: str, package: str, remedy: str, user: str = 'this') -> Any:
    """
    Return a module that needs a package which may be missing.

    Parameters
    ----------
    module, package : str
        Their names.
    remedy : str
        For the message, for instance the command that installs the package.
    user : str, optional
        What needs the package, for the message.

    Raises
    ------
    ConfigurationError
        If the module cannot be imported; with reason ``not_installed``.

    """
    try:
        return import_module(module)
    except ImportError as error:
        raise ConfigurationError(
            f'{user} needs {package}, and {error.name or error} cannot be imported; {remedy}',
            'not_installed', package) from error
