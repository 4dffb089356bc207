# SPDX-License-Identifier: Apache-2.0
"""
Described, ranged and validated fields of frozen dataclasses.

Each number of this package is described once, in its declaration: its unit, its range and
one sentence about it.  YAML files, ROS parameters and error messages all use this
description::

    @dataclass(frozen=True)
    class Spring(Checked):
        stiffness: float = quantity('N/m', 'contact stiffness', above=0.0)

    Spring.from_mapping({'stifness': 3}, 'my.yaml')
    # ConfigurationError: my.yaml: 'stifness' is not known here; did you mean 'stiffness'?
"""
from contextlib import contextmanager
import copyreg
from dataclasses import dataclass, field, fields, MISSING, replace
from difflib import get_close_matches
import math
from numbers import Real
import re
from textwrap import shorten
from types import MappingProxyType
from typing import Any, Iterable, Iterator, Mapping, Optional, Type, TypeVar

from ballbot_ros.errors import ConfigurationError

T = TypeVar('T', bound='Checked')
C = TypeVar('C')

# Why an unmarked field cannot change while a node runs.
READ_AT_START = 'it is read once, at the start'


def quantity(unit: str, doc: str, *, default: Any = MISSING, above: float = -math.inf,
             minimum: float = -math.inf, maximum: float = math.inf,
             optional: bool = False) -> Any:
    """
    Declare a finite number with a unit and a range.

    Parameters
    ----------
    unit : str
        SI unit, ``'1'`` for none.
    doc : str
        One sentence for users; becomes the description of a ROS parameter.
    above : float
        Exclusive lower bound.
    minimum, maximum : float
        Inclusive bounds.
    optional : bool
        Accept None, for a value that is not given, and make it the default.

    """
    return field(default=None if optional else default, metadata={
        'kind': float, 'unit': unit, 'doc': doc, 'above': above, 'minimum': minimum,
        'maximum': maximum, 'optional': optional})


def count(doc: str, *, default: Any = MISSING, minimum: int = 0,
          maximum: int = 2**31 - 1) -> Any:
    """Declare a whole number with a range."""
    return field(default=default, metadata={
        'kind': int, 'unit': '1', 'doc': doc, 'above': -math.inf, 'minimum': minimum,
        'maximum': maximum})


def flag(doc: str, *, default: Any = MISSING) -> Any:
    """Declare a switch."""
    return field(default=default, metadata={'kind': bool, 'doc': doc})


def text(doc: str, *, default: Any = MISSING, choices: Iterable[str] = ()) -> Any:
    """Declare a text; if choices are given, it must be one of them."""
    return field(default=default, metadata={
        'kind': str, 'doc': doc,
        # A mapping is a registry, which may grow.
        'choices': choices if isinstance(choices, Mapping) else tuple(choices)})


def section(doc: str, *, cls: Any = None, default: Any = MISSING) -> Any:
    """Declare a section that the `Checked` class `cls` reads; without it, the owner checks it."""
    return field(default=default, metadata={'kind': object, 'doc': doc, 'cls': cls})


def live(declared: Any) -> Any:
    """Mark a declared field: as a parameter, it can change while a node runs."""
    return fixed('', declared)


def fixed(why: str, declared: Any) -> Any:
    """Mark a declared field: it cannot change while a node runs; `why` is ``'it ...'``."""
    return field(default=declared.default, metadata={**declared.metadata, 'fixed': why})


def why_fixed(metadata: Mapping[str, Any]) -> str:
    """Return why a field cannot change while a node runs; empty if it can."""
    return str(metadata.get('fixed', READ_AT_START))


def allowed(metadata: Mapping[str, Any]) -> str:
    """
    Return the range of a numeric field in words.

    >>> allowed(Spring.__dataclass_fields__['stiffness'].metadata)  # doctest: +SKIP
    'more than 0 N/m'
    """
    unit = '' if metadata['unit'] == '1' else f' {metadata["unit"]}'
    lows = []
    if metadata['above'] > -math.inf:
        lows.append(f'more than {metadata["above"]:.10g}')
    if metadata['minimum'] > -math.inf:
        lows.append(f'at least {metadata["minimum"]:.10g}')
    if metadata['maximum'] < math.inf:
        lows.append(f'at most {metadata["maximum"]:.10g}')
    return (' and '.join(lows) or f'any finite number{unit and " in"}') + unit


def comma_hint(value: object) -> str:
    """Return how to write a number that has a decimal comma, or nothing for other text."""
    word = str(value).strip()
    return f': write a decimal point, {word.replace(",", ".")}' if re.fullmatch(
        r'[-+]?\d+,\d+', word) else ''


