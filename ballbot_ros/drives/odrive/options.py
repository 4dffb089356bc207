# SPDX-License-Identifier: Apache-2.0
"""What can be set of an ODrive driver."""
from dataclasses import dataclass

from ballbot_ros.config.fields import count, quantity
from ballbot_ros.drives.contract import DriveOptions


@dataclass(frozen=True)
class ODriveOptions(DriveOptions):
    """The options of an ODrive driver."""

    axis: int = count('motor output of the board', default=0, maximum=1)
    status_period: float = quantity(
        's', 'time between requests for errors, state, voltage, current and temperatures, of '
        'which one is asked at a time', default=0.02, minimum=0.0, maximum=1.0)
