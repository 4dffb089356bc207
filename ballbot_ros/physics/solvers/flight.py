# SPDX-License-Identifier: Apache-2.0
"""
Ballistic flight in closed form, exact to rounding, and the touch that ends it.

Without contact the centre of mass of ball and pendulum follows a parabola, and gravity drops
out of the equations of the two angles (see `mechanics.equations`).  With c1, c2 and a torque
tau2 = tau0 - k theta2' (free: 0; constant: k = 0; DC motor: k its back voltage) they are linear::

    J1 theta1'' = -c1 theta1' + c (phi' - theta1') - tau0          c = c2 + k
    I  phi''    =  tau0 - c (phi' - theta1')                       I = J2 + M2 e^2 M1 / M

or u' = A u + b.  A is similar to a symmetric matrix without positive eigenvalues, so
exp(A t) = P1 exp(l1 t) + P2 exp(l2 t) with real l1, l2 and well-conditioned projectors.  Laws
(11) and (12) contain sin(phi) or phi itself; they have no such form and are integrated.

The loss by c1 is a quadrature of the closed form; joint loss and motor work follow from the energy
balance.

The time to contact is bounded: the distance of a point to a segment is convex along a straight
line, and the centre leaves the straight line by at most A t^2 / 2, where A bounds its
acceleration.  So for each segment ``gap + gap' h - A h^2 / 2 <= 0`` gives a time h before which
there is no touch, and the minimum h of all segments is a safe step.  Repeated, this converges
quadratically to the first contact, and cannot pass it.

A ball at release still overlaps the ground: gap < 0.  Its speed away stays above gap' - A h,
so with ``gap'^2 > -2 A gap`` it leaves before it returns, and during this time the force of
spring and damper, k (-gap) - d gap', stays below a parabola that opens upwards and is not above
zero at either end.  Then the later root is the time h.
"""
import math

import numpy as np

from ballbot_ros.jit import compiled, outlined
from ballbot_ros.physics.mechanics.contact import (
    clear_time, ContactMode, PRESSED, spring_energy)
from ballbot_ros.physics.mechanics.equations import System
from ballbot_ros.physics.mechanics.modes import contact_count
from ballbot_ros.physics.model.actuation import Actuator, FREE, limited, TORQUE, VOLTAGE
from ballbot_ros.physics.model.contact_laws import LEAVES_FREELY
from ballbot_ros.physics.model.robot import Parameters
from ballbot_ros.physics.model.state import (
    BALL_ANGLE, BALL_RATE, CONTACT_LOSS, FRICTION_LOSS, JOINT_LOSS, MOTOR_WORK, PENDULUM_ANGLE,
    PENDULUM_RATE, ROLLING_LOSS, SIZE, VELOCITY_X, VELOCITY_Y, X, Y)
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.solvers import values
from ballbot_ros.physics.solvers.controller import smallest_step, time_width
from ballbot_ros.physics.solvers.dense import NODES, write_row
from ballbot_ros.physics.solvers.values import FLIGHTS, Output, Workspace

# The result of `spin_start`.
Spin = tuple[float, float, float, float, float, float]

# Gauss-Legendre weights on (0, 1); `NODES` are the abscissae.
WEIGHTS = 0.5 * np.polynomial.legendre.leggauss(4)[1]
MOST_PANELS = 100

NEARBY = 0.5  # argument of the exponential function up to which the series is exact to rounding
TWICE = np.array([1.0 / math.factorial(power) for power in range(15, 1, -1)])


@compiled
def spin_law(parameters: Parameters, actuator: Actuator) -> tuple[float, float]:
    """Return c and tau0 [N m s/rad, N m]; meaningful for a law that `has_closed_form`."""
    if actuator.law == VOLTAGE:
        return (parameters.joint_friction + actuator.kp * actuator.kd_or_ki,
                actuator.kp * actuator.set_value)
    if actuator.law == TORQUE:
        return parameters.joint_friction, limited(actuator.set_value, actuator.limit)
    return parameters.joint_friction, 0.0


