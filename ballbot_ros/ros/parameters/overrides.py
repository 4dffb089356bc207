# SPDX-License-Identifier: Apache-2.0
"""
Parameter overrides from command line and files: unknown names are refused or reported.

An unknown name given to this node is an error.  In a section for many nodes (``/**:``) it may be
meant for another node.  rclpy merges all sections, so the section of a name is looked up in the
files themselves.
"""
from pathlib import Path
import sys
from typing import Any, Iterable, Iterator, List, Mapping, Sequence, Set, Tuple

from rclpy.node import Node
import yaml

from ballbot_ros.config.fields import suggestion
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.ros.rclpy_compat import parameter_overrides

# Parameters that rclpy itself declares.  Those named qos_overrides are not among them: no
# publisher or subscriber here asks for them, so they would have no effect.
BUILT_IN = ('use_sim_time', 'start_type_description_service')


def refuse_unknown_overrides(node: Node, known: Iterable[str]) -> None:
    """
    Raise `ConfigurationError` for a name given to this node that is none of its parameters.

    One that only a section for many nodes gives is left to those, with a warning.
    """
    names = sorted({*known, *BUILT_IN})
    unknown = [name for name in parameter_overrides(node) if name not in names]
    if not unknown:
        return
    for_many, for_one = _given(sys.argv, node.get_fully_qualified_name())
    ignored = []
    for name in unknown:
        if name in for_one or name not in for_many:
            raise ConfigurationError(
                f'{name!r} is not a parameter of node {node.get_name()}'
                + suggestion(name, names), 'unknown_name', name)
        ignored.append(f'{name!r}{suggestion(name, names, listing=False)}')
    node.get_logger().warning(
        f'not parameters of node {node.get_name()}, and ignored, as a section for many nodes '
        f'gives them: {", ".join(ignored)}')


def _given(arguments: Sequence[str], node: str) -> Tuple[Set[str], Set[str]]:
    """Return the names that arguments and their files give to many nodes, and to this one."""
    for_many: Set[str] = set()
    for_one: Set[str] = set()
    for option, value in _options(arguments):
        if option == '--params-file':
            for section, names in _sections(value):
                if '*' in section:
                    for_many |= names
                elif section == node:
                    for_one |= names
        else:  # -p [NODE:]NAME:=VALUE
            target, colon, name = value.partition(':=')[0].rpartition(':')
            (for_many if '*' in target else for_one).add(name)
    return for_many, for_one


def _options(arguments: Sequence[str]) -> Iterator[Tuple[str, str]]:
    """Yield the options that give parameters, with what follows them."""
    inside = False
    for one, following in zip(arguments, [*arguments[1:], '']):
        inside = one == '--ros-args' or (inside and one != '--')
        if inside and one in ('-p', '--param', '--params-file'):
            yield one, following


def _sections(path: str) -> List[Tuple[str, Set[str]]]:
    """Return the nodes that a parameter file is for, each with the names that it gives."""
    try:
        content = yaml.safe_load(Path(path).read_text(encoding='utf-8'))
    except (OSError, UnicodeDecodeError, yaml.YAMLError):
        return []  # rcl has read it by its own rules
    found: List[Tuple[str, Set[str]]] = []

    def look(place: str, value: Any) -> None:
        for key, inner in value.items() if isinstance(value, Mapping) else ():
            if key == 'ros__parameters':
                found.append((place, set(_flat(inner))))
            else:
                look(f'{place}/{str(key).strip("/")}', inner)
    look('', content)
    return found


def _flat(value: Any, prefix: str = '') -> Iterator[str]:
    """Yield the names of parameters, those in mappings with dots."""
    for key, inner in value.items() if isinstance(value, Mapping) else ():
        if isinstance(inner, Mapping):
            yield from _flat(inner, f'{prefix}{key}.')
        else:
            yield f'{prefix}{key}'
