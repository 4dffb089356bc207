# SPDX-License-Identifier: Apache-2.0
"""
Simulate maximum step heights, and fit and write the cubics of the decision.

**Fit**: least squares, and nowhere flatter than `LEAST_SLOPE`.  **Conservative**: the highest
cubic below all simulated heights minus their errors, at speeds so close that it stays below the
heights between them; a linear program.  **Band**: the maximum heights of many robots drawn from
the ranges of the uncertain parameters.
"""
from dataclasses import asdict, dataclass
import itertools
import json
import math
import textwrap
from typing import Any, Callable, Dict, Optional, Sequence, Tuple

import numpy as np
from scipy.optimize import linprog, minimize
import yaml

from ballbot_ros import __version__
from ballbot_ros.config.fields import Checked, count, quantity
from ballbot_ros.crossing import actuation_for, max_step_height, Rules
from ballbot_ros.crossing.max_step_height import parallel_searches
from ballbot_ros.decision.planning.curve import Band, CurveProvenance, HeightCurve
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics import Actuation, Robot
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.model.uncertainty import draw, uncertain
from ballbot_ros.studies.progress import ignore

LEAST_SLOPE = 1e-4  # of a curve [s]
PROBABILITIES = (0.0, 0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99, 1.0)
CONSERVATIVE_DENSITY = 8  # conservative heights for each one that is fitted
BAND_SPEEDS = 11  # speeds of the band
LAWS = ('free', 'position', 'velocity', 'voltage')