@compiled
def has_closed_form(parameters: Parameters, actuator: Actuator) -> bool:
    """Return whether the angles are linear under the law of the motor (below its limit)."""
    return (parameters.swing_inertia <= 0.0 or actuator.law == FREE or actuator.law == TORQUE
            or actuator.law == VOLTAGE)


@compiled
def spin_start(state: Array, parameters: Parameters, actuator: Actuator) -> Spin:
    """
    Return the initial values of a flight for `spin_after`.

    Returns
    -------
    l1, l2 : float
        Eigenvalues [1/s].
    g1, h1, g2, h2 : float
        The accelerations of ball and pendulum at the start, projected on each eigenvector.

    """
    rate, swing = state[BALL_RATE], state[PENDULUM_RATE]
    if parameters.swing_inertia <= 0.0:
        decay = -parameters.rolling_friction / parameters.ball_inertia
        return decay, 0.0, decay * rate, 0.0, 0.0, 0.0
    drag, torque = spin_law(parameters, actuator)
    push = torque - drag * (swing - rate)
    first = (-parameters.rolling_friction * rate - push) / parameters.ball_inertia
    second = push / parameters.swing_inertia
    a11 = -(parameters.rolling_friction + drag) / parameters.ball_inertia
    a12, a21 = drag / parameters.ball_inertia, drag / parameters.swing_inertia
    half = 0.5 * (a11 + a21)
    root = math.sqrt(half * half + a12 * a21)
    if root == 0.0:
        return a11, a11, first, second, 0.0, 0.0
    # A's lower right element is -a21.
    middle = 0.5 * (a11 - a21)
    low = middle - root
    high = (a11 * -a21 - a12 * a21) / low if low < 0.0 else 0.0
    g_high = ((a11 - low) * first + a12 * second) / (high - low)
    h_high = (a21 * first + (-a21 - low) * second) / (high - low)
    return high, low, g_high, h_high, first - g_high, second - h_high


@compiled
def once(decay: float, time: float) -> float:
    """Return the integral of exp(decay t) from 0 to `time`."""
    return math.expm1(decay * time) / decay if decay != 0.0 else time


@compiled
def once_and_twice(decay: float, time: float) -> tuple[float, float]:
    """Return the integral of exp(decay t) from 0 to `time`, and the integral of that."""
    argument = decay * time
    if abs(argument) > NEARBY:
        grown = math.expm1(argument) / decay
        return grown, (grown - time) / decay
    total = 0.0
    for factor in TWICE:
        total = total * argument + factor
    total *= time * time
    return time + decay * total, total


@compiled
def swing_of(state: Array, time: float, spin: Spin) -> tuple[float, float]:
    """Return angle and rate of the pendulum after a time of flight."""
    l1, l2, _, h1, _, h2 = spin
    once1, twice1 = once_and_twice(l1, time)
    once2, twice2 = once_and_twice(l2, time)
    return (state[PENDULUM_ANGLE] + time * state[PENDULUM_RATE] + twice1 * h1 + twice2 * h2,
            state[PENDULUM_RATE] + once1 * h1 + once2 * h2)


@outlined
def centre_after(state: Array, time: float, spin: Spin,
                 parameters: Parameters) -> tuple[float, float, float, float]:
    """Return position and velocity of the ball's centre after a time of flight."""
    fall = parameters.gravity * time
    x = state[X] + time * state[VELOCITY_X]
    y = state[Y] + time * (state[VELOCITY_Y] - 0.5 * fall)
    velocity_x, velocity_y = state[VELOCITY_X], state[VELOCITY_Y] - fall
    if parameters.swing_inertia <= 0.0 or parameters.pendulum_moment == 0.0:
        return x, y, velocity_x, velocity_y
    arm = parameters.pendulum_moment / parameters.mass
    angle, rate = state[PENDULUM_ANGLE], state[PENDULUM_RATE]
    sine, cosine = math.sin(angle), math.cos(angle)
    later, later_rate = swing_of(state, time, spin)
    later_sine, later_cosine = math.sin(later), math.cos(later)
    x += arm * (sine + time * rate * cosine - later_sine)
    y += arm * (time * rate * sine - cosine + later_cosine)
    velocity_x += arm * (rate * cosine - later_rate * later_cosine)
    velocity_y += arm * (rate * sine - later_rate * later_sine)
    return x, y, velocity_x, velocity_y


