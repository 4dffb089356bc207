# SPDX-License-Identifier: Apache-2.0
"""Find and read configuration files: shipped ones by name, others by path."""
import math
import os
from pathlib import Path
import re
import sys
from typing import Any, Mapping, Type, Union

import yaml

from ballbot_ros.config.fields import expect_mapping, suggestion, T
from ballbot_ros.errors import ConfigurationError

PACKAGE = 'ballbot_ros'


def shipped_folder(name: str) -> Path:
    """
    Return a folder of this package, ``'config'`` or ``'msg'``.

    A source checkout (and a symlink install, which points to it) has the folder next to the
    package; an installed package has it in ``share/`` of its prefix.

    Raises `ConfigurationError` if the package was installed without the folder.
    """
    here = Path(__file__).resolve().parent
    candidates = [here.parents[1]]
    # <prefix>/lib/pythonX.Y/site-packages/ballbot_ros: the prefix is three levels up.
    candidates += [up / 'share' / PACKAGE for up in here.parents[2:6]]
    candidates.append(Path(sys.prefix) / 'share' / PACKAGE)
    for candidate in candidates:
        # The manifest distinguishes this folder from others of that name.
        if (candidate / 'package.xml').is_file() and (candidate / name).is_dir():
            return candidate / name
    raise ConfigurationError(
        f'the folder {name}/ of ballbot_ros was not found; looked in '
        + ', '.join(str(candidate) for candidate in candidates)
        + '. Install the package again.', 'not_installed', name)


def shipped_files(kind: str) -> list[Path]:
    """Return the files in a subfolder of ``config/``, in the order of their names."""
    return sorted((shipped_folder('config') / kind).glob('*.yaml'))


def is_path(name_or_path: str) -> bool:
    """Return whether this is a path, with a ``/`` or the extension of a YAML file, not a name."""
    return '/' in name_or_path or name_or_path.endswith(('.yaml', '.yml'))


def located(name_or_path: str, folder: Path) -> str:
    """Return the name of a shipped file unchanged, and a path relative to a folder as a path."""
    return str(folder / Path(name_or_path).expanduser()) if is_path(name_or_path) \
        else name_or_path


def relative(name_or_path: str, folder: Path) -> str:
    """Return a relative path as seen from a folder, the inverse of `located`; others unchanged."""
    path = Path(name_or_path).expanduser()
    return os.path.relpath(path, folder) if is_path(name_or_path) and not path.is_absolute() \
        else str(path)


def find_config(kind: str, name_or_path: Union[str, Path]) -> Path:
    """
    Return the path for a name such as ``'gimball'``, or for the path of a file; see `is_path`.

    The kind is a subfolder of ``config/``: ``'robots'``, ``'scenes'``, ..., ``'hardware'``.
    Raises `ConfigurationError` if there is no such regular file; the message suggests the closest
    name, or lists all names.
    """
    subject = kind.removesuffix('s').replace('_', ' ')
    field = subject.split()[-1]  # the parameter for a decision tuning is called tuning
    if not name_or_path or not isinstance(name_or_path, (str, Path)):
        raise ConfigurationError(
            f'{subject} must be a name or the path of a file, got {name_or_path!r}', 'wrong_type',
            field)
    name_or_path = str(name_or_path)
    files = {file.stem: file for file in shipped_files(kind)}
    if name_or_path in files:
        return files[name_or_path]
    path = Path(name_or_path).expanduser()
    if path.is_dir():
        inside = sorted(path.glob('*.yaml'))
        raise ConfigurationError(
            f'the folder {path} ' + (f'is not a file; give one of its files, such as {inside[0]}'
                                     if inside else f'contains no {subject} file'),
            'wrong_kind', field)
    if is_path(name_or_path):
        check_file(path, f'{subject} file', field)
        return path
    listing = f'"ballbot {kind}" lists them, and ' if kind in ('scenes', 'robots') else ''
    raise ConfigurationError(
        f'there is no {subject} named {name_or_path!r}{suggestion(name_or_path, files)}; {listing}'
        'the path of a YAML file is also accepted', 'unknown_name', field)


def check_file(path: Path, subject: str, field: str) -> None:
    """Refuse an input file that does not exist or is not a regular file."""
    if path.is_dir():
        raise ConfigurationError(
            f'{subject}: {path} is a folder; give the path of a file', 'wrong_kind', field)
    if not path.exists():
        raise ConfigurationError(f'{subject} {str(path)!r} does not exist', 'missing', field)
    if not path.is_file():
        raise ConfigurationError(
            f'{subject}: {path} is a device or a pipe; give the path of a regular file',
            'wrong_kind', field)


def yaml_of(value: Any) -> str:
    """Return a value as YAML on one line."""
    text = yaml.safe_dump(value, default_flow_style=True, width=1000)
    return str(text).removesuffix('\n').removesuffix('\n...')


# libyaml recurses once per level, and a stack overflow ends the process.
DEEPEST_NESTING = 50
_SafeLoader: Any = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)  # libyaml reads ten times as fast