@dataclass(frozen=True)
class Request(Checked):
    """Range of speeds, accuracy of the heights, and number of robots to draw."""

    lowest_speed: float = quantity('m/s', 'slowest speed', default=0.2, above=0.0)
    highest_speed: float = quantity('m/s', 'fastest speed', default=1.2, above=0.0)
    points: int = count('number of fitted speeds', default=21, minimum=6, maximum=1000)
    accuracy: float = quantity(
        'm', 'largest error of a simulated height', default=2e-6, minimum=1e-8, maximum=1e-3)
    samples: int = count('robots drawn for the band; 0 for no band', default=256, maximum=100_000)
    seed: int = count('seed of the draw', default=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.lowest_speed < self.highest_speed:
            raise ConfigurationError(
                f'Request: highest_speed must be more than lowest_speed '
                f'({self.lowest_speed:g} m/s), got {self.highest_speed:g} m/s',
                'inconsistent', 'highest_speed')
        if self.samples == 1:
            raise ConfigurationError(
                'Request: samples must be 0, or at least 2, got 1', 'out_of_range', 'samples')


def dense_points(request: Request) -> int:
    """Return the number of heights that determine the conservative curve."""
    return CONSERVATIVE_DENSITY * (request.points - 1) + 1


def heights_for(robot: Robot, request: Request) -> int:
    """Return the number of heights that will be simulated."""
    return dense_points(request) + (BAND_SPEEDS * request.samples if uncertain(robot) else 0)


def fit_curve(name: str, robot: Robot, actuation: Actuation, wording: str,
              request: Request = Request(), rules: Rules = Rules(over='clear'),
              progress: Callable[[int], None] = ignore) -> HeightCurve:
    """
    Simulate and fit a curve with a name.

    The set rate of the actuation follows the speed, and so does its voltage if it is 0; `wording`
    is the actuation as text.  By default, the rules are those of decisions: a ball is over when it
    is clear of the edge.  `progress` receives the number of finished heights, of `heights_for`.
    Raises `ConfigurationError` if no rising cubic can be fitted, or an argument is out of range,
    and `SimulationError` as `max_step_height` does.
    """
    if actuation.law not in LAWS:
        raise ConfigurationError(
            f'fit_curve: law must be one of {", ".join(LAWS)}, got {actuation.law!r}',
            'not_a_choice', 'law')
    low, high = request.lowest_speed, request.highest_speed
    dense: Array = np.array(np.linspace(low, high, dense_points(request)).round(12), float)
    done = itertools.count(1)

    def find(item: Tuple[Robot, float]) -> Tuple[float, float]:
        found = max_step_height(item[0], item[1], actuation_for(item[0], actuation)(item[1]),
                                accuracy=request.accuracy, rules=rules)
        return found.height, found.error

    def all_of(robots: Sequence[Robot], speeds: Array) -> Array:
        rows = []
        for row in parallel_searches(
                find, [(each, float(speed)) for each in robots for speed in speeds]):
            rows.append(row)
            progress(next(done))
        return np.array(rows).reshape(len(robots), len(speeds), 2)

    heights, errors = all_of([robot], dense)[0].T
    speeds, points = dense[::CONSERVATIVE_DENSITY], heights[::CONSERVATIVE_DENSITY]
    coefficients = monotone_cubic(speeds, points)
    residuals = np.polyval(coefficients[::-1], speeds) - points
    powers = np.vander(speeds, 4, increasing=True)
    covariance = (residuals @ residuals / (len(speeds) - 4) * np.linalg.inv(powers.T @ powers))
    band = None
    if uncertain(robot) and request.samples:
        sparse: Array = np.array(np.linspace(low, high, BAND_SPEEDS).round(12), float)
        drawn = all_of(draw(robot, request.samples, request.seed), sparse)[:, :, 0]
        quantiles = np.maximum.accumulate(
            np.quantile(drawn, PROBABILITIES, axis=0).T.round(6), axis=1)
        band = Band(request.samples, request.seed,
                    {key: list(ends) for key, ends in uncertain(robot).items()},
                    tuple(sparse.tolist()), PROBABILITIES, tuple(map(tuple, quantiles.tolist())))
    # The residual is rounded up: it is a bound.
    return HeightCurve(
        name, robot.name, wording,
        f're-simulated, eqs. (4) to (13); {len(speeds)} points', low, high,
        math.ceil(1e6 * float(np.max(np.abs(residuals)))) / 1e6,
        round(float(np.sqrt(np.mean(residuals**2))), 7), tuple(coefficients.tolist()),
        tuple(conservative_cubic(dense, heights - errors).tolist()),
        tuple(map(tuple, covariance.tolist())),
        CurveProvenance(
            robot.digest, actuation.law, robot.surface_friction, robot.edge_friction,
            rules.attempts, request.accuracy, len(speeds), __version__,
            actuation.set_angle if actuation.law == 'position' else 0.0,
            actuation.voltage if actuation.law == 'voltage' else 0.0,
            rules.over, rules.beyond), band)


def monotone_cubic(speeds: Array, heights: Array) -> Array:
    """
    Return the coefficients a0 to a3 of the least-squares cubic that rises over its entire range.

    Raises `ConfigurationError` if there is none.
    """
    powers = np.vander(speeds, 4, increasing=True)
    best: Array = np.linalg.lstsq(powers, heights, rcond=None)[0]
    slopes = slope_rows(speeds[0], speeds[-1])
    if (slopes @ best < LEAST_SLOPE).any():
        scale = max(float(np.ptp(heights)), 1e-6)
        found = minimize(
            lambda a: np.sum(((powers @ a - heights) / scale)**2), best,
            jac=lambda a: 2.0 * powers.T @ (powers @ a - heights) / scale**2, method='SLSQP',
            constraints={'type': 'ineq', 'fun': lambda a: (slopes @ a - LEAST_SLOPE) / scale,
                         'jac': lambda _: slopes / scale},
            options={'maxiter': 500, 'ftol': 1e-12})
        best = found.x
        if not (slopes @ best > 0.5 * LEAST_SLOPE).all():
            raise ConfigurationError(
                'no rising cubic fits these heights; narrow the range of speeds',
                'inconsistent', 'highest_speed')
    return best


def conservative_cubic(speeds: Array, heights: Array) -> Array:
    """
    Return the coefficients of the highest rising cubic that exceeds no height.

    Speeds [m/s] are evenly and closely spaced; heights [m] are lower bounds of the simulated ones.

    Raises `ConfigurationError` if there is none.
    """
    powers = np.vander(speeds, 4, increasing=True)
    slopes = slope_rows(speeds[0], speeds[-1])
    # A smooth curve sags below its chord by an eighth of its second difference.
    sag = 0.125 * np.max(np.abs(np.diff(heights, 2)), initial=0.0)
    found = linprog(
        -powers.sum(axis=0), np.vstack([powers, -slopes]),
        np.concatenate([heights - sag, np.full(len(slopes), -LEAST_SLOPE)]),
        bounds=(None, None))
    if not found.success:
        raise ConfigurationError(
            'no rising cubic stays below these heights; narrow the range of speeds',
            'inconsistent', 'highest_speed')
    # A margin for the rounding of the solver.
    return np.array([found.x[0] - 1e-7, *found.x[1:]])


def slope_rows(low: float, high: float) -> Array:
    """Return the matrix from coefficients to slopes over a range of speeds [m/s]."""
    speeds = np.linspace(low, high, 201)
    return np.stack([0.0 * speeds, 1.0 + 0.0 * speeds, 2.0 * speeds, 3.0 * speeds**2], axis=1)


HEADER = """\
Maximum step height of {robot}, as a cubic of the collision speed: height = a0 + a1 v + a2 v^2 +
a3 v^3, in m and m/s.  Valid from lowest_speed to highest_speed only.

The coefficients called conservative are those of a cubic that is nowhere above the simulation.
"""
BAND = 'The band holds the maximum step heights of robots drawn from the ranges of the derived ' \
    'parameters.\n'


def curve_text(curve: HeightCurve, robot: str, writer: str) -> str:
    """
    Return the content of a curve file; `writer` is the program that writes it.

    `robot` names the robot and its actuation, for example ``GimBall with a free pendulum``.
    """
    text = HEADER.format(robot=robot) + (BAND if curve.band else '') + f'\nWritten by {writer}.'
    comment = '\n#\n'.join('# ' + '\n# '.join(textwrap.wrap(part, 95))
                           for part in text.split('\n\n'))
    content = {name: value for name, value in asdict(curve).items() if value not in (None, ())}
    coefficients: Dict[str, Any] = {
        name: [round(number, 9) for number in content.pop(name)]
        for name in ('coefficients', 'conservative') if name in content}
    if 'covariance' in content:
        coefficients['covariance'] = [[float(f'{number:.4g}') for number in row]
                                      for row in content.pop('covariance')]
    made, band = content.pop('made', None), content.pop('band', None)

    def dump(part: Any, flow: Optional[bool] = None) -> str:
        lists = json.loads(json.dumps(part))  # YAML has no tuples
        return str(yaml.safe_dump(lists, sort_keys=False, default_flow_style=flow, width=99))

    blocks = [dump(content, False), dump(coefficients)]
    blocks += [dump({'made': made}, False)] if made else []
    blocks += [dump({'band': band})] if band else []
    return comment + '\n' + ''.join(blocks)
