# SPDX-License-Identifier: Apache-2.0
"""Feasibility of the loop: bytes per period against baud rate, loop rate against gains."""
import math
from typing import Any, List, Sequence

from ballbot_ros.bridge.hardware_file import Hardware
from ballbot_ros.control import check_loop, ControlTuning, lowest_stable_rate
from ballbot_ros.control.sampled import CLOSED
from ballbot_ros.drives import driver_class, line_of, open_driver, SERIAL
from ballbot_ros.drives.contract import WireBudget
from ballbot_ros.errors import ConfigurationError, UnstableLoopError
from ballbot_ros.physics.model.robot import Robot

# Baud rates that serial adapters and drives commonly support.
BAUD_RATES = (57600, 115200, 230400, 460800, 500000, 921600, 1000000, 2000000)
# Time that onboard control may take in addition to the transfers, for drive, serial adapter,
# scheduler, filter and controller [s].
RESERVE = 0.5e-3


def wire_budget(hardware: Hardware, robot: Robot) -> WireBudget:
    """Return the largest amount of data on the link in one period of the loop, for all axes."""
    axes = [hardware]
    if hardware.steering is not None:
        lateral = hardware.lateral(robot)
        if lateral.connection.port == hardware.connection.port:
            axes.append(lateral)
    no_line: Any = None  # a budget depends on the options only
    budgets = [open_driver(item.connection.protocol, no_line, item.options()).budget()
               for item in axes]
    return WireBudget(sum(item.bytes_out for item in budgets),
                      sum(item.bytes_in for item in budgets))


def onboard_lag(hardware: Hardware, robot: Robot) -> float:
    """
    Return the time from a measurement to its torque with onboard control [s].

    This is the sum of the transfer times of request, reply and torque, and `RESERVE`.
    """
    return wire_budget(hardware, robot).duration(hardware.connection.baud) + RESERVE


def check_feasible(hardware: Hardware, robot: Robot, tuning: ControlTuning,
                   delay: float = 1, lag: float = 0.0) -> float:
    """
    Refuse a loop that is not feasible; return the lowest rate at which the gains are stable [Hz].

    The messages name the parameters to change.  `delay` is that from a joint state to its torque
    [samples]; `lag` adds a time [s], such as `onboard_lag` to a delay of 0.  Raises
    `ConfigurationError` if the link does not support the rate, or the drive would disarm between
    two commands, and `UnstableLoopError` if the gains diverge at that rate.
    """
    connection = hardware.connection
    rate, baud, budget = connection.loop_rate, connection.baud, wire_budget(hardware, robot)
    lowest = max(lowest_stable_rate(robot, tuning, law, delay, None, lag) for law in CLOSED)
    if budget.highest_rate(baud) < rate:
        protocol = connection.protocol
        rates = BAUD_RATES if line_of(protocol) is SERIAL else driver_class(protocol).baud_rates
        ways = _ways(budget, baud, rate, lowest, rates)
        raise ConfigurationError(
            f'{hardware.name}: a period of {protocol} takes '
            f'{budget.bytes_out} + {budget.bytes_in} bytes, so {baud} baud carry '
            f'{budget.highest_rate(baud):.0f} Hz at most and loop_rate is {rate:g} Hz; '
            + ', or '.join(ways), 'inconsistent', 'loop_rate')
    if connection.watchdog < 3.0 / rate:
        raise ConfigurationError(
            f'{hardware.name}: watchdog must be at least three periods of the loop '
            f'({3.0 / rate:.3g} s at {rate:g} Hz), got {connection.watchdog:g} s: the drive would '
            'disarm at the first late command', 'inconsistent', 'watchdog')
    try:
        for law in CLOSED:
            check_loop(robot, tuning, law, rate, delay, lag)
    except UnstableLoopError as error:
        top = budget.highest_rate(baud)
        carries = f'{baud} baud carry {top:.0f} Hz' if lowest <= top else (
            f'{baud} baud carry {top:.0f} Hz only: raise baud, too')
        raise UnstableLoopError(
            f'{error}; {carries}.  Or choose other gains (tuning "gentle")',
            'unstable', 'loop_rate' if lowest <= top else 'baud') from error
    return lowest


def check_joint_state_rate(hardware: Hardware, rate: float) -> None:
    """Raise `ConfigurationError` if the joint state rate exceeds the rate of the estimates."""
    loop = hardware.connection.loop_rate
    if rate > loop:
        raise ConfigurationError(
            f'joint_state_rate must be at most loop_rate of {hardware.name} ({loop:g} Hz), got '
            f'{rate:g} Hz', 'inconsistent', 'joint_state_rate')


def _ways(budget: WireBudget, baud: int, rate: float, lowest: float,
          rates: Sequence[int]) -> List[str]:
    ways = []
    enough = [one for one in rates if one > baud and budget.highest_rate(one) >= rate]
    if enough:
        ways.append(f'set baud to {min(enough)}')
    top = math.floor(budget.highest_rate(baud))
    if top >= lowest:
        ways.append(f'set loop_rate to {top} Hz or less (these gains need {lowest:.0f} Hz)')
    else:
        ways.append(f'lower loop_rate to {top} Hz and choose lower gains, because these need '
                    f'{lowest:.0f} Hz (tuning "gentle"), or use a faster line')
    return ways