class _StrictLoader(_SafeLoader):  # type: ignore[misc]
    """Loader with the numbers of YAML 1.2 that refuses a key that is given twice."""

    # Without the numbers of YAML 1.1, which reads 1:30 as 90, 010 as 8 and 1e-4 as text.
    yaml_implicit_resolvers = {
        first: [(tag, pattern) for tag, pattern in resolvers
                if tag not in ('tag:yaml.org,2002:int', 'tag:yaml.org,2002:float')]
        for first, resolvers in _SafeLoader.yaml_implicit_resolvers.items()}

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        seen = set()
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if isinstance(key, str) and key in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f'{key!r} is given twice', key_node.start_mark)
            if isinstance(key, str):
                seen.add(key)
        return super().construct_mapping(node, deep)


def _number(loader: Any, node: Any) -> Union[int, float]:
    """Return a number; raise `ConstructorError` for one that a double cannot represent."""
    text = node.value
    try:
        if text.lstrip('+-').isdigit():
            number: Union[int, float] = int(text)
        elif text[:2] in ('0o', '0x'):
            number = int(text, 0)
        else:
            number = float(re.sub(r'\.(?=inf|nan)', '', text.lower()))
        size = abs(float(number))
    except (ValueError, OverflowError):
        size = math.inf
    if 0.0 < size < sys.float_info.min or size == math.inf and 'inf' not in text.lower():
        raise yaml.constructor.ConstructorError(
            None, None, f'the number {text[:40]} is beyond the range of double precision',
            node.start_mark)
    return number


for _kind, _pattern in (
        ('int', r'[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+'),
        ('float', r'[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?'
                  r'|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)')):
    _StrictLoader.add_implicit_resolver(
        f'tag:yaml.org,2002:{_kind}', re.compile(f'^(?:{_pattern})$'), list('-+.0123456789'))
    _StrictLoader.add_constructor(f'tag:yaml.org,2002:{_kind}', _number)


def _check_nesting(text: str) -> None:
    """Raise `YAMLError` for a text that is nested too deeply."""
    depth = 0
    for event in yaml.parse(text, Loader=_SafeLoader):
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > DEEPEST_NESTING:
            raise yaml.YAMLError(f'it is nested more than {DEEPEST_NESTING} levels deep')


def load_config(cls: Type[T], kind: str, name_or_path: Union[str, Path]) -> T:
    """
    Return the content of a YAML file, see `find_config`, as a checked dataclass.

    Raises `ConfigurationError` naming file, field, value and allowed range.
    """
    path, content = read_config(kind, name_or_path)
    return cls.from_mapping(content, str(path))


# Keys by which a file of each kind is recognised.
SIGNATURES: Mapping[str, set[str]] = {
    'robots': {'ball_mass', 'ball_radius', 'ball_inertia'},
    'scenes': {'robot', 'duration', 'terrain', 'initial', 'actuation', 'robot_changes'},
    'hardware': {'connection', 'joint', 'limits', 'drive'},
    'experiments': {'scene', 'seeds', 'simulator'},
    'floors': {'walls', 'map', 'features'},
    'curves': {'coefficients', 'actuation', 'source'}}


def read_config(kind: str, name_or_path: Union[str, Path]) -> tuple[Path, Mapping[str, Any]]:
    """
    Return path and content of a file; the path of a robot in it is relative to the file.

    Refuses as `find_config`, and a file of another kind.
    """
    path = find_config(kind, name_or_path)
    content = read_yaml(path)
    if isinstance(content.get('robot'), str):
        content = {**content, 'robot': located(content['robot'], path.parent)}
    if kind not in SIGNATURES:
        return path, content
    found = max(SIGNATURES, key=lambda other: len(SIGNATURES[other] & content.keys()))
    common = len(SIGNATURES[found] & content.keys())
    if common > len(SIGNATURES[kind] & content.keys()):
        subject, wanted = found.removesuffix('s'), kind.removesuffix('s')
        raise ConfigurationError(
            f'{path} has the keys of {subject} files, not of {wanted} files; give another file',
            'wrong_kind', wanted)
    return path, content


def read_yaml(path: Path) -> Mapping[str, Any]:
    """
    Read a YAML file that contains one mapping.

    Raises `ConfigurationError` if the file cannot be read, is not YAML, repeats a key or contains
    no mapping.
    """
    try:
        text = path.read_text(encoding='utf-8')
        _check_nesting(text)
        content = yaml.load(text, Loader=_StrictLoader)
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, 'strerror', None) or 'it is not UTF-8 text'
        raise ConfigurationError(
            f'{path}: cannot be read: {reason}', 'unreadable', str(path)) from error
    except yaml.YAMLError as error:
        reason = str(error).replace('in "<unicode string>", ', 'in ')
        raise ConfigurationError(
            f'{path}: is not valid YAML: {reason}', 'unreadable', str(path)) from error
    return expect_mapping(content, str(path))
