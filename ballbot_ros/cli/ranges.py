# SPDX-License-Identifier: Apache-2.0
"""
Several numbers in one option, alike in all verbs.

``0.5`` is a number, ``0.2,0.5,0.9`` are three, ``0.2:1.2:21`` are 21 of them, evenly spaced, the
first and the last included.  ``0.2:1.2``, for a design that draws its points, is a range.
"""
import math
import re
from typing import List, Sequence, Tuple, Union

from ballbot_ros.errors import ConfigurationError

METAVAR = 'VALUES'
WORDING = 'a number, several as in 0.2,0.5, or FIRST:LAST:COUNT as in 0.2:1.2:21'
MOST = 100_000  # numbers of a range

Values = Union[List[float], Tuple[float, float]]


def read_numbers(words: Sequence[str], option: str) -> List[float]:
    """
    Return the numbers of the words of an option.

    Parameters
    ----------
    words : sequence of str
    option : str
        With its dashes; it begins each refusal.

    Raises
    ------
    ConfigurationError
        Naming the word and what is allowed.

    """
    numbers: List[float] = []
    for word in words:
        values = read_values(word, option)
        if isinstance(values, tuple):
            raise ConfigurationError(
                f'{option} {word}: the count is missing: write {word}:COUNT, such as {word}:11',
                'missing', option)
        numbers += values
    return numbers


def read_values(word: str, option: str) -> Values:
    """
    Return the list of numbers of one word, or of ``low:high`` both ends as a tuple.

    Raises
    ------
    ConfigurationError
        Naming the word and the allowed form; for a stride, with the equivalent count.

    """
    parts = word.split(':') if ':' in word else word.split(',')
    # "0,8" reads as 0 and 8: in many languages it is 0.8.  Two values are written "0.0,8".
    if re.fullmatch(r'-?0,[0-9]+', word) or ':' in word and re.search(r'[0-9],[0-9]', word):
        point = word.replace(',', '.')
        raise ConfigurationError(
            f'{option} {word}: a decimal comma; write {point}'
            + ('' if ':' in word else f', or {word.replace(",", ".0,")} for two values'),
            'decimal_comma', option)
    try:
        numbers = [float(part) for part in parts]
    except ValueError:
        numbers = []
    if not numbers or len(numbers) > 3 and ':' in word or not all(map(math.isfinite, numbers)):
        raise ConfigurationError(f'{option} must be {WORDING}; got {word!r}', 'wrong_type', option)
    if ':' not in word:
        return numbers
    first, last = numbers[:2]
    if not first < last:
        raise ConfigurationError(
            f'{option} {word}: the last must be above the first', 'inconsistent', option)
    if len(numbers) == 2:
        return first, last
    if not (parts[2].strip().isdigit() and 2 <= numbers[2] <= MOST):
        raise ConfigurationError(
            f'{option} {word}: the third is a count, of at least 2 and at most {MOST} numbers, '
            f'got {parts[2]}{_as_count(first, last, numbers[2])}', 'out_of_range', option)
    # Rounded: 0.2 + 2 x 0.05 is to be 0.3.
    count = int(numbers[2])
    return [round(first + (last - first) * place / (count - 1), 12) for place in range(count)]


def read_range(word: str, option: str) -> List[float]:
    """Return the numbers of ``FIRST:LAST:COUNT``; `ConfigurationError` for anything else."""
    values = read_values(word, option)
    if ':' not in word or isinstance(values, tuple):
        raise ConfigurationError(
            f'{option} must be FIRST:LAST:COUNT, as in 0.2:1.2:21; got {word!r}', 'wrong_type',
            option)
    return values


def read_varied(word: str, option: str) -> Tuple[str, Values]:
    """Return the name and the values of ``name=VALUES``; see `read_values`."""
    name, equals, values = word.partition('=')
    if not (name and equals):
        raise ConfigurationError(f'{option} must be NAME=VALUES, such as speed=0.2:1.2:21; got '
                                 f'{word!r}', 'wrong_type', option)
    return name, read_values(values, f'{option} {name}')


def _as_count(first: float, last: float, stride: float) -> str:
    """Return the form with a count for a stride; empty for an implausible count."""
    if not 0.0 < stride <= last - first:
        return ''
    count = (last - first) / stride
    whole = round(count)
    if abs(count - whole) > 1e-6 or whole + 1 > MOST:
        return ''
    return f'; a stride of {stride:g} is {first:g}:{last:g}:{whole + 1}'
