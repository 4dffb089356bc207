# SPDX-License-Identifier: Apache-2.0
"""
Estimate numbers of a robot from a recorded run: least squares, and what the data leave open.

The run is simulated from a scene; samples of all channels are compared, each divided by the
noise of its channel.  That noise is first guessed from second differences, and then taken from
the residuals, with which the fit is repeated.

Intervals come from the Jacobian at the solution.  Its singular values, for relative changes of
the numbers, say how well each combination of numbers is determined: a combination that may
change by more than `VAGUE` (or its starting value, for a number that may be 0) without the
residuals showing it is not determined, and neither is a number that takes part in it.
"""
from dataclasses import replace
import math
from operator import attrgetter
from typing import Any, Callable, Dict, List, Mapping, NamedTuple, Sequence, Tuple

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import chi2, qmc, t as student

from ballbot_ros.config.fields import suggestion
from ballbot_ros.errors import BallbotError, ConfigurationError
from ballbot_ros.physics import Scene
from ballbot_ros.physics.model.named_parameters import described, MOTOR, ROBOT, with_parameters
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.simulation.scene import Initial
from ballbot_ros.studies.progress import ignore
from ballbot_ros.studies.recording import Recording, replay

VAGUE = 0.5   # relative standard deviation of a combination that is not determined
SHARE = 0.05  # part that a number takes in such a combination, to be not determined
CONFIDENCE = 0.95
STEP = 1e-4   # relative, for the Jacobian
STARTS, REACH = 8, 0.5  # beside the given numbers: how many, and how far away, relative
FAR = 1e3     # sigmas that a sample counts as where a trial cannot be simulated
INITIAL = described(Initial, 'initial.')
NUMBERS = {**ROBOT, **MOTOR, **INITIAL}


class ParameterEstimate(NamedTuple):
    """One number; SI, but for angles of the start in degrees."""

    name: str
    unit: str
    start: float
    value: float
    low: float  # ends of the confidence interval; NaN where it is not determined
    high: float
    determined: bool


class Identification(NamedTuple):
    """
    What was found.

    ``vague`` lists combinations that the data do not determine, each as relative changes
    that belong together; ``singular_values`` are those of the scaled Jacobian.  ``rivals`` are
    other numbers that explain the run as well, found from other starts.
    """

    estimates: List[ParameterEstimate]
    vague: List[Dict[str, float]]
    rivals: List[Dict[str, float]]
    singular_values: List[float]
    noise: Dict[str, float]
    residuals: Dict[str, Array]
    runs: int


def with_values(scene: Scene, values: Mapping[str, float]) -> Scene:
    """
    Return a scene with other numbers of robot, motor and start.

    Raises
    ------
    ConfigurationError
        If a number is unknown or out of range.

    """
    for name in values:
        check_known(scene, name)
    robot = with_parameters(scene.model.robot, values)
    start: Dict[str, Any] = {
        name[len('initial.'):]: value for name, value in values.items() if name in INITIAL}
    return replace(scene, model=replace(scene.model, robot=robot),
                   initial=replace(scene.initial, **start))


def check_known(scene: Scene, name: str) -> None:
    """Refuse a number that is unknown, or that the robot does not have."""
    if name not in NUMBERS:
        raise ConfigurationError(
            f'identify: {name!r} is no number that can be estimated{suggestion(name, NUMBERS)}')
    if name in MOTOR and scene.model.robot.motor is None:
        raise ConfigurationError(f'identify: robot {scene.model.robot.name!r} has no motor')


def present(scene: Scene, name: str) -> float:
    """Return the number that a scene has."""
    owner = scene if name in INITIAL else scene.model.robot
    return float(attrgetter(name)(owner) or 0.0)


