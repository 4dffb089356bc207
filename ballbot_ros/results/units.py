# SPDX-License-Identifier: Apache-2.0
"""Units of columns in files, and their conversion to SI."""
import math
from typing import Mapping, Tuple

from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.simulation.trajectory import UNITS

# SI unit of each column.
SI: Mapping[str, str] = {**UNITS, 'joint_angle': 'rad', 'joint_rate': 'rad/s'}

# Unit -> SI unit and factor.
CONVERSIONS: Mapping[str, Tuple[str, float]] = {
    's': ('s', 1.0), 'ms': ('s', 1e-3), 'us': ('s', 1e-6), '\N{MICRO SIGN}s': ('s', 1e-6),
    'ns': ('s', 1e-9), 'min': ('s', 60.0),
    'm': ('m', 1.0), 'cm': ('m', 1e-2), 'mm': ('m', 1e-3),
    'm/s': ('m/s', 1.0), 'cm/s': ('m/s', 1e-2), 'mm/s': ('m/s', 1e-3), 'km/h': ('m/s', 1.0 / 3.6),
    'rad': ('rad', 1.0), 'mrad': ('rad', 1e-3), 'deg': ('rad', math.pi / 180.0),
    '\N{DEGREE SIGN}': ('rad', math.pi / 180.0), 'rev': ('rad', math.tau),
    'rad/s': ('rad/s', 1.0), 'deg/s': ('rad/s', math.pi / 180.0),
    '\N{DEGREE SIGN}/s': ('rad/s', math.pi / 180.0), 'rev/s': ('rad/s', math.tau),
    'rpm': ('rad/s', math.tau / 60.0),
    'N': ('N', 1.0), 'J': ('J', 1.0),
    'N m': ('N m', 1.0), 'Nm': ('N m', 1.0), 'N*m': ('N m', 1.0), 'mN m': ('N m', 1e-3),
    'mNm': ('N m', 1e-3)}


def in_si(name: str, values: Array, unit: str) -> Array:
    """
    Return a column with the given unit in SI units; a column that is not in `SI` is unchanged.

    Raises `ConfigurationError` if the unit does not fit the column; the message lists the valid
    units.
    """
    wanted = SI.get(name)
    if wanted is None or unit == wanted:
        return values
    kind, factor = CONVERSIONS.get(unit.strip(), ('', 0.0))
    if kind != wanted:
        known = [word for word, (other, _) in CONVERSIONS.items() if other == wanted]
        raise ConfigurationError(
            f'column {name} must be in {" or ".join(known)}, got [{unit}]; correct the heading, '
            'or convert the column', 'not_a_choice', name)
    return values * factor
