# SPDX-License-Identifier: Apache-2.0
"""Find the robots, scenes, curves and message files that come with the package."""
from pathlib import Path
import sys

from ballbot_ros.errors import ConfigurationError

PACKAGE = 'ballbot_ros'


def shipped_folder(name: str) -> Path:
    """
    Return a folder that comes with this package, ``'config'`` or ``'msg'``.

    A source checkout (and a symlink install, which points back to it) has it beside the
    package; an installed package has it in ``share/`` of its prefix.

    Raises
    ------
    ConfigurationError
        If the package was installed without it.

    """
    here = Path(__file__).resolve().parent
    candidates = [here.parent]
    # <prefix>/lib/pythonX.Y/site-packages/ballbot_ros: the prefix is three levels up.
    candidates += [up / 'share' / PACKAGE for up in here.parents[2:6]]
    candidates.append(Path(sys.prefix) / 'share' / PACKAGE)
    for candidate in candidates:
        # The manifest tells our folder from any other of that name.
        if (candidate / 'package.xml').is_file() and (candidate / name).is_dir():
            return candidate / name
    raise ConfigurationError(
        f'the folder {name}/ of ballbot_ros was not found; looked in '
        + ', '.join(str(candidate) for candidate in candidates)
        + '. Install the package again.')


def config_folder() -> Path:
    """Return the folder of robots, scenes, curves and tunings; see `shipped_folder`."""
    return shipped_folder('config')


def find_config(kind: str, name_or_path: str) -> Path:
    """
    Turn a name such as ``'gimball'``, or the path of a file, into a path.

    Parameters
    ----------
    kind : str
        Subfolder of ``config/``: ``'robots'``, ``'scenes'``, ..., ``'hardware'``.
    name_or_path : str
        Something with a ``/`` or ending in ``.yaml`` is a path, all else is a name.

    Raises
    ------
    ConfigurationError
        If there is no such file; the message lists the names that exist.

    """
    if '/' in name_or_path or name_or_path.endswith(('.yaml', '.yml')):
        path = Path(name_or_path).expanduser()
        if path.is_file():
            return path
        raise ConfigurationError(f'{kind.removesuffix("s")} file {name_or_path!r} does not exist')
    folder = config_folder() / kind
    path = folder / f'{name_or_path}.yaml'
    if path.is_file():
        return path
    known = ', '.join(sorted(file.stem for file in folder.glob('*.yaml')))
    raise ConfigurationError(
        f'there is no {kind.removesuffix("s")} named {name_or_path!r}; known are {known}. '
        'A path to a YAML file of your own is accepted too.')
