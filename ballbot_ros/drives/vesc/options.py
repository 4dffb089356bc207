# SPDX-License-Identifier: Apache-2.0
"""The options of a VESC, whatever line it is on."""
from dataclasses import dataclass

from ballbot_ros.config.fields import count, flag, quantity
from ballbot_ros.drives.contract import DriveOptions


@dataclass(frozen=True)
class VescOptions(DriveOptions):
    """The options of a VESC driver."""

    torque_constant: float = quantity(
        'N m/A', 'motor torque per ampere; of a brushless motor 1.5 pole pairs x flux linkage',
        default=0.025, above=0.0)
    pole_pairs: int = count('pole pairs of the motor', default=7, minimum=1)
    encoder: bool = flag('the motor has an encoder, whose angle is finer than the commutation',
                         default=True)