def identify(scene: Scene, recording: Recording, names: Sequence[str], use_torque: bool = False,
             progress: Callable[[int], None] = ignore) -> Identification:
    """
    Estimate numbers of a scene from a recording.

    Parameters
    ----------
    scene : Scene
        What was run, with the best guess of all numbers.
    recording : Recording
    names : sequence of str
        Fields of the robot, ``motor.`` or ``initial.`` and a field of those.
    use_torque : bool
        Apply the recorded torque instead of the law of the scene.
    progress : callable, optional
        Called with the number of simulations so far.

    Raises
    ------
    ConfigurationError
        If a number is unknown, or is estimated twice.
    SimulationError
        If the scene itself cannot be simulated.

    """
    if not names or len(set(names)) < len(names):
        raise ConfigurationError('identify: name the numbers to estimate, each of them once')
    for name in names:
        check_known(scene, name)
    starts = np.array([present(scene, name) for name in names])
    # Where a number is 0 there is no relative change: it counts in its own unit.
    scales = np.where(starts != 0.0, np.abs(starts), 1.0)
    runs = 0

    def differences(shift: Array) -> Dict[str, Array]:
        nonlocal runs
        runs += 1
        progress(runs)
        trial = dict(zip(names, (starts + scales * shift).tolist()))
        found = replay(with_values(scene, trial), recording, use_torque)
        return {name: found[name] - values
                for name, (_, values) in recording.channels.items()}

    first = differences(np.zeros(len(names)))  # raises where the scene itself is at fault
    noise = {name: _roughness(values, first[name])
             for name, (_, values) in recording.channels.items()}
    low, high = _bounds(names, starts, scales)
    samples = sum(len(values) for _, values in recording.channels.values())

    def weighed(trial: Array) -> Array:
        try:
            found = differences(trial)
        except BallbotError:  # out of range, or too far from anything that rolls
            return np.full(samples, FAR)
        return np.concatenate([found[name] / noise[name] for name in noise])

    def fitted(begin: Array) -> Any:
        return least_squares(weighed, begin, bounds=(low, high), x_scale='jac', jac='3-point',
                             diff_step=STEP, max_nfev=100)
    # Several valleys may lead down: begin on either side, too, and keep the deepest.
    around = (2.0 * qmc.Sobol(len(names), seed=0).random(STARTS) - 1.0) * REACH
    fits = [fitted(np.clip(begin, low, high)) for begin in (np.zeros(len(names)), *around)]
    others = fits
    for _ in range(2):
        shift = min(fits, key=lambda fit: fit.cost).x
        rest = differences(shift)
        noise = {name: max(float(np.sqrt(np.mean(values**2))), 1e-12 * (1.0 + np.ptp(values)))
                 for name, values in rest.items()}
        fits = [fit := fitted(shift)]
        shift = fit.x
    estimates, vague, singular = _judge(
        names, starts, scales, shift, fit.jac, float(np.sum(fit.fun**2)))
    # A rival is far away for its interval, but not worse than chance may make it.
    least, away = min(other.cost for other in others), 3.0 * (
        np.array([item.high - item.low for item in estimates]) / scales)
    worth = chi2.ppf(CONFIDENCE, len(names)) * least / max(samples - len(names), 1)
    sure = np.array([item.determined for item in estimates])
    rivals = [dict(zip(names, (starts + scales * other.x).tolist())) for other in others
              if other.cost < least + worth and (np.abs(other.x - shift) > away)[sure].any()]
    return Identification(estimates, vague, rivals, singular, noise, differences(shift), runs)


def _roughness(values: Array, gap: Array) -> float:
    """Return a first guess of the noise of a channel, from second differences."""
    rough = np.median(np.abs(np.diff(values, 2))) / (0.6745 * math.sqrt(6.0))
    return max(float(rough), 1e-6 * float(np.ptp(values)), 1e-3 * float(np.std(gap)), 1e-12)


def _bounds(names: Sequence[str], starts: Array, scales: Array) -> Tuple[Array, Array]:
    """Return how far each number may go, as relative changes."""
    low, high = [], []
    for name, start, scale in zip(names, starts, scales):
        item = NUMBERS[name]
        least = max(item['minimum'], item['above'] + 1e-6 * scale)
        low.append(max((least - start) / scale, -1e6))
        high.append(min((item['maximum'] - start) / scale, 1e6))
    # A start on its bound would leave no room for a first step.
    return np.minimum(np.array(low), -1e-9), np.maximum(np.array(high), 1e-9)


def _judge(names: Sequence[str], starts: Array, scales: Array, shift: Array, jacobian: Array,
           misfit: float) -> tuple[Any, ...]:
    """Return estimates with intervals, vague combinations and singular values."""
    values = starts + scales * shift
    # Per relative change of the number found; of one that is 0, per unit.
    weights = np.where(np.abs(values) > 1e-9 * scales, np.abs(values), scales)
    free = max(len(jacobian) - len(names), 1)
    scatter = max(math.sqrt(misfit / free), 1e-9)
    _, singular, directions = np.linalg.svd(
        jacobian * (weights / scales) / scatter, full_matrices=False)
    spread = 1.0 / np.maximum(singular, 1e-300)
    vague = [{name: round(float(part), 3) for name, part in zip(names, direction)
              if abs(part) > SHARE}
             for direction, width in zip(directions, spread) if width > VAGUE]
    blurred = {name for combination in vague for name in combination}
    good = spread <= VAGUE
    deviation = np.sqrt(np.sum((directions[good].T * spread[good])**2, axis=1))
    margin = student.ppf(0.5 * (1.0 + CONFIDENCE), free) * deviation * weights
    estimates = []
    for name, start, value, wide in zip(names, starts, values, margin):
        sure = name not in blurred
        unit = NUMBERS[name]['unit']
        estimates.append(ParameterEstimate(
            name, unit, float(start), float(value), float(value - wide) if sure else math.nan,
            float(value + wide) if sure else math.nan, sure))
    return estimates, vague, singular.tolist()