def check_value(name: str, value: Any, metadata: Mapping[str, Any], where: str) -> Any:
    """
    Return `value` converted to the kind of its field.

    Integers and NumPy scalars are accepted for floats; nothing else is converted.

    Raises `ConfigurationError` naming location, field, value and allowed range.
    """
    kind = metadata['kind']
    place = f'{where}: {name}' if where else name
    if value is None and metadata.get('optional'):
        return None
    if kind is object:
        cls = metadata['cls']
        given = cls is None or value is None or isinstance(value, cls)
        return value if given else cls.from_mapping(value, place)
    if kind is str:
        if not isinstance(value, str):
            raise ConfigurationError(
                f'{place} must be text, got {value!r}; put text that reads as a number in quotes',
                'wrong_type', name)
        if metadata['choices']:
            check_choice(name, value, metadata['choices'], where)
        return value
    if kind is bool:
        if not isinstance(value, bool):
            raise ConfigurationError(
                f'{place} must be true or false, got {value!r}', 'wrong_type', name)
        return value
    if isinstance(value, bool) or not isinstance(value, Real):
        raise ConfigurationError(
            f'{place} must be a number ({allowed(metadata)}), got {value!r}{comma_hint(value)}',
            'wrong_type', name)
    if kind is int and not (isinstance(value, int) or float(value).is_integer()):
        raise ConfigurationError(
            f'{place} must be a whole number, got {value!r}', 'wrong_type', name)
    number = kind(value)
    if not within(number, metadata):
        finite, words = math.isfinite(number), allowed(metadata)
        raise ConfigurationError(
            f'{place} must be {"" if finite or "finite" in words else "finite and "}{words}, got '
            f'{value!r}', 'out_of_range' if finite else 'not_finite', name)
    return number


def check_choice(name: str, value: str, choices: Iterable[str], where: str = '') -> None:
    """Raise `ConfigurationError` with value and choices if `value` is not one of them."""
    names = list(choices)
    if value not in names:
        raise ConfigurationError(
            f'{where}{": " * bool(where)}{name} must be one of {", ".join(names)}, got {value!r}'
            + suggestion(value, names, listing=False), 'not_a_choice', name)


def within(number: Any, metadata: Mapping[str, Any]) -> Any:
    """Return whether a number is finite and in the range of its field; elementwise for arrays."""
    return ((abs(number) < math.inf) & (metadata['above'] < number)
            & (metadata['minimum'] <= number) & (number <= metadata['maximum']))


def suggestion(name: str, known: Iterable[str], listing: bool = True) -> str:
    """
    Return the hint that follows the error message for an unknown name.

    ``'; did you mean ...?'`` for a close match, otherwise the list of names if `listing`.
    """
    names = sorted(known)
    near = get_close_matches(str(name), names, n=1, cutoff=0.6)
    if near:
        return f'; did you mean {near[0]!r}?'
    return f'; known names: {", ".join(names)}' if names and listing else ''


class Problems:
    """
    Collects errors, so that all errors of a file are reported together.

    ::

        problems = Problems()
        for name in names:
            with problems.collected():
                check(name)
        problems.refuse()
    """

    def __init__(self) -> None:
        self._found: list[ConfigurationError] = []

    @contextmanager
    def collected(self) -> Iterator[None]:
        """Keep a `ConfigurationError` that the block raises."""
        try:
            yield
        except ConfigurationError as error:
            self._found += error.problems or (error,)

    def refuse(self) -> None:
        """Raise `ConfigurationError` if there is any problem."""
        if self._found:
            raise ConfigurationError.of(self._found)


def refuse_unknown(mapping: Mapping[str, Any], known: Iterable[str], where: str) -> None:
    """Raise `ConfigurationError` for the keys of `mapping` that are not `known`."""
    names = set(known)
    problems = [ConfigurationError(
        f'{where}: {key!r} is not known here{suggestion(key, names)}', 'unknown_name', str(key))
        for key in mapping if key not in names]
    if problems:
        raise ConfigurationError.of(problems)


@dataclass(frozen=True)
class Checked:
    """A frozen dataclass whose described fields are checked when it is created."""

    def __post_init__(self) -> None:
        for item in fields(self):
            if 'kind' in item.metadata:
                value = check_value(item.name, getattr(self, item.name), item.metadata,
                                    type(self).__name__)
                object.__setattr__(self, item.name, value)

    def __repr__(self) -> str:
        """Return the values that are not the defaults; for a class made with ``repr=False``."""
        shown = [f'{item.name}={getattr(self, item.name)!r}' for item in fields(self)
                 if item.repr and getattr(self, item.name) != item.default]
        return f'{type(self).__name__}({", ".join(shown)})'

    @classmethod
    def from_mapping(cls: Type[T], mapping: Any, where: str) -> T:
        """
        Build from the mapping of a YAML file; `where` is its location, for error messages.

        Raises `ConfigurationError` for anything missing, unknown, of the wrong type or out of
        range.
        """
        return build(cls, checked_values(cls, expect_mapping(mapping, where), where), where)


