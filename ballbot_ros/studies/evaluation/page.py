# SPDX-License-Identifier: Apache-2.0
"""The report as a page in Markdown, and as a few lines."""
from typing import Any, Dict, List, Sequence

from ballbot_ros.studies.evaluation.judge import OUTCOMES
from ballbot_ros.studies.evaluation.report import BAD, LISTED

Report = Dict[str, Any]

ASKED = 5000  # approaches

INTRODUCTION = """\
# The decision in closed loop

Written by this command, which goes on where it was killed; do not edit it:

```
{command}
```

`--planners {first} --seed {seed} --crossable 0 --only n` shows approach number n with all its
decisions and why they were made. The decisions of an approach with `{first}` took {cost:.1f} s of
processor time in the mean: 5,000 of them are more than some minutes of two cores.

Each approach is a robot drawn from the ranges of its file, with friction of 0.35 to 1.3 of what
the file says, on a drawn ground (steps, thresholds, stairs, drops, walls, bevels, ramps, grooves,
carpets, cords, slopes of -4 to 4 degrees, a drop or a wall behind a step) behind a drawn sensor
(step or terrain sensor; noise reported and not, bias, losses, latency up to 0.5 s, short sight,
heights that grow on approach). The plant is the full model at 500 Hz with the motor's line, under
law (11) with the published gains; observations come at 50 Hz. The decision believes the nominal
robot file. What each outcome is exactly: `ballbot_ros/studies/evaluation/judge.py`.

![Reliability, what went wrong, crossings by room](figures/decision_evaluation.png)

*Drawn by `ballbot evaluate-decision`.*
"""


def row(*cells: object) -> str:
    """Return a line of a table."""
    return f'| {" | ".join(str(cell) for cell in cells)} |'


def head(*cells: str) -> List[str]:
    """Return the first two lines of a table."""
    return [row(*cells), '|' + '---|' * len(cells)]


def mark(met: Any) -> str:
    """Return whether a target is met, in a word."""
    return '-' if met is None else 'met' if met else '**missed**'


def table_of_targets(lines: Sequence[Dict[str, Any]]) -> List[str]:
    """Return the figures beside their targets."""
    return [*head('figure', 'target', 'found', ''),
            *(row(line['figure'], line['target'], line['found'], mark(line['met']))
              for line in lines)]


def table_of_planners(planners: Dict[str, Any]) -> List[str]:
    """Return what came of the approaches, per thousand, a line for each planner."""
    lines = head('planner', 'approaches', *(f'{name} per 1,000' for name in (*OUTCOMES[:2], *BAD)),
                 'crossed of the crossable', 'ms per decision', 'ms of the first')
    for name, one in planners.items():
        total = max(one['approaches'], 1)
        cost = one['cost']
        lines.append(row(
            name, one['approaches'],
            *(f'{1e3 * one["outcomes"].get(outcome, 0) / total:.0f}' for outcome in OUTCOMES[:2]),
            *(f'{one["per thousand"][outcome]:.1f}' for outcome in BAD),
            f'{one["crossable"]["outcomes"].get("over", 0)} of {one["crossable"]["approaches"]}',
            *('-' if cost[key] is None else f'{cost[key]:.2f}' for key in (
                'mean_ms', 'first_ms'))))
    return lines


def table_of_kinds(one: Dict[str, Any]) -> List[str]:
    """Return what came of the approaches to each kind of ground."""
    names = [name for name in (*OUTCOMES, 'raised') if name in one['outcomes']]
    return [*head('ground', *names),
            *(row(kind, *(found.get(name, 0) for name in names))
              for kind, found in one['kinds'].items())]


def table_of_reliability(one: Dict[str, Any]) -> List[str]:
    """Return promised probabilities and what was kept."""
    lines = head('promised', 'attempts', 'mean promise', 'kept', '95 % interval')
    for part in one['reliability']:
        if part['attempts']:
            low, high = part['interval']
            lines.append(row(f'{part["from"]:g} to {min(part["to"], 1.0):g}', part['attempts'],
                             f'{part["promised"]:.3f}', f'{part["kept"]:.3f}',
                             f'{low:.3f} to {high:.3f}'))
    return lines if len(lines) > 2 else ['Nothing was promised.']


