# SPDX-License-Identifier: Apache-2.0
"""What a period of the loop has found."""
from enum import Enum
from typing import NamedTuple, Optional

from ballbot_ros.drives.contract import Telemetry
from ballbot_ros.estimation import Estimate


class Power(Enum):
    """What is known about the power of the motor."""

    OFF = 'off'  # confirmed by the drive
    STOPPING = 'stopping'  # the stop is repeated until it is confirmed
    ON = 'on'


class Report(NamedTuple):
    """What a tick found; times are of the clock of the session [s]."""

    time: float
    estimate: Optional[Estimate]  # None when there was no new measurement
    torque: float  # at the pendulum, in force [N m]
    telemetry: Telemetry
    power: Power
    e_stop: str
    timed_out: bool
    commanded: bool  # a fresh command is in force
    link_up: bool
