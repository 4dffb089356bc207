# SPDX-License-Identifier: Apache-2.0
"""Counts of the outcomes of approaches, and their comparison with the targets."""
from collections import Counter
import math
from typing import Any, Dict, List, Sequence, Tuple

import numpy as np
from scipy.special import betaincinv

from ballbot_ros.decision import nominal_knowledge
from ballbot_ros.studies.evaluation.evaluation import Evaluation, Row
from ballbot_ros.studies.evaluation.outcome import OUTCOMES
from ballbot_ros.studies.evaluation.sensors import KINDS as SENSORS
from ballbot_ros.studies.targets import target

GENTLE = math.radians(3.0)  # slopes on which no fall is allowed
PROBABILITY_TOLERANCE = 0.02  # of a predicted probability
EDGES = (0.0, 0.5, 0.7, 0.8, 0.875, 0.925, 0.97, 1.0 + 1e-9)  # of the reliability diagram
# Predicted probabilities, and the range of predictions that counts as each.
PREDICTIONS = tuple(zip((0.9, 0.95, 0.99), EDGES[4:], EDGES[5:]))
HITS = 1e-3                 # allowed per approach
CHANGES, CHANGES_RUNS = 2, 0.99  # allowed number, and fraction of runs that must not exceed it
CROSSED, OF = 150, 160
SEARCH_PART = 0.8           # fraction of the crossings that the search with the true robot finds
CORRELATION = 0.8           # of predicted with true margin
ROOMS = (0.15, 0.4, 0.65, 1.0, 1.5, 2.5)  # before the step [m]
LISTED = 20  # listed failed approaches
GOOD, BAD = OUTCOMES[:2], (*OUTCOMES[2:], 'raised')


def interval(good: int, total: int) -> Tuple[float, float]:
    """Return the Clopper-Pearson interval of a probability, at 95 %."""
    return (float(betaincinv(good, total - good + 1, 0.025)) if good > 0 else 0.0,
            float(betaincinv(good + 1, total - good, 0.975)) if good < total else 1.0)


def success(rows: Sequence[Row], low: float, high: float) -> Dict[str, Any]:
    """Return number, predicted and observed success rate of attempts in a range of predictions."""
    attempts = [one for row in rows for one in row['attempts']
                if one['probability'] is not None and low <= one['probability'] < high]
    total, over = len(attempts), sum(one['over'] for one in attempts)
    found: Dict[str, Any] = {'attempts': total, 'over': over}
    if total:
        found['predicted'] = float(np.mean([one['probability'] for one in attempts]))
        found['observed'] = over / total
        found['interval'] = interval(over, total)
    return found


def gentle_falls(rows: Sequence[Row]) -> List[Row]:
    """Return the falls on slopes on which no fall is allowed."""
    return [row for row in rows if row['outcome'] == 'fell' and abs(row['slope']) <= GENTLE]


def targets(rows: Sequence[Row], crossable: Sequence[Row]) -> List[Dict[str, Any]]:
    """Return the figures of the first planner and their targets."""
    every = [*rows, *crossable]
    slopes = sum(abs(row['slope']) <= GENTLE for row in rows)
    falls, hits = len(gentle_falls(rows)), sum(row['outcome'] == 'hit' for row in rows)
    lines = [
        target('falls, slopes within 3 degrees', '0', f'{falls} of {slopes}', not falls),
        target('hits above 0.1 m/s while not crossing', '1 in 1,000', f'{hits} of {len(rows)}',
               hits <= HITS * len(rows))]
    # Without the crossable steps: they are selected because most robots succeed.
    for sensor in SENSORS:
        lines += predictions(sensor, [row for row in rows if row['sensor'] == sensor])
    crossed = sum(row['outcome'] == 'over' for row in crossable)
    lines.append(target(
        'crossings of steps that 23 of 24 robots can cross (<= 1.15 m/s, best allowed start)',
        f'{CROSSED} of {OF}', f'{crossed} of {len(crossable)}',
        crossed * OF >= CROSSED * len(crossable) if crossable else None))
    for kind in ('step_down', 'trench'):
        one = missed([row for row in rows if row['kind'] == kind])
        lines.append(target(
            f'{kind} with observed or guaranteed floor behind it: crossings relative to the '
            'search with the true robot', '80 %',
            f'{one["crossed"]} of {one["possible"]}',
            one['crossed'] >= SEARCH_PART * one['possible'] if one['possible'] else None))
    again = sum(one['same'] for row in every for one in row['attempts'])
    lines.append(target('same plan again after a failure', 'never', str(again), again == 0))
    counts = [row['changes'] for row in every]
    more = sum(count > CHANGES for count in counts)
    lines.append(target(
        f'runs with more than {CHANGES} decision changes without new information', '1 in 100',
        f'{more} of {len(counts)}; at most {max(counts, default=0)}',
        more <= (1.0 - CHANGES_RUNS) * len(counts)))
    # The crossable steps are close to the maximum height, so their margins differ little.
    for steps, part in (('drawn steps', rows), ('crossable steps', crossable)):
        number, correlation = margin_correlation(part)
        lines.append(target(
            f'correlation of height_margin with the true margin, {steps}', 'above 0.8',
            f'{correlation:.2f} of {number}' if number > 2 else 'not measured',
            correlation > CORRELATION if number > 2 else None))
    return lines


