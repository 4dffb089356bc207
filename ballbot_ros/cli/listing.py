# SPDX-License-Identifier: Apache-2.0
"""The configuration that comes with the package, by name."""
from pathlib import Path
import re
import shutil
import textwrap

from ballbot_ros.config.fields import suggestion
from ballbot_ros.config.files import is_path, shipped_files
from ballbot_ros.errors import ConfigurationError

_SENTENCE = re.compile(r'(?<=[\w)])\.\s+(?=[A-Z])')


def check_name(kind: str, name: str) -> None:
    """
    Refuse a name that does not exist, with the nearest one that does.

    A path is left to who opens the file.

    Raises
    ------
    ConfigurationError
        Naming what was asked for and what there is.

    """
    names = [path.stem for path in shipped_files(kind)]
    if is_path(name) or name in names:
        return
    what = kind[:-1]
    listing = f'"ballbot {kind}" lists them, and ' if kind in ('scenes', 'robots') else ''
    raise ConfigurationError(
        f'there is no {what} named {name!r}{suggestion(name, names)}; {listing}the path of a '
        'YAML file is accepted too')


def describe(path: Path) -> str:
    """Return the first sentence of the comment that a file begins with."""
    words = []
    for line in path.read_text(encoding='utf-8').splitlines():
        if not line.startswith('#') or not line.strip('# '):
            break
        if 'SPDX-License-Identifier' not in line:
            words.append(line.lstrip('# '))
    return _SENTENCE.split(' '.join(' '.join(words).split()))[0].rstrip('.')


def print_list(kind: str) -> None:
    """Print name and description of each file of a kind, a line each."""
    files = shipped_files(kind)
    width = max(len(path.stem) for path in files)
    # 200 where the output is no terminal and nothing says otherwise: grep wants all of it.
    left = shutil.get_terminal_size((200, 24)).columns - width - 2
    for path in files:
        text = textwrap.shorten(describe(path), max(left, 30), placeholder=' ...')
        print(f'{path.stem:<{width}}  {text}')
