# SPDX-License-Identifier: Apache-2.0
"""
Draw docs/figures/work_precision.png from docs/bench.json, which precision.py writes.

Also prints the table of ratios, and the function evaluations of each solver for 1 um.

    .venv/bin/python bench/figures.py
"""
import json
import math
from pathlib import Path
from statistics import median

from curves import honest
import documents
import matplotlib.pyplot as plt

DOCS = Path(__file__).resolve().parents[1] / 'docs'

PANELS = {'near_critical': 'GimBall just gets over a step, 1 s',
          'shellball_step': 'ShellBall hits a 30 mm step, 1 s',
          'roll_60_s': 'GimBall rolls on a floor, 60 s'}
# Colour and width of a curve; ours is the most visible.
CURVES = {'adaptive': ('#c0392b', 2.4), 'rk4': ('#e08e0b', 1.6),
          'semi_implicit': ('#b59b5b', 1.6), 'SciPy LSODA': ('#1f5fa8', 1.4),
          'SciPy DOP853': ('#6a9bd8', 1.2), 'CVODE BDF': ('#2e8b57', 1.4)}
LABELS = {'adaptive': 'ours, adaptive', 'rk4': 'ours, rk4',
          'semi_implicit': 'ours, semi-implicit'}


def spent(point, quantity):
    """Return wall time [ms] or function evaluations of a run."""
    return point['calls'] if quantity == 'calls' else 1e3 * median(point['times'])


def draw(axes, curves, quantity):
    """Draw the curves of one scene: cost against the worst error of all finer runs."""
    for name, (colour, width) in CURVES.items():
        curve = curves.get(name, [])
        points = [(error, spent(point, quantity))
                  for (error, _, _), point in zip(honest(curve), reversed(curve))
                  if 1e-8 <= error <= 0.3]
        if points:
            axes.loglog([1e3 * error for error, _ in points], [cost for _, cost in points],
                        color=colour, lw=width, marker='o', ms=width + 1.2, mec='white', mew=0.4,
                        label=LABELS.get(name, name), zorder=3 if name == 'adaptive' else 2)
    for level, text in ((1e-1, '0.1 mm'), (1e-3, '1 µm')):
        axes.axvline(level, color='#bbbbbb', lw=0.8, zorder=1)
        axes.text(level, 1.0, text, transform=axes.get_xaxis_transform(), ha='center',
                  va='bottom', fontsize=7.5, color='#666666')


def spread(values):
    """Return median, minimum and maximum of ratios as text for a table."""
    def short(value):
        return f'{value:.3g}' if value < 1000.0 else f'{value:.0f}'
    return f'{short(median(values))} ({short(min(values))}-{short(max(values))})'


def ratio_table(ratios):
    """Return the table of the ratio of each solver's time to ours, for the document."""
    rows = []
    cells = {(item['solver'], item['error']): item['scenes'] for item in ratios}
    for solver in dict.fromkeys(item['solver'] for item in ratios):
        line = [solver]
        for level in (1e-4, 1e-6):
            scenes = {name: values for name, values in cells.get((solver, level), {}).items()
                      if not math.isnan(values[0])}
            critical, many = scenes.get('near_critical'), 'near_critical' in cells.get(
                (solver, level), {})
            line.append(spread(critical) if critical else 'not reached' if many else '')
            all_of = len(cells.get((solver, level), {}))
            note = '' if len(scenes) == all_of else f'{len(scenes)} of {all_of}: '
            medians = [median(values) for values in scenes.values()]
            line.append(note + spread(medians) if medians else 'none')
        if solver != 'adaptive':
            rows.append(line)
    return documents.table(['solver', '0.1 mm, critical', '0.1 mm, scenes', '1 um, critical',
                            '1 um, scenes'], rows)


def main():
    stored = json.loads((DOCS / 'bench.json').read_text())
    scenes = stored['scenes']
    plt.rcParams.update({'font.size': 9, 'axes.spines.top': False, 'axes.spines.right': False,
                         'svg.hashsalt': 'ballbot_ros'})
    figure, rows = plt.subplots(2, len(PANELS), figsize=(10.5, 7.2), sharex=True, sharey='row')
    for row, quantity in zip(rows, ('times', 'calls')):
        for axes, scene in zip(row, PANELS):
            draw(axes, scenes[scene]['curves'], quantity)
            axes.set_xlim(3e2, 1e-5)  # better to the right
            axes.grid(True, which='major', color='#eeeeee', lw=0.7)
    for axes, title in zip(rows[0], PANELS.values()):
        axes.set_title(title, fontsize=10, pad=16)
    for axes in rows[1]:
        axes.set_xlabel('error of the end position [mm]')
    rows[0][0].set_ylabel('wall time of the run [ms]')
    rows[1][0].set_ylabel('function evaluations of the run')
    handles, labels = rows[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc='lower center', ncol=4, frameon=False, fontsize=8.5)
    figure.tight_layout(rect=(0, 0.07, 1, 1))
    figure.savefig(DOCS / 'figures' / 'work_precision.png', dpi=160)
    print(ratio_table(stored['ratios']))
    for scene, entry in scenes.items():
        calls = {name: [point['calls'] for (error, _, _), point in zip(
            honest(curve), reversed(curve)) if error <= 1e-6]
            for name, curve in entry['curves'].items()}
        print(f'{scene:20}' + ', '.join(
            f'{name} {min(calls[name])}' for name in CURVES if calls.get(name)))


if __name__ == '__main__':
    main()
