# SPDX-License-Identifier: Apache-2.0
"""Can this loop work at all: bytes on the wire against baud, and rate against the gains."""
import math
from typing import List

from ballbot_ros.bridge.hardware_file import Hardware
from ballbot_ros.control import check_loop, ControlTuning, lowest_stable_rate, Mode
from ballbot_ros.drives import open_driver
from ballbot_ros.drives.capture import Replay
from ballbot_ros.drives.wire import WireBudget
from ballbot_ros.errors import ConfigurationError, UnstableLoopError
from ballbot_ros.physics.model.robot import Robot

# What serial adapters and drives commonly do.
BAUD_RATES = (57600, 115200, 230400, 460800, 500000, 921600, 1000000, 2000000)
LAWS = (Mode.HOLD, Mode.DRIVE, Mode.SPEED)


def wire_budget(hardware: Hardware) -> WireBudget:
    """Return what one period of the loop puts on the line at most."""
    return open_driver(hardware.connection.protocol, Replay([]), hardware.options()).budget()


def check_feasible(hardware: Hardware, robot: Robot, tuning: ControlTuning,
                   delay: int = 1) -> None:
    """
    Refuse a loop that cannot work, and say which part of it to change.

    Parameters
    ----------
    hardware : Hardware
    robot : Robot
    tuning : ControlTuning
        Gains that the controller runs with.
    delay : int
        Samples from a joint state to the torque that answers it.

    Raises
    ------
    ConfigurationError
        If the line does not carry the rate, or the drive would disarm between two commands.
    UnstableLoopError
        If the gains diverge at that rate.

    """
    connection = hardware.connection
    rate, baud, budget = connection.loop_rate, connection.baud, wire_budget(hardware)
    lowest = max(lowest_stable_rate(robot, tuning, law, delay) for law in LAWS)
    if budget.highest_rate(baud) < rate:
        ways = _ways(budget, baud, rate, lowest)
        raise ConfigurationError(
            f'{hardware.name}: a period of {connection.protocol} takes '
            f'{budget.bytes_out} + {budget.bytes_in} bytes, so {baud} baud carry '
            f'{budget.highest_rate(baud):.0f} Hz at most and loop_rate is {rate:g} Hz; '
            + ', or '.join(ways))
    if connection.watchdog < 3.0 / rate:
        raise ConfigurationError(
            f'{hardware.name}: watchdog must be at least three periods of the loop '
            f'({3.0 / rate:.3g} s at {rate:g} Hz), got {connection.watchdog:g} s: the drive would '
            'disarm at the first late command')
    try:
        for law in LAWS:
            check_loop(robot, tuning, law, rate, delay)
    except UnstableLoopError as error:
        top = budget.highest_rate(baud)
        carries = f'{baud} baud carry {top:.0f} Hz' if lowest <= top else (
            f'{baud} baud carry {top:.0f} Hz only: raise baud, too')
        raise UnstableLoopError(
            f'{error}; {carries}.  Or choose other gains (tuning "gentle"), or close the loop in '
            'the drive') from error


def _ways(budget: WireBudget, baud: int, rate: float, lowest: float) -> List[str]:
    """Return what would make the wire carry the loop."""
    ways = []
    enough = [one for one in BAUD_RATES if one > baud and budget.highest_rate(one) >= rate]
    if enough:
        ways.append(f'set baud to {enough[0]}')
    top = math.floor(budget.highest_rate(baud))
    if top >= lowest:
        ways.append(f'set loop_rate to {top} Hz or less (these gains need {lowest:.0f} Hz)')
    else:
        ways.append(f'lower loop_rate to {top} Hz and choose gentler gains, for these need '
                    f'{lowest:.0f} Hz (tuning "gentle"), or close the loop in the drive')
    return ways
