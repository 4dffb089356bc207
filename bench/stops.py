# SPDX-License-Identifier: Apache-2.0
"""
Random stops of the full model against the distance that the safety filter predicts.

``python bench/stops.py [COUNT [SEED]]`` prints how many were longer than predicted, and the worst.
"""
import sys

import numpy as np

from ballbot_ros.studies.evaluation.run import NominalModel
from ballbot_ros.studies.evaluation.stops import random_stop


def main(count=10_000, seed=0):
    """Print the margins of the predicted distance."""
    nominal = NominalModel()
    stops = [random_stop(nominal, seed, number) for number in range(count)]
    spare = np.array([stop.predicted - stop.rolled for stop in stops])
    print(f'{count} random stops, seed {seed}: {np.sum(spare < 0.0)} longer than predicted')
    for number in np.argsort(spare)[:5]:
        stop = stops[number]
        print(f'  stop {number}: {stop.speed:.2f} m/s on {np.degrees(stop.slope):+.1f} degrees, '
              f'predicted {stop.predicted:.3f} m, rolled {stop.rolled:.3f} m')
    print('  predicted minus rolled [m], 1 / 10 / 50 / 90 %: ' + ' / '.join(
        f'{value:.3f}' for value in np.percentile(spare, (1, 10, 50, 90))))


if __name__ == '__main__':
    main(*map(int, sys.argv[1:]))
