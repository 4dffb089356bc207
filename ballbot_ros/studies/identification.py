# SPDX-License-Identifier: Apache-2.0
"""
Estimate parameters of a robot from a recorded run by least squares, with confidence intervals.

The run is simulated from a scene; the residuals of all channels are divided by the noise of their
channel.  This noise is first estimated from second differences, then from the residuals, and the
fit is repeated with it.

Intervals come from the Jacobian at the solution.  Its singular values, for relative changes of
the parameters, measure how well each combination of parameters is determined: a combination that
may change by more than `VAGUE_DEVIATION` (or its starting value, for a parameter that may be 0)
without a change of the residuals is not determined, and neither are its parameters.

An interval from least squares assumes residuals of independent noise.  Three violations of this
are tested: a wrong model (large residuals), an incomplete model (residuals correlated over time),
and the integration error, which is visible in noise-free data.
"""
from dataclasses import replace
import math
from operator import attrgetter
from typing import Any, Callable, Dict, List, Mapping, NamedTuple, Sequence, Tuple
import warnings

import numpy as np
from scipy.optimize import least_squares, OptimizeResult
from scipy.special import chdtrc, chdtri, stdtrit

from ballbot_ros.config.fields import suggestion
from ballbot_ros.errors import BallbotError, ConfigurationError, PlausibilityWarning
from ballbot_ros.physics import Scene
from ballbot_ros.physics.model.robot import described, MOTOR, ROBOT, with_parameters
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.simulation.scene import Initial
from ballbot_ros.physics.simulation.solver import Solver
from ballbot_ros.results.units import CONVERSIONS, SI
from ballbot_ros.studies.progress import ignore
from ballbot_ros.studies.recording import GRID, Recording, replay, SOLVER

# Parameters that can be estimated: of the robot, its motor and the initial state.
INITIAL = described(Initial, 'initial.')
NUMBERS = {**ROBOT, **MOTOR, **INITIAL}

VAGUE_DEVIATION = 0.5   # relative standard deviation of a combination that is not determined
VAGUE_SHARE = 0.05  # component in such a combination above which a parameter is not determined
CONFIDENCE = 0.95
# Residual RMS over the standard deviation of the channel, above which a fit is poor.
POOR_RESIDUAL = 0.2
NOISE_FACTOR = 5.0   # multiple of the channel noise, above which residuals are not noise
WHITENESS_LEVEL = 1e-4  # false alarm probability of the correlation test
LAGS = 20
INTEGRATION_FACTOR = 3.0  # multiple of the maximum integration error that causes no warning
BIAS_FACTOR = 2.0    # multiple of the estimated integration bias that an interval includes


class ChannelFit(NamedTuple):
    """
    Goodness of fit of a channel; residual RMS and motion in the unit of the channel.

    ``correlation`` is the number of samples per independent sample, 1 for independent noise.
    ``verdict`` is ``'good'``, ``'correlated'`` or ``'poor'``.
    """

    residual_rms: float
    motion: float  # standard deviation of the measurements
    correlation: float
    verdict: str


class ParameterEstimate(NamedTuple):
    """One parameter, in SI units, except initial angles in degrees."""

    name: str
    unit: str
    start: float
    value: float
    low: float  # ends of the confidence interval; NaN if not determined
    high: float
    determined: bool


def channel_fit(measured: Array, residual: Array, roughness: float,
                integration: float) -> ChannelFit:
    """
    Judge the residuals of a channel, (n,) each.

    `roughness` is the noise estimated from second differences of the measurement, `integration`
    the largest integration error of the simulated channel.
    """
    rms, motion = float(np.sqrt(np.mean(residual**2))), float(np.std(measured))
    correlation = _samples_per_independent(residual)
    if rms > POOR_RESIDUAL * motion and rms > NOISE_FACTOR * roughness:
        verdict = 'poor'
    elif correlation > 1.0 and rms > INTEGRATION_FACTOR * integration:
        verdict = 'correlated'
    else:
        verdict = 'good'
    return ChannelFit(rms, motion, correlation, verdict)


