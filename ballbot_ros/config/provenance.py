# SPDX-License-Identifier: Apache-2.0
"""Where the numbers of a file come from, and how sure they are."""
import copyreg
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import Any, Mapping, Optional, Type

from ballbot_ros.config.fields import (
    allowed, check_value, Checked, given_values, refuse_missing, refuse_unknown)
from ballbot_ros.errors import ConfigurationError


def _read_only(mapping: Mapping[Any, Any]) -> Mapping[Any, Any]:
    return MappingProxyType(mapping)


# Robots and hardware descriptions hold read-only mappings; this makes these picklable.
copyreg.pickle(
    MappingProxyType,
    lambda proxy: (_read_only, (dict(proxy),)))  # type: ignore[arg-type,return-value]

SOURCES = ('published', 'repaired', 'derived', 'assumed', 'measured')


@dataclass(frozen=True)
class Provenance:
    """
    Where a number comes from and how sure it is.

    ``published``: printed in the paper.  ``repaired``: printed there, damaged in the copy at hand
    and restored.  ``derived``: computed from other statements of the paper.  ``assumed``: chosen
    here, nothing is published.  ``measured``: on one's own robot.
    """

    source: str  # one of these
    low: Optional[float] = None  # range that the true value is believed to lie in, SI units
    high: Optional[float] = None
    note: str = ''


def read_values(cls: Type[Checked], content: Mapping[str, Any],
                where: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """
    Return what `read_given` does, where nothing is missing.

    Raises
    ------
    ConfigurationError
        Naming place, field, value and allowed range.

    """
    values, provenance = read_given(cls, content, where)
    refuse_missing([(cls, content, where)])
    return values, provenance


def read_given(cls: Type[Checked], content: Mapping[str, Any],
               where: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """
    Return the checked values of fields of `cls`, and the `Provenance` of those that have one.

    An entry is a value, or a mapping that says more::

        ball_mass: {value: 3.8, unit: kg, source: derived, range: [3.3, 4.15], note: ...}

    Raises
    ------
    ConfigurationError
        Naming place, field, value and allowed range.

    """
    described = {item.name: item.metadata for item in fields(cls) if 'kind' in item.metadata}
    refuse_unknown(content, described, where)
    plain, provenance = {}, {}
    for name, entry in content.items():
        if isinstance(entry, dict):
            plain[name], provenance[name] = _read_entry(name, entry, described[name], where)
        else:
            plain[name] = entry
    return given_values(cls, plain, where), provenance


def _read_entry(name: str, entry: Mapping[str, Any], metadata: Mapping[str, Any],
                where: str) -> tuple[Any, Any]:
    """Return the value and the `Provenance` of one described entry."""
    place = f'{where}: {name}'
    refuse_unknown(entry, ('value', 'unit', 'source', 'range', 'note'), place)
    if 'value' not in entry:
        raise ConfigurationError(f'{place}: value is missing ({metadata["doc"]})')
    unit = entry.get('unit', metadata.get('unit'))
    if unit != metadata.get('unit'):
        raise ConfigurationError(
            f'{place}: unit must be {metadata.get("unit")!r} (SI), got {unit!r}; '
            'convert the value')
    source = entry.get('source', 'published')
    if source not in SOURCES:
        raise ConfigurationError(
            f'{place}: source must be one of {", ".join(SOURCES)}, got {source!r}')
    value = check_value(name, entry['value'], metadata, where)
    low = high = None
    if 'range' in entry:
        try:
            low, high = (check_value(f'{name}: range', end, metadata, where)
                         for end in entry['range'])
        except (TypeError, ValueError) as error:
            raise ConfigurationError(
                f'{place}: range must be two numbers [low, high], {allowed(metadata)}, '
                f'got {entry["range"]!r}') from error
        if not low <= value <= high:
            raise ConfigurationError(
                f'{place}: value {value:g} lies outside its own range [{low:g}, {high:g}]')
    return value, Provenance(source, low, high, str(entry.get('note', '')))
