# SPDX-License-Identifier: Apache-2.0
"""Parts of a verb: parser, exit codes, and error output."""
import argparse
from difflib import get_close_matches
from pathlib import Path
import re
import sys
from typing import Any, Callable, NamedTuple, NoReturn, Optional, Sequence

from ballbot_ros.config.fields import check_value, comma_hint
from ballbot_ros.errors import ConfigurationError

# Exit codes: 128 + number of the signal as in a shell; 2 for misuse as in argparse.
DONE, FAILED, MISUSED, INTERRUPTED, PIPE_CLOSED = 0, 1, 2, 130, 141


class Verb(NamedTuple):
    """A verb of a module that has several."""

    add_arguments: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace], int]


def print_error(message: str) -> None:
    """Print an error as one line on standard error."""
    print(f'ballbot: error: {" ".join(message.split())}', file=sys.stderr)


def note(sentence: str) -> None:
    """Print a note, which is not a result, on standard error."""
    print(sentence, file=sys.stderr, flush=True)


def _number(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f'must be a number, got {word!r}{comma_hint(word)}') from None


def _whole_number(word: str) -> int:
    if not re.fullmatch('[-+]?[0-9]+', word):
        raise argparse.ArgumentTypeError(f'must be a whole number, got {word!r}')
    return int(word)


def _path(word: str) -> Path:
    if not word:  # an unset shell variable; pathlib would read it as the current folder
        raise argparse.ArgumentTypeError('must be the name of a file or folder, got no text')
    return Path(word)


class Parser(argparse.ArgumentParser):
    """A parser that raises an error instead of printing its usage and exiting."""

    words: Sequence[str] = ()  # of the command line
    of_verb: Optional['Parser'] = None

    def __init__(self, **options: Any):
        super().__init__(**options)
        for kind, read in ((float, _number), (int, _whole_number), (Path, _path)):
            self.register('type', kind, read)

    def parse_args(self, *words: Any) -> argparse.Namespace:  # type: ignore[override]
        """Return the values of the options; refuse a number out of its declared range."""
        arguments: argparse.Namespace = super().parse_args(*words)
        for action in (self.of_verb or self)._actions:
            value = getattr(arguments, action.dest, None)
            if value is not None and hasattr(action, 'declared'):
                check_value(action.option_strings[-1], value, action.declared, '')
        return arguments

    def error(self, message: str) -> NoReturn:
        """Raise `ConfigurationError`, with the nearest valid option for a misspelt one."""
        known = (self.of_verb or self)._option_string_actions
        words = [word.split('=')[0].strip("':,") for word in message.split()]
        words += [word.split('=')[0] for word in self.words if word[:2] == '--']
        # Options after --ros-args belong to the node.
        words = words[:words.index('--ros-args')] if '--ros-args' in words else words
        # The message names --help anyway.
        names = [option[2:] for option in known if option[:2] == '--' and option != '--help']
        hints = [f'{word}: did you mean --{near[0]}?' for word in dict.fromkeys(words)
                 if word.startswith('--') and word not in known
                 and (near := get_close_matches(word[2:], names, n=1))]
        raise ConfigurationError(
            '; '.join([message, *hints, f'see {(self.of_verb or self).prog} --help']), 'usage',
            next(iter(re.findall(r'--[\w-]+|(?<=required: )[\w-]+', message)), ''))
