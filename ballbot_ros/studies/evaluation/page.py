# SPDX-License-Identifier: Apache-2.0
"""The report as a page in Markdown, and as a few lines."""
import textwrap
from typing import Any, Dict, List, Mapping

from ballbot_ros.studies.evaluation.approaches import UNSEEN_ROOM
from ballbot_ros.studies.evaluation.report import BAD, GOOD, LISTED
from ballbot_ros.studies.evaluation.terrains import KINDS
from ballbot_ros.studies.targets import table_of_targets
from ballbot_ros.table import markdown

Report = Dict[str, Any]

APPROACHES = 5000  # of a complete evaluation

INTRODUCTION = """\
# Evaluation of the decision in closed loop

This command writes the page and resumes an interrupted run; do not edit the page:

```
{command}
```

An approach took {cpu:.2f} s of processor time on average, so that {complete:,} approaches take
{minutes:.0f} min on two cores without the searches with the true robot. `--planners {first}
--seed {seed} --crossable 0 --only n` prints the decisions of approach number n with their reasons.

Each approach is a robot drawn from the ranges of its file, with 0.3 to 1.3 times the friction of
the file, on a drawn terrain:
{kinds};
on slopes of -4 to 4 degrees. The sensor is a step sensor, a
terrain sensor with equally spaced points or a camera with rays at equal angles (eye 0 to 0.4 m
above the ball's centre), ideal, degraded (noise, bias, losses, latency up to 0.5 s, short range),
with up to 10 % outliers, with reordered messages, or frozen with advancing stamps. In half of the
approaches, `unseen_room` is {unseen:g} m and the terrain has at least this length of floor behind
each edge; in the others, it is 0. In half of all approaches, the floor behind the start ends in a
drop exactly at `room_behind`. The plant is the full model at 500 Hz with the motor's torque-speed
line, under law (11) with the published gains; observations arrive at 50 Hz. The decision assumes
the nominal robot file. `ballbot_ros/studies/evaluation/outcome.py` defines the outcomes.

![Reliability, failures, crossings by room](figures/decision_evaluation.png)

*Drawn by `ballbot evaluate-decision`.*
"""


def table_of_planners(planners: Mapping[str, Any]) -> List[str]:
    """Return the outcomes of each planner per thousand approaches."""
    titles = ('planner', 'approaches', *(f'{name} per 1,000' for name in (*GOOD, *BAD)),
              'crossed of the crossable steps', 'mean CPU ms per decision', 'worst CPU ms')
    return markdown(titles, ((
        name, one['approaches'],
        *(f'{1e3 * one["outcomes"].get(outcome, 0) / max(one["approaches"], 1):.0f}'
          for outcome in GOOD),
        *(f'{one["per thousand"][outcome]:.1f}' for outcome in BAD),
        f'{one["crossable"]["outcomes"].get("over", 0)} of {one["crossable"]["approaches"]}',
        *('-' if one['cost'][key] is None else f'{one["cost"][key]:.2f}' for key in (
            'mean_ms', 'worst_ms'))) for name, one in planners.items()))


def table_of_groups(title: str, groups: Mapping[str, Any]) -> List[str]:
    """Return the figures by kind of terrain, sensor or condition."""
    names = [name for name in (*GOOD, *BAD)
             if any(name in one['outcomes'] for one in groups.values())]
    titles = (title, 'approaches', *names, 'attempts', 'predicted', 'observed', 'same plan again',
              'more than 2 changes', 'crossed of possible')
    return markdown(titles, ((
        name, one['approaches'], *(one['outcomes'].get(key, 0) for key in names), one['attempts'],
        *('-' if one[key] is None else f'{one[key]:.3f}' for key in ('predicted', 'observed')),
        one['same'], one['changes'],
        f'{one["crossed"]} of {one["possible"]}' if one['possible'] else '-')
        for name, one in groups.items()))


