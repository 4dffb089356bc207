# SPDX-License-Identifier: Apache-2.0
"""
Maximum step heights of random robots on random ground, compared with bracketing by full runs.

Bisection reduces the bracket to 0.1 um.  Each height takes a full run
(`reference_search.crosses`) with a negligible tolerance: the samples of the run decide, without
early termination and without a score that guides the search.
"""
from dataclasses import fields, replace
import math

import numpy as np
from reference_search import crosses

from ballbot_ros.crossing import cruising, held_at, max_step_height, rolling, Rules, Site
from ballbot_ros.errors import BallbotError
from ballbot_ros.physics import Actuation, load_robot, Solver

REFERENCE = Solver('adaptive', tolerance=1e-11, step=1e-4, models='full')
WIDTH = 1e-7  # of the final bracket [m]
# Units of the parameters that are drawn within a factor of two of the published values.
VARIED = ('kg', 'kg m2', 'N/m', 'N s/m', 'N m s/rad', '1')


def random_crossing(seed):
    """Return robot, speed, actuation, site and rules, which depend only on the seed."""
    draw = np.random.default_rng([1414, seed])
    robot = load_robot(str(draw.choice(['gimball', 'gimball', 'shellball'])))
    robot = replace(robot, **{
        item.name: getattr(robot, item.name) * 2.0**draw.uniform(-1.0, 1.0)
        for item in fields(robot) if item.metadata.get('unit') in VARIED})
    site = Site(draw.uniform(-0.15, 0.15), draw.uniform(-0.2, 0.2),
                *(None if draw.random() < 0.5 else float(draw.uniform(0.02, 0.8))
                  for _ in range(3)))
    rules = Rules(over=str(draw.choice(['edge', 'clear'])))
    speed = float(draw.uniform(0.2, 1.5))
    laws = [Actuation()]
    if robot.has_pendulum:
        laws += [held_at(draw.uniform(-0.5, 2.0)), rolling(robot)(speed)]
        if speed < 1.0:
            laws.append(cruising(robot)(speed))
    return robot, speed, laws[draw.integers(len(laws))], site, rules


def bracketed(crossing, near, span):
    """Return the maximum step height [m] by bisection, initially in `near` +- `span` [m]."""
    robot, speed, actuation, site, rules = crossing

    def passes(height):
        return height <= 0.0 or crosses(robot, speed, height, actuation,
                                        solver=REFERENCE, site=site, rules=rules)
    low, high = near - span, near + span
    while not passes(low):
        low, high, span = low - 4.0 * span, low, 4.0 * span
    while passes(high):
        low, high, span = high, high + 4.0 * span, 4.0 * span
    low = max(low, 0.0)
    while high - low > WIDTH:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if passes(middle) else (low, middle)
    return 0.5 * (low + high)


def shares(seed, accuracies):
    """
    Return the ratio of error to requested accuracy [m] for each accuracy, or None if refused.

    The second value is the attempts and work of each search, or the text of the refusal.
    """
    crossing = random_crossing(seed)
    robot, speed, actuation, site, rules = crossing
    try:
        found = [max_step_height(robot, speed, actuation, accuracy=accuracy, site=site,
                                 rules=rules) for accuracy in accuracies]
        finest = min(found, key=lambda item: item.error)
        exact = bracketed(crossing, finest.height, 2.0 * max(finest.error, WIDTH))
    except BallbotError as refusal:
        return None, str(refusal)
    errors = [max(abs(item.height - exact) - 0.5 * WIDTH, 0.0) for item in found]
    worst = [error / accuracy if math.isfinite(error) else math.inf
             for error, accuracy in zip(errors, accuracies)]
    return worst, [(item.attempts, item.work) for item in found]
