# SPDX-License-Identifier: Apache-2.0
"""When a flight in closed form ends: the first touch, which `clearance` cannot pass."""
import math

from ballbot_ros.jit import compiled, outlined
from ballbot_ros.physics.mechanics.contact import spring_energy
from ballbot_ros.physics.mechanics.contact_law import PRESSED
from ballbot_ros.physics.mechanics.modes import contact_count, ContactMode
from ballbot_ros.physics.model.parameters import Parameters, System
from ballbot_ros.physics.model.state import CONTACT_LOSS, PENDULUM_RATE, SIZE
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.solvers.clearance import clear_time
from ballbot_ros.physics.solvers.controller import smallest_step
from ballbot_ros.physics.solvers.dense import write_row
from ballbot_ros.physics.solvers.events import time_width
from ballbot_ros.physics.solvers.flight import (
    add_to_ledger, centre_after, fly, Spin, spin_start, within_limit)
from ballbot_ros.physics.solvers.values import FLIGHTS, Output, Workspace

# A search looks so far at a time [s]: the bound of the acceleration is one of that time.
WINDOW = 0.05
MOST_LOOKS = 200
NO_TOUCH = -1.0
SHORT_FLIGHT = 1e-6  # [s]: not worth another one


@outlined
def time_of_touch(state: Array, most: float, width: float, spin: Spin, parameters: Parameters,
                  ground: Array) -> float:
    """
    Return the time of flight until the ball first touches the ground [s].

    Parameters
    ----------
    most : float
        How far to search [s].
    width : float
        How closely to locate [s]; the time returned is up to that later than the touch.

    Returns
    -------
    float
        NO_TOUCH where there is none.

    """
    done = 0.0
    l1, l2, g1, h1, g2, h2 = spin
    arm = parameters.pendulum_moment / parameters.mass if parameters.swing_inertia > 0.0 else 0.0
    swing_up = abs(h1) + abs(h2)  # a bound of |phi''|: each part only decays
    looks = 0
    while done < most:
        window = min(WINDOW, most - done)
        until = done + window
        swing = abs(state[PENDULUM_RATE]) + swing_up * until
        bend = parameters.gravity + arm * (swing * swing + swing_up) + 1e-9
        while done < until:
            x, y, velocity_x, velocity_y = centre_after(state, done, spin, parameters)
            speed = math.sqrt(velocity_x * velocity_x + velocity_y * velocity_y)
            reach = parameters.radius + (speed + bend * window) * window
            wait = clear_time(x, y, velocity_x, velocity_y, bend, reach, parameters.radius, ground)
            looks += 1
            done += wait + 0.5 * width
            if wait <= 0.5 * width or looks > MOST_LOOKS:
                return done
        done = min(done, until)  # the bound holds no further
    return NO_TOUCH


@compiled
def is_let_go(mode: ContactMode, parameters: Parameters) -> bool:
    """
    Return whether the ground exerts no force in a mode: no contact, or one that would pull.

    Where the damper grows with the penetration, the bound of `clearance` does not hold for a ball
    that still overlaps the ground.
    """
    count = contact_count(mode)
    return count == 0 or (count == 1 and mode.signs[0, PRESSED] == 0
                          and parameters.dissipation == 0.0)


@outlined
def fly_to_touch(time: float, state: Array, end: float, system: System, output: Output,
                 filled: int, ledger: bool, workspace: Workspace) -> tuple[float, int]:
    """
    Advance a state that `is_let_go` in place until the ground pushes again.

    Returns
    -------
    time : float
        Reached time [s]; unchanged where the motor might reach its limit, or where a contact
        force might act immediately.
    filled : int
        Number of filled rows.

    """
    parameters, actuator, later = system.parameters, system.actuator, workspace.probe
    spin = spin_start(state, parameters, actuator)
    most = end - time
    wait = time_of_touch(state, most, 2.0 * time_width(time), spin, parameters, system.ground)
    lasting = most if wait == NO_TOUCH else min(wait, most)
    overlapping = contact_count(workspace.mode) > 0
    if not within_limit(state, lasting, spin, parameters, actuator) or (
            overlapping and lasting < SHORT_FLIGHT):
        return time, filled
    reached, stored = end if wait == NO_TOUCH else time + lasting, 0.0
    if reached > time:
        workspace.statistics[FLIGHTS] += 1
    if ledger and overlapping:
        stored = spring_energy(state, parameters, system.ground, workspace.mode.contacts)
    while (filled < len(output.rows) and output.begin + (filled + 1) * output.interval
           <= reached + smallest_step(time)):
        moment = output.begin + (filled + 1) * output.interval
        fly_for(min(moment - time, lasting), state, spin, stored, system, ledger, workspace)
        write_row(output, filled, moment, later, actuator)
        filled += 1
    fly_for(lasting, state, spin, stored, system, ledger, workspace)
    for i in range(SIZE):
        state[i] = later[i]
    return reached, filled


@compiled
def fly_for(lasting: float, state: Array, spin: Spin, stored: float, system: System,
            ledger: bool, workspace: Workspace) -> None:
    """
    Write the state after a time of flight [s] into the probe.

    What was stored in the spring of a contact [J] that would pull is lost as the ball leaves.
    """
    fly(state, lasting, spin, system.parameters, workspace.probe)
    if ledger:
        add_to_ledger(state, lasting, spin, system.parameters, system.actuator, workspace.probe)
    if stored > 0.0:
        workspace.probe[CONTACT_LOSS] += stored - spring_energy(
            workspace.probe, system.parameters, system.ground, workspace.mode.contacts)