@outlined
def rolling_loss(state: Array, time: float, spin: Spin, parameters: Parameters) -> float:
    """Return the energy dissipated by c1 during a flight [J]."""
    if parameters.rolling_friction == 0.0:
        return 0.0
    l1, l2, g1, _, g2, _ = spin
    panels = int(min(1.0 + time * max(-l1, -l2), MOST_PANELS))
    total, width = 0.0, time / panels
    for panel in range(panels):
        for node in range(len(NODES)):
            moment = (panel + NODES[node]) * width
            rate = state[BALL_RATE] + once(l1, moment) * g1 + once(l2, moment) * g2
            total += WEIGHTS[node] * width * rate * rate
    return parameters.rolling_friction * total


@outlined
def fly(state: Array, time: float, spin: Spin, parameters: Parameters, out: Array) -> None:
    """
    Write the motion after a time of flight into `out`, with the ledger unchanged.

    Parameters
    ----------
    state : (13,) array
        State at the start of the flight.
    time : float
        Time of flight [s].
    spin : tuple
        `spin_start` of that state, with a law that `has_closed_form`, and that is never at its
        limit during the flight.
    parameters : Parameters
    out : (13,) array
        Must not be the same array as `state`.

    """
    l1, l2, g1, _, g2, _ = spin
    rate, swing = state[BALL_RATE], state[PENDULUM_RATE]
    out[X], out[Y], out[VELOCITY_X], out[VELOCITY_Y] = centre_after(state, time, spin, parameters)
    once1, twice1 = once_and_twice(l1, time)
    once2, twice2 = once_and_twice(l2, time)
    out[BALL_ANGLE] = state[BALL_ANGLE] + time * rate + twice1 * g1 + twice2 * g2
    out[BALL_RATE] = rate + once1 * g1 + once2 * g2
    out[PENDULUM_ANGLE], out[PENDULUM_RATE] = state[PENDULUM_ANGLE], swing
    if parameters.swing_inertia > 0.0:
        out[PENDULUM_ANGLE], out[PENDULUM_RATE] = swing_of(state, time, spin)
    for item in (CONTACT_LOSS, FRICTION_LOSS, ROLLING_LOSS, JOINT_LOSS, MOTOR_WORK):
        out[item] = state[item]


@outlined
def add_to_ledger(state: Array, time: float, spin: Spin, parameters: Parameters,
                  actuator: Actuator, out: Array) -> None:
    """Add the energies of a flight to the energy balance of a state; see `fly`."""
    rolled = rolling_loss(state, time, spin, parameters)
    out[ROLLING_LOSS] += rolled
    if parameters.swing_inertia <= 0.0:
        return
    rate, swing = state[BALL_RATE], state[PENDULUM_RATE]
    drag, torque = spin_law(parameters, actuator)
    turned = (out[PENDULUM_ANGLE] - out[BALL_ANGLE]
              - state[PENDULUM_ANGLE] + state[BALL_ANGLE])
    gained = 0.5 * (
        parameters.ball_inertia * (out[BALL_RATE] - rate) * (out[BALL_RATE] + rate)
        + parameters.swing_inertia * (out[PENDULUM_RATE] - swing) * (out[PENDULUM_RATE] + swing))
    if drag > 0.0:
        # By c, joint and back voltage: a difference that may become negative by rounding.
        taken = max(torque * turned - gained - rolled, 0.0)
        share = parameters.joint_friction / drag
        out[JOINT_LOSS] += share * taken
        out[MOTOR_WORK] += torque * turned - (1.0 - share) * taken
    else:
        out[MOTOR_WORK] += torque * turned