def _samples_per_independent(residual: Array) -> float:
    """Return the number of samples per independent sample; 1 for white noise."""
    number = len(residual)
    power = np.abs(np.fft.rfft(residual, 2 * number))**2
    products = np.fft.irfft(power)[:number]
    if not products[0] > 0.0:
        return 1.0
    rho = products / products[0]
    lags = np.arange(1, min(LAGS, number // 4) + 1)
    portmanteau = number * (number + 2) * float(np.sum(rho[lags]**2 / (number - lags)))
    if chdtrc(len(lags), portmanteau) > WHITENESS_LEVEL:
        return 1.0
    negative = np.flatnonzero(rho <= 0.0)
    until = int(negative[0]) if len(negative) else number
    return min(max(1.0 + 2.0 * float(np.sum(rho[1:until])), 1.0), 0.5 * number)


def judge(names: Sequence[str], units: Sequence[str], starts: Array, scales: Array, shift: Array,
          fit: Any, error: Array, channels: Mapping[str, Tuple[int, ChannelFit]],
          ) -> Tuple[List[ParameterEstimate], List[Dict[str, float]], List[float]]:
    """
    Return estimates with intervals, vague combinations and singular values.

    The estimates are ``starts + scales * shift``, (k,) each.  `fit` has the residuals over their
    noise, (n,), and their Jacobian, (n, k), at the solution; `error` has a row per kind of
    integration error over the noise, (m, n).  The channels, each with its number of samples, are
    in the order of the residuals.
    """
    values = starts + scales * shift
    # Per relative change of an estimate; per unit if the estimate is 0.
    weights = np.where(np.abs(values) > 1e-9 * scales, np.abs(values), scales)
    alike = np.concatenate([np.full(count, item.correlation) for count, item in channels.values()])
    free = max(float(np.sum(1.0 / alike)) - len(names), 1.0)
    scatter = max(math.sqrt(float(np.sum(fit.fun**2)) / max(len(alike) - len(names), 1)), 1e-9)
    left, singular, directions = np.linalg.svd(
        fit.jac * (weights / scales) / scatter, full_matrices=False)
    spread = 1.0 / np.maximum(singular, 1e-300)
    good = spread <= VAGUE_DEVIATION
    inverse = (directions[good].T * spread[good]) @ left[:, good].T
    deviation = np.sqrt(np.sum(inverse**2 * alike, axis=1))
    vague = [{name: round(float(part), 3) for name, part in zip(names, direction)
              if abs(part) > VAGUE_SHARE}
             for direction, width in zip(directions, spread)
             if width * math.sqrt(float(alike.max())) > VAGUE_DEVIATION]
    blurred = {name for combination in vague for name in combination}
    # Shift by the integration error, and the remaining step of the search.
    bias = BIAS_FACTOR * np.abs(inverse @ (np.vstack([error, fit.fun]) / scatter).T).sum(axis=1)
    margin = (stdtrit(free, 0.5 * (1.0 + CONFIDENCE)) * deviation + bias) * weights
    trusted = all(item.verdict != 'poor' for _, item in channels.values())
    estimates = []
    for name, unit, start, value, wide in zip(names, units, starts, values, margin):
        sure = trusted and name not in blurred
        estimates.append(ParameterEstimate(
            name, unit, float(start), float(value), float(value - wide) if sure else math.nan,
            float(value + wide) if sure else math.nan, sure))
    return estimates, vague, singular.tolist()


JACOBIAN_STEP = 1e-4   # relative, for the Jacobian
STARTS, START_RANGE = 8, 0.5  # additional starts: number, and relative distance from the guess
SAME_SOLUTION = 1e-3   # relative difference below which two solutions are the same
REFINEMENTS = 2  # fits from the best values, with the noise of the residuals
FIT_COUNT = 1 + STARTS + REFINEMENTS
FAILED_RESIDUAL = 1e3     # residual of each sample if a trial cannot be simulated [sigmas]


# Unit of a channel -> unit of values that are often labelled with it.
MISLABELLED = {'s': 'ms', 'm': 'mm', 'm/s': 'mm/s', 'rad': 'deg', 'rad/s': 'deg/s'}
UNIT_TOLERANCE = 0.3  # of the logarithm of the factor between two units


class Identification(NamedTuple):
    """
    Result of an identification.

    ``vague`` lists combinations that are not identifiable from the data, each as relative changes
    of the parameters; ``singular_values`` are those of the scaled Jacobian.  ``rivals`` are other
    values that fit the run equally well, found from other starts, without duplicates.  If the fit
    of a channel is poor, no parameter is determined.  ``interrupted``: Ctrl-C ended the search;
    the values are the best found until then.
    """

    estimates: List[ParameterEstimate]
    vague: List[Dict[str, float]]
    rivals: List[Dict[str, float]]
    singular_values: List[float]
    noise: Dict[str, float]
    residuals: Dict[str, Array]
    channels: Dict[str, ChannelFit]
    runs: int
    interrupted: bool


def identify(scene: Scene, recording: Recording, names: Sequence[str], use_torque: bool = False,
             progress: Callable[[float], None] = ignore) -> Identification:
    """
    Estimate parameters of a scene from a recording.

    The scene is that of the recording, with the best guess of all parameters; `names` are fields
    of the robot, or ``motor.FIELD`` or ``initial.FIELD``.  With `use_torque`, the recorded torque
    replaces the law of the scene.  `progress` receives the number of finished fits, of
    `FIT_COUNT`.  Ctrl-C ends the search and returns the best values found until then.

    Raises `ConfigurationError` if a parameter is unknown or named twice, or a channel is in
    another unit, and `SimulationError` if the scene itself cannot be simulated.
    """
    if not names or len(set(names)) < len(names):
        raise ConfigurationError(
            'identify: name the parameters to estimate, each of them once', 'inconsistent',
            'parameters')
    check_known(scene, names)
    search = _Search(scene, recording, names, use_torque, progress)
    interrupted = False
    with warnings.catch_warnings():
        # Trial values may be implausible.
        warnings.simplefilter('ignore', PlausibilityWarning)
        search.start()
        try:
            search.look_around()
            search.refine()
        except KeyboardInterrupt:
            interrupted = True
        found = search.conclude(interrupted)
    # Warns of implausible estimates.
    with_values(scene, {item.name: item.value for item in found.estimates})
    return found


class _Search:
    """Fits from several starts; the best values are available at any time."""

    def __init__(self, scene: Scene, recording: Recording, names: Sequence[str],
                 use_torque: bool, progress: Callable[[float], None]):
        self.scene, self.recording, self.names = scene, recording, names
        self.use_torque, self.progress = use_torque, progress
        self.starts = np.array([present(scene, name) for name in names])
        # A parameter of 0 has no relative change: its changes are in its own unit.
        self.scales = np.where(self.starts != 0.0, np.abs(self.starts), 1.0)
        self.low, self.high = bounds(names, self.starts, self.scales)
        self.runs, self.fits, self.noise, self.others = 0, 0, dict[str, float](), list[Any]()
        self.rough: Dict[str, float] = {}
        self.best: Array = np.zeros(len(names))
        self.least = math.inf

    def simulated(self, shift: Array, solver: Solver = SOLVER, grid: float = GRID,
                  ) -> Dict[str, Array]:
        """Return all channels, simulated with changed values."""
        self.runs += 1
        trial = dict(zip(self.names, (self.starts + self.scales * shift).tolist()))
        return replay(with_values(self.scene, trial), self.recording, self.use_torque, solver,
                      grid)

    def differences(self, shift: Array) -> Dict[str, Array]:
        """Return simulated minus measured values."""
        found = self.simulated(shift)
        return {name: found[name] - values
                for name, (_, values) in self.recording.channels.items()}

    def weighed(self, shift: Array) -> Array:
        """Return all residuals over their noise, and store the best values."""
        try:
            found = self.differences(shift)
        except BallbotError:  # out of range, or not possible to simulate
            number = sum(len(values) for _, values in self.recording.channels.values())
            return np.full(number, FAILED_RESIDUAL)
        fun = np.concatenate([found[name] / self.noise[name] for name in self.noise])
        cost = float(fun @ fun)
        if cost < self.least:
            self.best, self.least = np.array(shift), cost
        return fun

    def fitted(self, start: Array) -> Any:
        """Return the fit from one start, and report it to `progress`."""
        fit = least_squares(
            self.weighed, start, bounds=(self.low, self.high), x_scale='jac', jac='3-point',
            diff_step=JACOBIAN_STEP, max_nfev=100)
        self.fits += 1
        self.progress(self.fits)
        return fit

    def start(self) -> None:
        """Estimate the noise; raises if the scene fails or a unit of the recording is wrong."""
        check_units({'time': (self.recording.duration, self.scene.run.duration)})
        first = self.differences(self.best)
        check_units({name: (np.ptp(values), np.ptp(values + first[name]))
                     for name, (_, values) in self.recording.channels.items()})
        self.rough = {name: _roughness(values, 0.0 * values)
                      for name, (_, values) in self.recording.channels.items()}
        self.noise = {name: _roughness(values, first[name])
                      for name, (_, values) in self.recording.channels.items()}

    def look_around(self) -> None:
        """Also fit from starts around the guess, because there may be several local minima."""
        from scipy.stats import qmc
        around = (2.0 * qmc.Sobol(len(self.names), seed=0).random(STARTS) - 1.0) * START_RANGE
        for start in (np.zeros(len(self.names)), *around):
            self.others.append(self.fitted(np.clip(start, self.low, self.high)))

    def refine(self) -> None:
        """Fit again from the best values, with the noise of the residuals."""
        for _ in range(REFINEMENTS):
            self.reweigh()
            self.fitted(self.best)

    def reweigh(self) -> None:
        """Estimate the noise from the residuals of the best values."""
        self.noise = {name: max(float(np.sqrt(np.mean(values**2))), 1e-12 * (1.0 + np.ptp(values)))
                      for name, values in self.differences(self.best).items()}
        self.least = math.inf
        self.weighed(self.best)

    def at_best(self) -> OptimizeResult:
        """Return residuals and Jacobian at the best values."""
        shift = self.best.copy()
        fun, columns = self.weighed(shift), []
        for place in range(len(self.names)):
            ends = [np.array(shift), np.array(shift)]
            for end, sign in zip(ends, (-1.0, 1.0)):
                step = JACOBIAN_STEP * max(1.0, abs(shift[place]))
                end[place] = np.clip(
                    shift[place] + sign * step, self.low[place], self.high[place])
            low, high = map(self.weighed, ends)
            columns.append((high - low) / (ends[1][place] - ends[0][place]))
        return OptimizeResult(x=shift, fun=fun, jac=np.stack(columns, axis=1))

    def integration_error(self, shift: Array) -> List[Dict[str, Array]]:
        """
        Return the largest integration error of the fit, and of the solver of the scene.

        A recording of the simulator contains the latter.
        """
        here = self.simulated(shift)
        finer = self.simulated(shift, replace(SOLVER, tolerance=0.01 * SOLVER.tolerance),
                               0.5 * GRID)
        others = [finer]
        # An accuracy selects another solver for each run.
        own = self.scene.model.solver_in_use if self.scene.run.accuracy is None else None
        if not self.use_torque and own is not None:
            step = own.step if own.fixed else GRID
            try:
                others.append(self.simulated(shift, own, step * math.ceil(GRID / step - 1e-9)))
            except BallbotError:
                pass  # too coarse for these values
        return [{name: values - here[name] for name, values in other.items()} for other in others]

    def conclude(self, interrupted: bool) -> Identification:
        if interrupted:
            self.reweigh()
        fit = self.at_best()
        shift, residuals = fit.x, self.differences(fit.x)
        errors = self.integration_error(shift)
        channels = {name: channel_fit(values, residuals[name], self.rough[name], max(
            float(np.max(np.abs(error[name]))) for error in errors))
            for name, (_, values) in self.recording.channels.items()}
        estimates, vague, singular = judge(
            self.names, [NUMBERS[name]['unit'] for name in self.names], self.starts, self.scales,
            shift, fit,
            np.array([np.concatenate([error[name] / self.noise[name] for name in self.noise])
                      for error in errors]),
            {name: (len(residuals[name]), item) for name, item in channels.items()})
        return Identification(
            estimates, vague, self.rivals(shift, estimates), singular,
            {name: item.residual_rms for name, item in channels.items()}, residuals, channels,
            self.runs, interrupted)

    def rivals(self, shift: Array, estimates: Sequence[ParameterEstimate],
               ) -> List[Dict[str, float]]:
        """Return other solutions: outside of the intervals, and not significantly worse."""
        sure = np.array([item.determined for item in estimates])
        if not self.others or not sure.any():
            return []
        width = np.array([item.high - item.low for item in estimates]) / self.scales
        away = np.maximum(3.0 * width, SAME_SOLUTION * np.maximum(np.abs(
            self.starts / self.scales + shift), SAME_SOLUTION))[sure]
        samples = sum(len(values) for _, values in self.recording.channels.values())
        least = min(other.cost for other in self.others)
        worth = chdtri(len(self.names), 1.0 - CONFIDENCE) * least / max(
            samples - len(self.names), 1)
        known, found = [shift], []
        for other in sorted(self.others, key=lambda fit: float(fit.cost)):
            if other.cost < least + worth and all(
                    (np.abs(other.x - one)[sure] > away).any() for one in known):
                known.append(other.x)
                found.append(dict(zip(
                    self.names, (self.starts + self.scales * other.x).tolist())))
        return found


def check_units(ranges: Mapping[str, Tuple[float, float]]) -> None:
    """
    Refuse columns whose range differs from that of the scene by the factor of another unit.

    `ranges` has the range of each column in the recording and in the scene.  Raises
    `ConfigurationError` naming the column and the likely unit.
    """
    problems, suspects = [], []
    for name, (measured, simulated) in ranges.items():
        unit = SI[name]
        other = MISLABELLED[unit]
        factor = 1.0 / CONVERSIONS[other][1]
        if measured > 0.0 < simulated and abs(
                math.log(measured / simulated / factor)) < UNIT_TOLERANCE:
            suspects.append(name)
            problems.append(
                f'{name} varies by {measured:.3g} {unit}, in the scene by {simulated:.3g} '
                f'{unit}, a factor of about {factor:.3g}; is the column in {other}? Then label it '
                f'"{name} [{other}]"')
    if problems:
        raise ConfigurationError('recording: ' + '; '.join(problems), 'out_of_range', suspects[0])


def _roughness(values: Array, gap: Array) -> float:
    """Return a first estimate of the noise of a channel, from second differences."""
    rough = np.median(np.abs(np.diff(values, 2))) / (0.6745 * math.sqrt(6.0))
    return max(float(rough), 1e-6 * float(np.ptp(values)), 1e-3 * float(np.std(gap)), 1e-12)


def with_values(scene: Scene, values: Mapping[str, float]) -> Scene:
    """Return a scene with other values; raises `ConfigurationError` if one is out of range."""
    check_known(scene, list(values))
    robot = with_parameters(scene.model.robot, values)
    start: Dict[str, Any] = {
        name[len('initial.'):]: value for name, value in values.items() if name in INITIAL}
    return replace(scene, model=replace(scene.model, robot=robot),
                   initial=replace(scene.initial, **start))


def check_known(scene: Scene, names: Sequence[str]) -> None:
    """Refuse parameters that are unknown, or that the robot does not have; name all of them."""
    unknown = [name for name in names if name not in NUMBERS]
    if unknown:
        raise ConfigurationError(
            'identify: ' + '; '.join(f'{name!r} is not a parameter that can be estimated'
                                     f'{suggestion(name, NUMBERS)}' for name in unknown),
            'unknown_name', unknown[0])
    motor = [name for name in names if name in MOTOR]
    if motor and scene.model.robot.motor is None:
        raise ConfigurationError(
            f'identify: robot {scene.model.robot.name!r} has no motor, so it has no '
            f'{", ".join(motor)}', 'inconsistent', motor[0])


def present(scene: Scene, name: str) -> float:
    """Return the value of a parameter in a scene."""
    owner = scene if name in INITIAL else scene.model.robot
    return float(attrgetter(name)(owner) or 0.0)


def bounds(names: Sequence[str], starts: Array, scales: Array) -> Tuple[Array, Array]:
    """Return the bounds of each parameter, as relative changes."""
    low, high = [], []
    for name, start, scale in zip(names, starts, scales):
        item = NUMBERS[name]
        least = max(item['minimum'], item['above'] + 1e-6 * scale)
        low.append(max((least - start) / scale, -1e6))
        high.append(min((item['maximum'] - start) / scale, 1e6))
    # A start on its bound would leave no room for a first step.
    return np.minimum(np.array(low), -1e-9), np.maximum(np.array(high), 1e-9)
