# SPDX-License-Identifier: Apache-2.0
"""
Compare the accuracy of `max_step_height` with bracketing by complete runs.

    python bench/step_accuracy.py                       # 1,000 random robots, slopes, frictions
    python bench/step_accuracy.py --cases 50 --first 1000 --accuracy 1e-5

Requirement: 99 % within the accuracy, none beyond three times it.  Exit code 1 if missed.
"""
import argparse
from concurrent.futures import ProcessPoolExecutor
from functools import partial
import os
from pathlib import Path
import sys

import numpy as np

ORACLES = Path(__file__).resolve().parent.parent / 'test' / 'oracles'
ACCURACIES = (1e-3, 1e-4, 5e-5, 1e-5)
WITHIN, NEVER = 0.99, 3.0


def main():
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--cases', type=int, default=1000)
    parser.add_argument('--first', type=int, default=0, help='seed of the first one')
    parser.add_argument('--jobs', type=int, default=os.cpu_count() or 1)
    parser.add_argument('--accuracy', type=float, nargs='+', default=ACCURACIES)
    arguments = parser.parse_args()
    sys.path.insert(0, str(ORACLES))
    from crossing_accuracy import shares
    seeds = range(arguments.first, arguments.first + arguments.cases)
    refused, found, spent = {}, {}, []
    with ProcessPoolExecutor(arguments.jobs) as pool:
        results = pool.map(partial(shares, accuracies=arguments.accuracy), seeds, chunksize=5)
        for seed, (result, rest) in zip(seeds, results):
            if result is None:
                refused[seed] = rest
            else:
                found[seed] = result
                spent.append(rest)
    table, kept = np.array(list(found.values())), True
    print(f'{len(found)} cases, {len(refused)} refused')
    for column, accuracy in enumerate(arguments.accuracy):
        values = table[:, column]
        within, most = float(np.mean(values <= 1.0)), float(np.max(values))
        work = np.median([rest[column] for rest in spent], axis=0)
        kept = kept and within >= WITHIN and most <= NEVER
        print(f'{1e3 * accuracy:7g} mm: {100 * within:6.2f} % within, median '
              f'{np.median(values):.3f}, 99 % {np.quantile(values, 0.99):.3f}, worst {most:.3f} '
              f'of it (seed {list(found)[int(np.argmax(values))]}); median {work[0]:.0f} '
              f'attempts, {work[1]:.0f} function evaluations')
    for seed, why in list(refused.items())[:10]:
        print(f'refused, seed {seed}: {why}')
    return 0 if kept else 1


if __name__ == '__main__':
    sys.exit(main())
