# SPDX-License-Identifier: Apache-2.0
"""Counts what came of the approaches, beside the targets."""
from collections import Counter
import math
from typing import Any, Dict, List, Optional, Sequence, Tuple

import numpy as np
from scipy.stats import beta

from ballbot_ros.studies.evaluation.judge import OUTCOMES

Row = Dict[str, Any]

GENTLE = math.radians(3.0)  # slopes on which no fall is allowed
WITHIN = 0.02               # of a promise
# Promises, and the probabilities that are counted to each.
PROMISES = ((0.9, 0.875, 0.925), (0.95, 0.925, 0.97), (0.99, 0.97, 1.0 + 1e-9))
EDGES = (0.0, 0.5, 0.7, 0.8, 0.875, 0.925, 0.97, 1.0 + 1e-9)  # of the reliability diagram
MOST_CHANGES = 2
CROSSED, OF = 150, 160
ROOMS = (0.15, 0.4, 0.65, 1.0, 1.5, 2.5)  # before the step [m]
LISTED = 20  # numbers of approaches that went wrong
BAD = ('fell', 'hit', 'ran away', 'stuck', 'idle', 'undecided', 'raised')


def interval(good: int, total: int, level: float = 0.95) -> Tuple[float, float]:
    """Return the interval of Clopper and Pearson for a probability."""
    low, high = 0.5 * (1.0 - level), 0.5 * (1.0 + level)
    return (float(beta.ppf(low, good, total - good + 1)) if good > 0 else 0.0,
            float(beta.ppf(high, good + 1, total - good)) if good < total else 1.0)


def kept(rows: Sequence[Row], low: float, high: float) -> Dict[str, Any]:
    """Return how many attempts were promised a probability in a range, and how many got over."""
    attempts = [one for row in rows for one in row['attempts']
                if one['probability'] is not None and low <= one['probability'] < high]
    total, over = len(attempts), sum(one['over'] for one in attempts)
    found: Dict[str, Any] = {'attempts': total, 'over': over}
    if total:
        found['promised'] = float(np.mean([one['probability'] for one in attempts]))
        found['kept'] = over / total
        found['interval'] = interval(over, total)
    return found


def target(name: str, wanted: str, found: str, met: Optional[bool]) -> Dict[str, Any]:
    """Return a line of the table of targets; `met` is None where nothing was measured."""
    return {'figure': name, 'target': wanted, 'found': found, 'met': met}


def targets(rows: Sequence[Row], crossable: Sequence[Row]) -> List[Dict[str, Any]]:
    """Return the figures of the planner that is to be proven, beside their targets."""
    total = len(rows)
    falls = [row for row in rows if row['outcome'] == 'fell']
    gentle = [row for row in falls if abs(row['slope']) <= GENTLE and not row['hidden']]
    slopes = sum(abs(row['slope']) <= GENTLE for row in rows)
    hits = [row for row in rows if row['outcome'] == 'hit' and not row['hidden']]
    lines = [
        target('falls from a drop, slopes within 3 degrees', '0',
               f'{len(gentle)} of {slopes}', not gentle),
        target('hits above 0.1 m/s while not crossing', '1 in 1,000',
               f'{len(hits)} of {total}', len(hits) <= 1e-3 * total)]
    for promise, low, high in PROMISES:
        found = kept([*rows, *crossable], low, high)
        words = 'no such promise' if not found['attempts'] else (
            f'promised {found["promised"]:.3f}, kept {found["kept"]:.3f} '
            f'({found["interval"][0]:.3f} to {found["interval"][1]:.3f}; {found["over"]} of '
            f'{found["attempts"]})')
        met = None if not found['attempts'] else abs(found['kept'] - found['promised']) <= WITHIN
        lines.append(target(f'promised {promise:g}: kept', 'within 2 %', words, met))
    crossed = sum(row['outcome'] == 'over' for row in crossable)
    lines.append(target(
        'crossings of what 23 of 24 robots can cross (<= 1.15 m/s, best start allowed)',
        f'{CROSSED} of {OF}', f'{crossed} of {len(crossable)}',
        crossed * OF >= CROSSED * len(crossable) if crossable else None))
    again = sum(one['same'] for row in [*rows, *crossable] for one in row['attempts'])
    lines.append(target('same plan again after a failure', 'never', str(again), again == 0))
    changes = [row['changes'] for row in [*rows, *crossable]]
    more = sum(count > MOST_CHANGES for count in changes)
    lines.append(target(
        'changes of mind per approach without news', 'at most 2',
        f'at most {max(changes, default=0)}; more than 2 in {more} of {len(changes)}', more == 0))
    return lines