def wrong(one: Dict[str, Any]) -> List[str]:
    """Return the numbers of the approaches that went wrong."""
    return [f'* {name}: {", ".join(map(str, numbers))}'
            + (' ...' if len(numbers) == LISTED else '')
            for name, numbers in one['numbers'].items() if numbers]


def page(report: Report, command: str) -> str:
    """
    Return the report as Markdown.

    Parameters
    ----------
    report : dict
        As `report.report` returns it.
    command : str
        That made it.

    """
    planners = report['planners']
    first, one = next(iter(planners.items()))
    missed, hidden = one['missed'], one['hidden']
    cost = 1e-3 * (one['cost']['per_approach_ms'] or 0.0)
    parts = [INTRODUCTION.format(command=command, first=first, seed=report['seed'], cost=cost),
             f'## Targets, with `{first}`\n',
             *table_of_targets(one['targets']), '']
    if one['approaches'] < ASKED:
        parts += [f'These are {one["approaches"]} approaches; {ASKED:,} are asked for.\n']
    if hidden:
        parts += ['Not counted above, for a sensor that sees the next face only cannot show it: '
                  + ', '.join(f'{count} {name}' for name, count in hidden.items())
                  + ', at a face less than `unseen_room` of the decision tuning behind another.\n']
    if one['bumps']:
        parts += [f'Nor are {one["bumps"]} bumps: faces of up to 8 mm that the ball touched '
                  'on its way without a plan.\n']
    parts += ['## Planners on the same approaches\n', *table_of_planners(planners), '']
    parts += [f'## By ground, with `{first}`\n', *table_of_kinds(one), '',
              f'## Promises of `{first}`\n', *table_of_reliability(one), '']
    if missed['searched']:
        parts += [
            '## Missed opportunities\n',
            f'Of {missed["searched"]} approaches to something that could be passed, a search with '
            f'the true robot found a way over {missed["possible"]} (touch at 1.15 m/s or less, '
            f'best start allowed). `{first}` crossed {missed["crossed"]} of them and missed '
            f'{missed["missed"]}: '
            + ', '.join(f'{count} {kind}' for kind, count in missed['by kind'].items())
            + '. The search knows which robot it has and what lies ahead; the decision has to be '
            'sure for all that may be.\n']
    if report['limits']:
        parts += ['## What 23 of 24 robots cross\n', *head('run-up [m]', 'step [mm]'),
                  *(row(f'{run_up:g}', f'{1e3 * height:.1f}')
                    for run_up, height in report['limits']),
                  '', 'All in the same way, from rest, touching at 1.15 m/s or less.\n']
    parts += [f'## Approaches that went wrong with `{first}`\n', *(wrong(one) or ['None.'])]
    if one['crossable']['missed']:
        parts += [f'* crossable, not crossed (`--crossable 1 --only n`): '
                  f'{", ".join(map(str, one["crossable"]["missed"]))}']
    return '\n'.join(parts) + '\n'


def summary(report: Report) -> str:
    """Return what matters most, for a terminal."""
    lines = []
    for name, one in report['planners'].items():
        counts = ', '.join(f'{count} {outcome}' for outcome, count in one['outcomes'].items())
        lines.append(f'{name}: {one["approaches"]} approaches: {counts}')
    first, one = next(iter(report['planners'].items()))
    lines += [f'  {line["figure"]}: {line["found"]} (target {line["target"]}'
              + {None: '', True: ', met', False: ', MISSED'}[line['met']] + ')'
              for line in one['targets']]
    lines += [f'  {name}: {" ".join(map(str, numbers))}'
              for name, numbers in one['numbers'].items() if numbers]
    lines += ['  crossable, not crossed: ' + ' '.join(map(str, one['crossable']['missed']))]
    return '\n'.join(lines)