def predictions(sensor: str, rows: Sequence[Row]) -> List[Dict[str, Any]]:
    """Return predicted and observed success rates for a kind of sensor."""
    lines = []
    for prediction, low, high in PREDICTIONS:
        found = success(rows, low, high)
        text, met = 'no such prediction', None
        if found['attempts']:
            text = (f'predicted {found["predicted"]:.3f}, observed {found["observed"]:.3f} '
                    f'({found["interval"][0]:.3f} to {found["interval"][1]:.3f}; {found["over"]} '
                    f'of {found["attempts"]})')
            met = abs(found['observed'] - found['predicted']) <= PROBABILITY_TOLERANCE
        lines.append(target(f'{sensor} sensor, predicted {prediction:g}: observed', 'within 2 %',
                            text, met))
    return lines


def margin_correlation(rows: Sequence[Row]) -> Tuple[int, float]:
    """Return the number of steps with both margins, crossed or refused, and the correlation."""
    pairs = [(one['height_margin'], one['true_margin']) for row in rows
             for one in (*row['attempts'], row)
             if one.get('height_margin') is not None and one.get('true_margin') is not None]
    if len(pairs) < 3 or min(np.ptp(pairs, axis=0)) == 0.0:
        return len(pairs), math.nan
    return len(pairs), float(np.corrcoef(np.transpose(pairs))[0, 1])


def missed(rows: Sequence[Row]) -> Dict[str, Any]:
    """Return the numbers of obstacles that the search crosses and that the planner missed."""
    searched = [row for row in rows if 'possible' in row]
    could = [row for row in searched if row['possible']]
    refused = [row for row in could if row['outcome'] != 'over']
    return {'searched': len(searched), 'possible': len(could),
            'crossed': len(could) - len(refused), 'missed': len(refused),
            'by kind': dict(Counter(row['kind'] for row in refused)),
            'numbers': [row['number'] for row in refused[:LISTED]]}


def outcomes(rows: Sequence[Row]) -> Dict[str, int]:
    """Return the number of each outcome."""
    found = Counter(row['outcome'] for row in rows)
    return {name: found[name] for name in (*GOOD, *BAD) if found[name]}


def by_room(rows: Sequence[Row], radius: float) -> List[Dict[str, Any]]:
    """Return the number of crossable steps that were crossed, by the room before them."""
    found = []
    for low, high in zip(ROOMS[:-1], ROOMS[1:]):
        here = [row for row in rows if low <= row['foot'] - radius < high]
        found.append({'from': low, 'to': high, 'approaches': len(here),
                      'over': sum(row['outcome'] == 'over' for row in here)})
    return found


def group_counts(rows: Sequence[Row]) -> Dict[str, Any]:
    """Return the figures of one kind of terrain, sensor or condition."""
    attempts = [one for row in rows for one in row['attempts']]
    found, rates = missed(rows), success(rows, 0.0, math.inf)
    return {
        'approaches': len(rows), 'outcomes': outcomes(rows), 'falls': len(gentle_falls(rows)),
        'attempts': len(attempts),
        'predicted': rates.get('predicted'), 'observed': rates.get('observed'),
        'same': sum(one['same'] for one in attempts),
        'changes': sum(row['changes'] > CHANGES for row in rows),
        'possible': found['possible'], 'crossed': found['crossed']}


def by(rows: Sequence[Row], key: str) -> Dict[str, Any]:
    """Return the figures of the groups of rows with equal values of a key."""
    return {name: group_counts([row for row in rows if row[key] == name])
            for name in sorted({row[key] for row in rows})}


def planner_figures(rows: Sequence[Row], crossable: Sequence[Row],
                    radius: float) -> Dict[str, Any]:
    """Return the figures of one planner."""
    total = max(len(rows), 1)
    decided = [row for row in rows if row.get('decisions')]
    return {
        'approaches': len(rows), 'outcomes': outcomes(rows),
        'per thousand': {name: 1e3 * sum(row['outcome'] == name for row in rows) / total
                         for name in BAD},
        'bumps': sum(row.get('bumps', 0) for row in rows),
        'kinds': by(rows, 'kind'), 'sensors': by(rows, 'sensor'),
        'conditions': by(rows, 'condition'),
        'numbers': {name: [row['number'] for row in rows if row['outcome'] == name][:LISTED]
                    for name in BAD},
        'reliability': [{'from': low, 'to': high, **success(rows, low, high)}
                        for low, high in zip(EDGES[:-1], EDGES[1:])],
        'crossable': {'approaches': len(crossable), 'outcomes': outcomes(crossable),
                      'by room': by_room(crossable, radius),
                      'missed': [row['number'] for row in crossable
                                 if row['outcome'] != 'over'][:LISTED]},
        'cost': {name: float(function([row[name] for row in decided])) if decided else None
                 for name, function in (('mean_ms', np.mean), ('worst_ms', np.max),
                                        ('cpu_s', np.mean))},
        'targets': targets(rows, crossable), 'missed': missed(rows)}


def report(evaluation: Evaluation, rows: Sequence[Row]) -> Dict[str, Any]:
    """Return all figures of an evaluation with the rows of `run_evaluation`, as JSON values."""
    radius = nominal_knowledge().robot.ball_radius
    ordered = sorted(rows, key=lambda row: row['number'])
    planners = {}
    for name in dict.fromkeys(planner for planner, _, _ in evaluation.parts):
        own = [row for row in ordered if row['planner'] == name]
        planners[name] = planner_figures(
            [row for row in own if row['group'] == 'drawn'],
            [row for row in own if row['group'] == 'crossable'], radius)
    return {'seed': evaluation.seed, 'kind': evaluation.kind, 'sensor': evaluation.sensor,
            'limits': [list(pair) for pair in evaluation.limits], 'planners': planners}