def table_of_reliability(one: Mapping[str, Any]) -> List[str]:
    """Return predicted and observed success rates."""
    rows = [(f'{part["from"]:g} to {min(part["to"], 1.0):g}', part['attempts'],
             f'{part["predicted"]:.3f}', f'{part["observed"]:.3f}',
             '{:.3f} to {:.3f}'.format(*part['interval']))
            for part in one['reliability'] if part['attempts']]
    return markdown(('predicted', 'attempts', 'mean prediction', 'observed', '95 % interval'),
                    rows) if rows else ['No predictions.']


def failures(one: Mapping[str, Any]) -> List[str]:
    """Return the numbers of the failed approaches."""
    return [f'* {name}: {", ".join(map(str, numbers))}'
            + (' ...' if len(numbers) == LISTED else '')
            for name, numbers in one['numbers'].items() if numbers]


def page(report: Report, command: str) -> str:
    """Return the report of `report.report` as Markdown, with the command that writes it."""
    planners = report['planners']
    first, one = next(iter(planners.items()))
    missed = one['missed']
    kinds = textwrap.fill(', '.join(name.replace('_', ' ') for name in KINDS), 99)
    cpu = one['cost']['cpu_s'] or 0.0
    parts = [INTRODUCTION.format(command=command, first=first, seed=report['seed'], kinds=kinds,
                                 unseen=UNSEEN_ROOM, cpu=cpu, complete=APPROACHES,
                                 minutes=APPROACHES * cpu / 120.0),
             f'## Targets, with `{first}`\n', *table_of_targets(one['targets']), '']
    if one['approaches'] < APPROACHES:
        parts += [f'This run has {one["approaches"]} approaches; a complete one has '
                  f'{APPROACHES:,}.\n']
    if one['bumps']:
        parts += [f'Not counted as hits: {one["bumps"]} faces of up to 8 mm that the ball touched '
                  'without a plan.\n']
    parts += ['## Planners on the same approaches\n', *table_of_planners(planners), '']
    for title, key in (('terrain', 'kinds'), ('sensor', 'sensors'), ('condition', 'conditions')):
        parts += [f'## By {title}, with `{first}`\n', *table_of_groups(title, one[key]), '']
    parts += [f'## Predicted and observed success rate of `{first}`\n',
              *table_of_reliability(one), '']
    if missed['searched']:
        parts += [
            '## False refusals\n',
            f'Of {missed["searched"]} approaches to an obstacle that may be crossed (a step down '
            'of up to `highest_descent`) and that the sensor detects without freezing, with floor '
            'behind it that the sensor observes or `unseen_room` guarantees, a search '
            f'with the true robot crosses {missed["possible"]} (touch at 1.15 m/s or less, best '
            f'allowed start). `{first}` crossed {missed["crossed"]} of them and did not cross '
            f'{missed["missed"]}: '
            + ', '.join(f'{count} {kind}' for kind, count in missed['by kind'].items())
            + '. The search uses the true robot and terrain; the decision has to be safe for all '
            'possible robots and terrains.\n']
    if report['limits']:
        parts += ['## Maximum step height of 23 of 24 robots\n',
                  *markdown(('run-up [m]', 'step [mm]'), (
                      (f'{run_up:g}', f'{1e3 * height:.1f}')
                      for run_up, height in report['limits'])),
                  '', 'All robots use one manoeuvre from rest, with at most 1.15 m/s at touch.\n']
    parts += [f'## Failed approaches of `{first}`\n', *(failures(one) or ['None.'])]
    if one['crossable']['missed']:
        parts += [f'* crossable, not crossed (`--crossable 1 --only n`): '
                  f'{", ".join(map(str, one["crossable"]["missed"]))}']
    return '\n'.join(parts) + '\n'


def summary(report: Report) -> str:
    """Return the main figures, for a terminal."""
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
    if one['crossable']['missed']:
        lines += ['  crossable, not crossed: ' + ' '.join(map(str, one['crossable']['missed']))]
    return '\n'.join(lines)
