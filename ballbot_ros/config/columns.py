# SPDX-License-Identifier: Apache-2.0
"""
Described dataclasses with columns in place of numbers: many cases in one object.

A column is an array, a number for each case.  Formulas for numbers hold for columns as they are,
and conditions become columns of truths.  The caller checks columns, row by
row, with `fields.within` and the conditions of the class; the object itself does not.
"""
from dataclasses import replace
from typing import Any, Mapping, Sequence, TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar('T')


def changed(part: T, values: Mapping[str, Any]) -> T:
    """
    Return a copy of a frozen dataclass with other values, some of which may be columns.

    Raises
    ------
    ConfigurationError
        If there are no columns among the values, and one is out of range.

    """
    if not any(isinstance(value, np.ndarray) for value in values.values()):
        return replace(part, **values) if values else part  # type: ignore[type-var]
    copy = object.__new__(type(part))
    copy.__dict__.update(part.__dict__, **values)
    return copy


def table(values: Sequence[Any], number: int) -> NDArray[np.float64]:
    """Return a parameter table: a row for each case."""
    rows = np.empty((number, len(values)))
    if number == 1:
        rows[0] = values
    else:
        for place, value in enumerate(values):
            rows[:, place] = value
    return rows
