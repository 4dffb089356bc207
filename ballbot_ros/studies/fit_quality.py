# SPDX-License-Identifier: Apache-2.0
"""
Quality of a fit: whether the residuals are noise, and the uncertainty of the parameters.

An interval from least squares assumes residuals of independent noise.  Three violations of this
are tested: a model that is not that of the run (large residuals), one that leaves something
out (residuals correlated over time), and the error of the integration, which noise-free
data show.
"""
import math
from typing import Any, Dict, List, Mapping, NamedTuple, Sequence, Tuple

import numpy as np
from scipy.special import chdtrc, stdtrit

from ballbot_ros.physics.model.terrain import Array

VAGUE_DEVIATION = 0.5   # relative standard deviation of a combination that is not determined
VAGUE_SHARE = 0.05  # part that a number takes in such a combination, to be not determined
CONFIDENCE = 0.95
# Residual RMS over the standard deviation of the channel, from which a fit explains nothing.
POOR_RESIDUAL = 0.2
NOISE_FACTOR = 5.0   # times the noise of the channel that residuals are above, to be no noise
WHITENESS_LEVEL = 1e-4  # false alarm probability of the correlation test
LAGS = 20
INTEGRATION_FACTOR = 3.0  # multiple of the maximum integration error, no warning below it
BIAS_FACTOR = 2.0    # times the estimated shift by integration that an interval includes


class ChannelFit(NamedTuple):
    """
    How well a channel is explained; residual RMS and motion in the unit of the channel.

    ``correlation`` is the number of samples that count as one, 1 for independent noise.
    ``verdict`` is ``'good'``, ``'correlated'`` or ``'poor'``.
    """

    residual_rms: float
    motion: float  # standard deviation of the measurements
    correlation: float
    verdict: str


class ParameterEstimate(NamedTuple):
    """One parameter; SI, except angles of the start in degrees."""

    name: str
    unit: str
    start: float
    value: float
    low: float  # ends of the confidence interval; NaN where it is not determined
    high: float
    determined: bool


def channel_fit(measured: Array, residual: Array, roughness: float,
                integration: float) -> ChannelFit:
    """
    Judge the residuals of a channel.

    Parameters
    ----------
    measured, residual : (n,) arrays
    roughness : float
        Noise that second differences of the measurement show.
    integration : float
        Largest error of the simulated channel.

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

    Parameters
    ----------
    starts, scales, shift : (k,) arrays
        The numbers found are ``starts + scales * shift``.
    fit : with ``jac`` (n, k) and ``fun`` (n,)
        Residuals over their noise, at the solution.
    error : (m, n) array
        Errors of integration over the noise, in place of the residuals: a row per kind.
    channels : mapping of str to (samples, ChannelFit)
        In the order of the residuals.

    """
    values = starts + scales * shift
    # Per relative change of the number found; of one that is 0, per unit.
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
