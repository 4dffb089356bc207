# SPDX-License-Identifier: Apache-2.0
"""What the two kinds of a replayed bag share: its words, its outcome, its parameters."""
import argparse
import math
from typing import Any, NamedTuple, Optional

from ballbot_ros.errors import ConfigurationError

# Where the torque comes from; the words of --by.
COMMANDS, TORQUES, SET_POINTS = 'commands', 'torques', 'set-points'


class Replayed(NamedTuple):
    """What a replay found; `identical` is None where there is nothing to be identical with."""

    words: str
    content: dict[str, Any]
    series: Any
    identical: Optional[bool]
    files: dict[str, Any] = {}  # for identify, by name


def table(found: list[Any]) -> str:
    """Return the differences of all channels as lines."""
    lines = [f'{"channel":<16}{"RMS":>11}{"largest":>11}       {"at":>8}   of its span   departs']
    for item in found:
        share = f'{100.0 * item.largest / item.span:.1f} %' if item.span > 0.0 else '-'
        departs = 'never' if math.isnan(item.departs) else f'at {item.departs:.3f} s'
        lines.append(f'{item.channel:<16}{item.rms:>11.3g}{item.largest:>11.3g} {item.unit:<6}'
                     f'{item.when:>6.3f} s   {share:>11}   {departs}')
    return '\n'.join(lines)


def parameters_of(arguments: argparse.Namespace, known: dict[str, Any]) -> Any:
    """
    Return the parameters of the simulator of a bag.

    Raises
    ------
    ConfigurationError
        If no scene is known, or a parameter is unknown or out of range.

    """
    import yaml
    from ballbot_ros.ros.settings import SimulatorSettings
    given = dict(known)
    for words in arguments.set or ():
        name, sign, text = words.partition('=')
        if not sign:
            raise ConfigurationError(f'--set takes NAME=VALUE, got {words!r}')
        given[name] = yaml.safe_load(text)
    given.update({name: getattr(arguments, name) for name in ('scene', 'robot')
                  if getattr(arguments, name)})
    if 'scene' not in given:
        raise ConfigurationError(
            f'{arguments.file} does not say which scene it is of: give it, --scene NAME, and '
            'where they are not the defaults --robot NAME and --set NAME=VALUE for parameters of '
            'the simulator')
    return SimulatorSettings.from_mapping(given, 'parameters of the simulator')