@compiled
def within_limit(state: Array, time: float, spin: Spin, parameters: Parameters,
                 actuator: Actuator) -> bool:
    """Return whether the motor stays below its limit during a flight."""
    if parameters.swing_inertia <= 0.0 or actuator.law != VOLTAGE or actuator.limit == math.inf:
        return True
    l1, l2, g1, h1, g2, h2 = spin
    joint = state[PENDULUM_RATE] - state[BALL_RATE]
    # The joint rate is a sum of two monotonic terms: bounded by the sums of their end values.
    first, second = once(l1, time) * (h1 - g1), once(l2, time) * (h2 - g2)
    most = joint + max(first, 0.0) + max(second, 0.0)
    least = joint + min(first, 0.0) + min(second, 0.0)
    return (actuator.kp * abs(actuator.set_value - actuator.kd_or_ki * most) < actuator.limit
            and actuator.kp * abs(actuator.set_value - actuator.kd_or_ki * least) < actuator.limit)


# Time window of a search [s], in which the bound of the acceleration is valid.
WINDOW = 0.05
MOST_LOOKS = 200
SHORT_FLIGHT = 1e-6  # [s]: too short for another flight to follow


@outlined
def time_of_touch(state: Array, most: float, width: float, spin: Spin, parameters: Parameters,
                  ground: Array) -> float:
    """
    Return the time of flight until the ball first touches the ground [s].

    Parameters
    ----------
    most : float
        Limit of the search [s].
    width : float
        Resolution [s]; the returned time is later than the touch by at most this.

    Returns
    -------
    float
        Infinity if there is none.

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
        done = min(done, until)  # the bound is not valid beyond
    return math.inf


@compiled
def is_released(mode: ContactMode, parameters: Parameters) -> bool:
    """
    Return whether the ground exerts no force in a mode: no contact, or one that would pull.

    A ball that would be pulled still overlaps the ground; then the bound of `clear_time` is valid
    with some contact laws only.
    """
    count = contact_count(mode)
    return count == 0 or (count == 1 and mode.signs[0, PRESSED] == 0
                          and LEAVES_FREELY[int(parameters.law)])


@outlined
def fly_to_touch(time: float, state: Array, end: float, system: System, output: Output,
                 filled: int, ledger: bool, workspace: Workspace) -> tuple[float, int]:
    """
    Advance a state that `is_released` in place until the ground pushes again.

    Returns
    -------
    time : float
        Reached time [s]; unchanged if the motor might reach its limit, or if a contact force
        might act immediately.
    filled : int
        Number of filled rows.

    """
    parameters, actuator = system.parameters, system.actuator
    later = workspace.work[values.PROBE:]
    spin = spin_start(state, parameters, actuator)
    most = end - time
    wait = time_of_touch(state, most, 2.0 * time_width(time), spin, parameters, system.ground)
    lasting = min(wait, most)
    overlapping = contact_count(workspace.mode) > 0
    if not within_limit(state, lasting, spin, parameters, actuator) or (
            overlapping and lasting < SHORT_FLIGHT):
        return time, filled
    reached, stored = end if wait == math.inf else time + lasting, 0.0
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

    `stored` is the energy in the spring of a contact that would pull [J]: a loss at lift-off.
    """
    later = workspace.work[values.PROBE:]
    fly(state, lasting, spin, system.parameters, later)
    if ledger:
        add_to_ledger(state, lasting, spin, system.parameters, system.actuator, later)
    if stored > 0.0:
        later[CONTACT_LOSS] += stored - spring_energy(
            later, system.parameters, system.ground, workspace.mode.contacts)
