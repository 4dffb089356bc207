# SPDX-License-Identifier: Apache-2.0
"""Parameters that several nodes share, and parameters with the values of a file."""
from dataclasses import dataclass, Field, field, fields, replace
from typing import Any, Callable, Dict, Mapping, NamedTuple, Type, TypeVar

from ballbot_ros.config.fields import (
    check_value, Checked, expect_mapping, quantity, refuse_unknown, text)
from ballbot_ros.control import ControlTuning

S = TypeVar('S', bound='Settings')


class LoopNumbers(NamedTuple):
    """Parameters that, with the robot, determine the stability of a loop."""

    tuning: ControlTuning
    rate: float  # [Hz]
    delay: float  # [samples]


def file_in(folder: str, default: str, kind: str = '', doc: str = '') -> Any:
    """Declare the name of a file in a folder of config; `config_folders` returns the folder."""
    return field(default=default, metadata={'folder': folder, **text(
        f'name of a {kind or folder[:-1]} in config/{folder}, or a YAML file{doc}').metadata})


def config_folders(cls: Type[Checked]) -> dict[str, str]:
    """Return the parameters that name a file, and the folder of config of each."""
    return {item.name: item.metadata['folder'] for item in fields(cls)
            if 'folder' in item.metadata}


def rate_of(topic: str, default: float, minimum: float = 1.0, maximum: float = 10000.0) -> Any:
    return quantity('Hz', f'rate of {topic}', default=default, minimum=minimum, maximum=maximum)


def numbers_in(source: str, cls: Type[Checked], load: Callable[[str], Any],
               prefix: str = '') -> Any:
    """
    Declare each described field of a class, which `load` reads from a file, as a parameter.

    If the field `source`, which names the file, changes, all of these parameters change; their
    names have a prefix.
    """
    return field(default=None, metadata={
        'kind': object, 'doc': f'the parameters of {source}', 'cls': cls, 'source': source,
        'load': load, 'prefix': prefix})


def numbers_of(cls: Type[Checked], prefix: str) -> Any:
    """Declare each described field of a class as a parameter, whose name has a prefix."""
    return field(default=cls(), metadata={
        'kind': object, 'doc': f'the parameters {prefix}*', 'cls': cls, 'source': '',
        'prefix': prefix})


class Described(NamedTuple):
    """A parameter: a field of the settings, or a part of such a field."""

    field: str
    part: str  # name of a number in the field; empty if the field itself is the parameter
    metadata: Mapping[str, Any]

    def value(self, settings: Any) -> Any:
        value = getattr(settings, self.field)
        return getattr(value, self.part) if self.part else value


@dataclass(frozen=True)
class Settings(Checked):
    """The parameters of a node; numbers that are not set come from the named file."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for item in _with_parts(type(self)):
            if getattr(self, item.name) is None:
                object.__setattr__(self, item.name, item.metadata['load'](
                    getattr(self, item.metadata['source'])))

    @classmethod
    def described(cls) -> Dict[str, Described]:
        """Return all parameters by name."""
        found: Dict[str, Described] = {}
        for item in fields(cls):
            if 'prefix' in item.metadata:
                for part in fields(item.metadata['cls']):
                    found[item.metadata['prefix'] + part.name] = Described(
                        item.name, part.name, {'fixed': '', **part.metadata})
            elif 'kind' in item.metadata:
                found[item.name] = Described(item.name, '', item.metadata)
        return found

    @classmethod
    def from_mapping(cls: Type[S], mapping: Any, where: str) -> S:
        """Return settings from parameter names and values; see `Checked.from_mapping`."""
        given, described = expect_mapping(mapping, where), cls.described()
        refuse_unknown(given, described, where)
        return cls().changed({name: check_value(name, value, described[name].metadata, where)
                              for name, value in given.items()})

    def changed(self: S, values: Mapping[str, Any]) -> S:
        """
        Return settings with these parameter values changed.

        A new file name reloads all of its values, except those given explicitly.

        Raises `ConfigurationError` if a file cannot be read, or values are inconsistent.
        """
        described = self.described()
        own = {name: value for name, value in values.items() if not described[name].part}
        parts: Dict[str, Dict[str, Any]] = {}
        for name in set(values) - set(own):
            parts.setdefault(described[name].field, {})[described[name].part] = values[name]
        numbers = {}
        for item in _with_parts(type(self)):
            base, source = getattr(self, item.name), item.metadata['source']
            if source in own and own[source] != getattr(self, source):
                base = item.metadata['load'](own[source])
            numbers[item.name] = replace(base, **parts.get(item.name, {}))
        return replace(self, **own, **numbers)


def _with_parts(cls: Type[Settings]) -> list['Field[Any]']:
    return [item for item in fields(cls) if 'prefix' in item.metadata]