def changed(part: C, values: Mapping[str, Any]) -> C:
    """
    Return a copy of a frozen dataclass with other values, some of which may be columns.

    A column is an array with one number per case.  Formulas apply to columns unchanged, and
    conditions yield columns of booleans.  This function does not check columns: the caller checks
    each row with `within` and the conditions of the class.

    Raises `ConfigurationError` if no value is a column, and a value is out of range.
    """
    if not any(map(_has_columns, values.values())):
        return replace(part, **values) if values else part  # type: ignore[type-var]
    copy = object.__new__(type(part))
    copy.__dict__.update(part.__dict__, **values)
    return copy


def _has_columns(value: Any) -> bool:
    """Return whether a value is a column, or a part with one."""
    return getattr(value, 'ndim', 0) > 0 or any(
        map(_has_columns, getattr(value, '__dict__', {}).values()))


def build(cls: Type[T], values: Mapping[str, Any], where: str) -> T:
    """
    Return ``cls(**values)``; errors name the location in the file.

    Raises `ConfigurationError` if the values contradict each other.
    """
    try:
        return cls(**values)
    except ConfigurationError as error:
        raise error.at(where) from error


def checked_values(cls: Type[Checked], entries: Mapping[str, Any],
                   where: str) -> dict[str, Any]:
    """
    Return the values of `entries` for the described fields of `cls`, checked.

    Raises `ConfigurationError` naming all entries that are missing, unknown, of the wrong type or
    out of range.
    """
    problems, values = Problems(), {}
    with problems.collected():
        refuse_missing([(cls, entries, where)])
    with problems.collected():
        values = given_values(cls, entries, where)
    problems.refuse()
    return values


def given_values(cls: Type[Checked], entries: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Return `entries`, each checked; `refuse_missing` finds missing and unknown entries."""
    problems, values = Problems(), {}
    for item in fields(cls):
        if item.name in entries and 'kind' in item.metadata:
            with problems.collected():
                values[item.name] = check_value(
                    item.name, entries[item.name], item.metadata, where)
    problems.refuse()
    return values


def refuse_missing(parts: Iterable[tuple[Type[Checked], Mapping[str, Any], str]]) -> None:
    """
    Refuse unknown and missing entries in the parts of a file: their class, entries and location.

    Raises `ConfigurationError` naming each unknown entry, and each missing entry with its meaning
    and range.
    """
    problems = Problems()
    for cls, entries, where in parts:
        described = {item.name: item for item in fields(cls) if 'kind' in item.metadata}
        with problems.collected():
            refuse_unknown(entries, [item.name for item in fields(cls) if item.metadata], where)
        # A misspelt key is not also reported as missing.
        misspelt = {near for key in entries if key not in described
                    for near in get_close_matches(key, described, 1, 0.6)}
        lacking = {name: item.metadata for name, item in described.items()
                   if name not in entries and item.default is MISSING and name not in misspelt}
        words = [f'{name} is missing ({metadata["doc"]}'
                 + (f', {allowed(metadata)})' if 'unit' in metadata else ')')
                 for name, metadata in lacking.items()]
        with problems.collected():
            if words:
                raise ConfigurationError(
                    f'{where}: {"; ".join(words)}', 'missing', next(iter(lacking)))
    problems.refuse()


def expect_mapping(value: Any, where: str) -> Mapping[str, Any]:
    """Return `value` if it is a mapping with text keys; raise `ConfigurationError` if not."""
    if not isinstance(value, dict) or not all(isinstance(key, str) for key in value):
        found = 'nothing' if value is None else shorten(repr(value), 60)
        raise ConfigurationError(
            f'{where}: expected a mapping of names to values, got {found}', 'wrong_type',
            where.rsplit(': ', 1)[-1])
    return value


def _read_only(mapping: Mapping[Any, Any]) -> Mapping[Any, Any]:
    return MappingProxyType(mapping)


# Robots and hardware descriptions have read-only mappings; this makes the mappings picklable.
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

    source: str  # one of `SOURCES`
    low: Optional[float] = None  # range of the true value, SI units
    high: Optional[float] = None
    note: str = ''


def read_values(cls: Type[Checked], content: Mapping[str, Any],
                where: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """
    Return the checked values of fields of `cls`, and the `Provenance` of each value that has one.

    An entry is a value, or a mapping with its provenance::

        ball_mass: {value: 3.8, unit: kg, source: derived, range: [3.3, 4.15], note: ...}

    Raises `ConfigurationError` naming location, field, value and allowed range; also for unknown
    and missing entries.
    """
    described = {item.name: item.metadata for item in fields(cls) if 'kind' in item.metadata}
    problems, plain, provenance, values = Problems(), {}, {}, {}
    with problems.collected():
        refuse_missing([(cls, content, where)])
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
