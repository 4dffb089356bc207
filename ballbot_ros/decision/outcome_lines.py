# SPDX-License-Identifier: Apache-2.0
"""An outcome as a line of JSON with a checksum, and back."""
from dataclasses import asdict, fields, replace
import json
import math
from typing import Any, Dict, Mapping, Tuple
import zlib

from ballbot_ros.decision.outcomes import Outcome
from ballbot_ros.decision.plan import After, Plan, Strategy
from ballbot_ros.errors import ConfigurationError

FORMAT = 1
CHECKSUM, RUN = 'checksum', 'run'


def line_of(outcome: Outcome, run: str) -> bytes:
    """Return an outcome as a line of a log; `run` tells the starts of a node apart."""
    content: Dict[str, Any] = {'format': FORMAT, RUN: run}
    for name, value in asdict(replace(outcome, plan=None)).items():
        content[name] = value
    if outcome.plan is not None:
        # Infinite is for never; JSON knows no such number.
        content['plan'] = {name: value if not isinstance(value, float) or math.isfinite(value)
                           else str(value) for name, value in asdict(outcome.plan).items()}
    content[CHECKSUM] = _checksum(content)
    return json.dumps(content, allow_nan=False).encode() + b'\n'


def outcome_of(line: bytes) -> Tuple[Outcome, str]:
    """
    Return the outcome in a line of a log, and its run.

    Raises
    ------
    ConfigurationError
        Saying what is wrong with it.

    """
    try:
        content = json.loads(line.decode('utf-8'))
    except (UnicodeDecodeError, ValueError, RecursionError) as error:
        raise ConfigurationError('it is damaged: no JSON') from error
    if not isinstance(content, dict) or content.get(CHECKSUM) != _checksum(content):
        raise ConfigurationError('it is damaged: its checksum is another one')
    # White space, say, that changed is in no value, but whatever changed it may not stop there.
    if json.dumps(content).encode() != line:
        raise ConfigurationError('it is damaged: it is not written as a log writes it')
    if content.get('format') != FORMAT:
        raise ConfigurationError(
            f'it has format {content.get("format")!r}, this version reads {FORMAT}')
    values = {name: value for name, value in content.items()
              if name not in (CHECKSUM, 'format', RUN)}
    plan = values.pop('plan', None)
    run = content.get(RUN)
    if not isinstance(run, str) or not run:
        raise ConfigurationError('it names no run')
    return replace(Outcome.from_mapping(values, 'outcome'),
                   plan=None if plan is None else _plan(plan)), run


def _checksum(content: Mapping[str, Any]) -> str:
    text = json.dumps({name: value for name, value in content.items() if name != CHECKSUM},
                      sort_keys=True)
    return f'{zlib.crc32(text.encode()):08x}'


def _plan(content: Any) -> Plan:
    known = {item.name for item in fields(Plan)}
    if not isinstance(content, dict) or set(content) != known:
        raise ConfigurationError(f'its plan must have {", ".join(sorted(known))}')
    try:
        values = {name: float(value) for name, value in content.items()
                  if name not in ('strategy', 'after')}
        plan = Plan(Strategy(content['strategy']), after=After(content['after']), **values)
    except (TypeError, ValueError) as error:
        raise ConfigurationError(f'its plan is none: {error}') from error
    if any(math.isnan(value) for value in values.values()):
        raise ConfigurationError('its plan holds what is not a number')
    return plan
