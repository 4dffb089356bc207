# SPDX-License-Identifier: Apache-2.0
"""
Steps at an angle: remaining fraction of the maximum height, and course afterwards.

`height_factor` reads the table of GimBall for every robot.  The factor is close to the square of
the cosine of the angle, as in the planar model if the maximum height grows with the square of the
speed normal to the edge; the changes of course and heading are those of GimBall.
"""
from dataclasses import dataclass
import functools
import math
from typing import Any, Sequence

import numpy as np

from ballbot_ros.config.fields import Checked, section, SOURCES, text
from ballbot_ros.config.files import load_config
from ballbot_ros.errors import ConfigurationError


@dataclass(frozen=True)
class ObliqueSteps(Checked):
    """Results over several speeds and pendulum angles, by the angle between path and normal."""

    robot: str = text('name of the robot')
    source: str = text('origin of the numbers', choices=SOURCES)
    angles_deg: Sequence[float] = section('angles, increasing from 0 [deg]')
    lowest_factor: Sequence[float] = section('smallest maximum height over that at 0, by angle')
    highest_factor: Sequence[float] = section('largest maximum height over that at 0, by angle')
    height_shares: Sequence[float] = section('heights over the maximum height at the angle')
    lowest_course_change_deg: Sequence[Sequence[float]] = section(
        'smallest turn of the direction of travel away from the normal, by angle and share [deg]')
    highest_course_change_deg: Sequence[Sequence[float]] = section('the largest turn [deg]')
    lowest_heading_change_deg: Sequence[Sequence[float]] = section(
        'smallest turn of the heading, after damping by the steering law [deg]')
    highest_heading_change_deg: Sequence[Sequence[float]] = section('the largest turn [deg]')

    def __post_init__(self) -> None:
        super().__post_init__()
        angles, shares = self._numbers('angles_deg', 1), self._numbers('height_shares', 1)
        for name, values in (('angles_deg', angles), ('height_shares', shares)):
            if len(values) < 2 or (np.diff(values) <= 0.0).any() or values[0] < 0.0:
                raise ConfigurationError(
                    f'ObliqueSteps: {name} must be at least two increasing numbers from 0 on, got '
                    f'{getattr(self, name)!r}', 'inconsistent', name)
        both = len(angles), len(shares)
        for name, shape in (('lowest_factor', angles.shape), ('highest_factor', angles.shape),
                            ('lowest_course_change_deg', both),
                            ('highest_course_change_deg', both),
                            ('lowest_heading_change_deg', both),
                            ('highest_heading_change_deg', both)):
            if self._numbers(name, len(shape)).shape != shape:
                raise ConfigurationError(
                    f'ObliqueSteps: {name} must have the shape {shape} of angles_deg and '
                    f'height_shares, got {getattr(self, name)!r}', 'wrong_length', name)

    def _numbers(self, name: str, dimensions: int) -> Any:
        try:
            values = np.array(getattr(self, name), dtype=float)
        except (TypeError, ValueError):
            values = np.array(math.nan)
        if values.ndim != dimensions or not np.isfinite(values).all():
            raise ConfigurationError(
                f'ObliqueSteps: {name} must be a table of finite numbers, got '
                f'{getattr(self, name)!r}', 'wrong_type', name)
        return values


@functools.lru_cache(maxsize=8)
def load_oblique_steps(name_or_path: str = 'gimball') -> ObliqueSteps:
    """
    Read a table of the package by the name of its robot, or a custom file.

    Raises `ConfigurationError` naming file, field, value and allowed range.
    """
    return load_config(ObliqueSteps, 'oblique', name_or_path)


def height_factor(angle: float) -> float:
    """
    Return the lowest maximum height at an angle, relative to that at right angles to the edge.

    The angle is that between the path and the normal of the edge, to either side [rad].  Beyond
    the largest angle of the table the factor is 0: such a crossing is not permitted.
    """
    table = load_oblique_steps()
    degrees = abs(math.degrees(math.remainder(angle, 2.0 * math.pi)))
    if not degrees <= table.angles_deg[-1] + 1e-9:
        return 0.0
    return float(np.interp(degrees, table.angles_deg, table.lowest_factor))