def missed(rows: Sequence[Row]) -> Dict[str, Any]:
    """Return what was not crossed though some way would have led over."""
    searched = [row for row in rows if 'possible' in row]
    could = [row for row in searched if row['possible']]
    refused = [row for row in could if row['outcome'] != 'over']
    return {'searched': len(searched), 'possible': len(could),
            'crossed': len(could) - len(refused), 'missed': len(refused),
            'by kind': dict(Counter(row['kind'] for row in refused)),
            'numbers': [row['number'] for row in refused[:LISTED]]}


def outcomes(rows: Sequence[Row]) -> Dict[str, int]:
    """Return how often each outcome came."""
    found = Counter(row['outcome'] for row in rows)
    return {name: found[name] for name in (*OUTCOMES, 'raised') if found[name]}


def by_room(rows: Sequence[Row], radius: float) -> List[Dict[str, Any]]:
    """Return how many crossable steps were crossed, by the room before them."""
    found = []
    for low, high in zip(ROOMS[:-1], ROOMS[1:]):
        here = [row for row in rows if low <= row['foot'] - radius < high]
        found.append({'from': low, 'to': high, 'approaches': len(here),
                      'over': sum(row['outcome'] == 'over' for row in here)})
    return found


def of_planner(rows: Sequence[Row], crossable: Sequence[Row], radius: float) -> Dict[str, Any]:
    """Return the figures of one planner."""
    total = max(len(rows), 1)
    kinds = sorted({row['kind'] for row in rows})
    costs = [row['mean_ms'] for row in rows if row.get('decisions')]
    whole = [row['mean_ms'] * row['decisions'] for row in rows if row.get('decisions')]
    firsts = [row['first_ms'] for row in rows if row.get('decisions')]
    return {
        'approaches': len(rows), 'outcomes': outcomes(rows),
        'per thousand': {name: 1e3 * sum(row['outcome'] == name for row in rows) / total
                         for name in BAD},
        'bumps': sum(row.get('bumps', 0) for row in rows),
        'hidden': dict(Counter(row['outcome'] for row in rows if row.get('hidden'))),
        'kinds': {kind: outcomes([row for row in rows if row['kind'] == kind])
                  for kind in kinds},
        'numbers': {name: [row['number'] for row in rows if row['outcome'] == name][:LISTED]
                    for name in BAD},
        'changes': {'more than 2': sum(row['changes'] > MOST_CHANGES for row in rows),
                    'most': max((row['changes'] for row in rows), default=0)},
        'attempts': sum(len(row['attempts']) for row in rows),
        'over': sum(bool(one['over']) for row in rows for one in row['attempts']),
        'reliability': [{'from': low, 'to': high, **kept([*rows, *crossable], low, high)}
                        for low, high in zip(EDGES[:-1], EDGES[1:])],
        'crossable': {'approaches': len(crossable), 'outcomes': outcomes(crossable),
                      'by room': by_room(crossable, radius),
                      'missed': [row['number'] for row in crossable
                                 if row['outcome'] != 'over'][:LISTED]},
        'cost': {'mean_ms': float(np.mean(costs)) if costs else None,
                 'first_ms': float(np.median(firsts)) if firsts else None,
                 'per_approach_ms': float(np.mean(whole)) if whole else None}}


def report(campaign: Any, rows: Sequence[Row]) -> Dict[str, Any]:
    """
    Return all figures of a campaign, as JSON takes them.

    Parameters
    ----------
    campaign : Campaign
    rows : sequence of dict
        What `run_campaign` returns.

    """
    radius = campaign.believer().robot.ball_radius
    ordered = sorted(rows, key=lambda row: row['number'])
    planners = {}
    for name in dict.fromkeys(planner for planner, _, _ in campaign.parts):
        mine = [row for row in ordered if row['planner'] == name]
        drawn = [row for row in mine if row['group'] == 'drawn']
        crossable = [row for row in mine if row['group'] == 'crossable']
        planners[name] = {**of_planner(drawn, crossable, radius),
                          'targets': targets(drawn, crossable), 'missed': missed(drawn)}
    return {'seed': campaign.seed, 'kind': campaign.kind, 'sensor': campaign.sensor,
            'required_probability': campaign.required_probability,
            'limits': [list(pair) for pair in campaign.limits], 'planners': planners}
