# SPDX-License-Identifier: Apache-2.0
"""Source and uncertainty of the parameters in a file."""
import copyreg
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import Any, Mapping, Optional, Type

from ballbot_ros.config.fields import (
    allowed, check_value, Checked, given_values, Problems, refuse_missing, refuse_unknown)
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
    Source and uncertainty of a parameter.

    ``published``: printed in the paper.  ``repaired``: printed there, damaged in the available
    copy and restored.  ``derived``: computed from other statements of the paper.  ``assumed``:
    chosen here, not published.  ``measured``: on the robot itself.
    """

    source: str  # one of these
    low: Optional[float] = None  # range of the true value, SI units
    high: Optional[float] = None
    note: str = ''


def read_values(cls: Type[Checked], content: Mapping[str, Any],
                where: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """
    Return the values and provenance of `read_given`; refuse unknown and missing entries.

    Raises
    ------
    ConfigurationError
        Naming place, field, value and allowed range.

    """
    problems = Problems()
    values: dict[str, Any] = {}
    provenance: dict[str, Any] = {}
    with problems.collected():
        refuse_missing([(cls, content, where)])
    with problems.collected():
        values, provenance = read_given(cls, content, where)
    problems.refuse()
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
    problems, plain, provenance, values = Problems(), {}, {}, {}
    for name, entry in content.items():
        with problems.collected():
            if isinstance(entry, dict) and name in described:
                plain[name], provenance[name] = _read_entry(name, entry, described[name], where)
            else:
                plain[name] = entry
    with problems.collected():
        values = given_values(cls, plain, where)
    problems.refuse()
    return values, provenance


def _read_entry(name: str, entry: Mapping[str, Any], metadata: Mapping[str, Any],
                where: str) -> tuple[Any, Any]:
    """Return the value and the `Provenance` of one described entry."""
    place = f'{where}: {name}'
    refuse_unknown(entry, ('value', 'unit', 'source', 'range', 'note'), place)
    if 'value' not in entry:
        raise ConfigurationError(
            f'{place}: value is missing ({metadata["doc"]})', 'missing', name)
    unit = entry.get('unit', metadata.get('unit'))
    if unit != metadata.get('unit'):
        raise ConfigurationError(
            f'{place}: unit must be {metadata.get("unit")!r} (SI), got {unit!r}; '
            'convert the value', 'not_a_choice', name)
    source = entry.get('source', 'published')
    if source not in SOURCES:
        raise ConfigurationError(
            f'{place}: source must be one of {", ".join(SOURCES)}, got {source!r}',
            'not_a_choice', name)
    value = check_value(name, entry['value'], metadata, where)
    low = high = None
    if 'range' in entry:
        try:
            low, high = (check_value(f'{name}: range', end, metadata, where)
                         for end in entry['range'])
        except (TypeError, ValueError) as error:
            raise ConfigurationError(
                f'{place}: range must be two numbers [low, high], {allowed(metadata)}, '
                f'got {entry["range"]!r}', 'wrong_type', name) from error
        if not low <= value <= high:
            raise ConfigurationError(
                f'{place}: value {value:g} lies outside its own range [{low:g}, {high:g}]',
                'inconsistent', name)
    return value, Provenance(source, low, high, str(entry.get('note', '')))
