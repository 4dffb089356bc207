# SPDX-License-Identifier: Apache-2.0
r"""
Ballistic flight in closed form: no step, no error but rounding.

Without contact the centre of mass of ball and pendulum follows a parabola, and gravity drops
out of the equations of the two angles (see `dynamics`).  With c1, c2 and a torque
tau2 = tau0 - k theta2' (free: 0; constant: k = 0; DC motor: k its back voltage) they are linear::

    J1 theta1'' = -c1 theta1' + c (phi' - theta1') - tau0          c = c2 + k
    I  phi''    =  tau0 - c (phi' - theta1')                       I = J2 + M2 e^2 M1 / M

or u' = A u + b.  A is similar to a symmetric matrix without positive eigenvalues, so
exp(A t) = P1 exp(l1 t) + P2 exp(l2 t) with real l1, l2 and well-conditioned projectors.  Laws
(11) and (12) hold sin(phi) or phi itself; they have no such form and are integrated.

The loss of c1 is a quadrature of the closed form; joint and motor follow from the balance of
energy.

*Touch-down.*  The distance of a point to a segment is convex along a straight line, and the
centre leaves the straight line by at most A t^2 / 2, where A bounds its acceleration.  So for
each segment ``gap + gap' h - A h^2 / 2 <= 0`` gives a time h before which there is no touch, and
the least h of all segments may be stepped over.  Repeated, this converges on the first touch
quadratically, and cannot pass it.
"""
import math
from typing import Any

import numpy as np

from ballbot_ros.compiled import compiled, outlined
from ballbot_ros.physics.mechanics.contact import first_segment
from ballbot_ros.physics.mechanics.equations import (
    BALL_ANGLE, BALL_RATE, CONTACT_LOSS, FREE, FRICTION_LOSS, JOINT_LOSS, MOTOR_WORK,
    PENDULUM_ANGLE, PENDULUM_RATE, ROLLING_LOSS, TORQUE, VELOCITY_X, VELOCITY_Y, VOLTAGE, X, Y)
from ballbot_ros.physics.model.terrain import TANGENT_X, TANGENT_Y, VERTEX_X, VERTEX_Y

# Gauss and Legendre's abscissae and weights on (0, 1).
NODES = 0.5 + 0.5 * np.polynomial.legendre.leggauss(4)[0]
WEIGHTS = 0.5 * np.polynomial.legendre.leggauss(4)[1]
MOST_PANELS = 100

# A search looks so far at a time [s]: the bound of the acceleration is one of that time.
WINDOW = 0.05
MOST_LOOKS = 200
NO_TOUCH = -1.0


@compiled
def spin_law(robot: Any, drive: Any) -> tuple:
    """Return c and tau0 [N m s/rad, N m]; meaningful for a law that `has_closed_form`."""
    if drive.law == VOLTAGE:
        return robot.joint_friction + drive.kp * drive.kd_or_ki, drive.kp * drive.set_value
    if drive.law == TORQUE:
        return robot.joint_friction, min(max(drive.set_value, -drive.limit), drive.limit)
    return robot.joint_friction, 0.0


@compiled
def has_closed_form(robot: Any, drive: Any) -> bool:
    """Tell whether the law of the motor leaves the angles linear (but for its limit)."""
    return (robot.swing_inertia <= 0.0 or drive.law == FREE or drive.law == TORQUE
            or drive.law == VOLTAGE)


@compiled
def spin_start(state: Any, robot: Any, drive: Any) -> tuple:
    """
    Return what `spin_after` needs of the start of a flight.

    Returns
    -------
    l1, l2 : float
        Eigenvalues [1/s].
    g1, h1, g2, h2 : float
        The accelerations of ball and pendulum at the start, projected on either.

    """
    rate, swing = state[BALL_RATE], state[PENDULUM_RATE]
    if robot.swing_inertia <= 0.0:
        decay = -robot.rolling_friction / robot.ball_inertia
        return decay, 0.0, decay * rate, 0.0, 0.0, 0.0
    drag, torque = spin_law(robot, drive)
    push = torque - drag * (swing - rate)
    first = (-robot.rolling_friction * rate - push) / robot.ball_inertia
    second = push / robot.swing_inertia
    a11 = -(robot.rolling_friction + drag) / robot.ball_inertia
    a12, a21 = drag / robot.ball_inertia, drag / robot.swing_inertia
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
def twice(decay: float, time: float) -> float:
    """Return the integral of `once`."""
    argument = decay * time
    if abs(argument) > 0.1:
        return (once(decay, time) - time) / decay
    total, term = 0.0, 0.5 * time * time
    for power in range(3, 13):
        total += term
        term *= argument / power
    return total


@compiled
def swing_of(state: Any, time: float, spin: tuple) -> tuple:
    """Return angle and rate of the pendulum after a time of flight."""
    l1, l2, _, h1, _, h2 = spin
    return (state[PENDULUM_ANGLE] + time * state[PENDULUM_RATE]
            + twice(l1, time) * h1 + twice(l2, time) * h2,
            state[PENDULUM_RATE] + once(l1, time) * h1 + once(l2, time) * h2)


@outlined
def centre_after(state: Any, time: float, spin: tuple, robot: Any) -> tuple:
    """Return place and velocity of the ball's centre after a time of flight."""
    fall = robot.gravity * time
    x = state[X] + time * state[VELOCITY_X]
    y = state[Y] + time * (state[VELOCITY_Y] - 0.5 * fall)
    velocity_x, velocity_y = state[VELOCITY_X], state[VELOCITY_Y] - fall
    if robot.swing_inertia <= 0.0 or robot.pendulum_moment == 0.0:
        return x, y, velocity_x, velocity_y
    arm = robot.pendulum_moment / robot.mass
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
def rolling_loss(state: Any, time: float, spin: tuple, robot: Any) -> float:
    """Return what c1 takes during a flight [J]."""
    if robot.rolling_friction == 0.0:
        return 0.0
    l1, l2, g1, _, g2, _ = spin
    panels = int(min(1.0 + time * max(-l1, -l2), MOST_PANELS))
    total, width = 0.0, time / panels
    for panel in range(panels):
        for node in range(len(NODES)):
            moment = (panel + NODES[node]) * width
            rate = state[BALL_RATE] + once(l1, moment) * g1 + once(l2, moment) * g2
            total += WEIGHTS[node] * width * rate * rate
    return robot.rolling_friction * total


@outlined
def fly(state: Any, time: float, spin: tuple, robot: Any, drive: Any, out: Any) -> None:
    """
    Write the state after a time of flight into `out`.

    Parameters
    ----------
    state : (13,) array
        At the start of the flight.
    time : float
        Since then [s].
    spin : tuple
        `spin_start` of that state.
    robot : Numbers
    drive : Drive
        With a law that `has_closed_form`, and never at its limit during the flight.
    out : (13,) array
        Another array than `state`.

    """
    l1, l2, g1, _, g2, _ = spin
    rate, swing = state[BALL_RATE], state[PENDULUM_RATE]
    out[X], out[Y], out[VELOCITY_X], out[VELOCITY_Y] = centre_after(state, time, spin, robot)
    out[BALL_ANGLE] = (state[BALL_ANGLE] + time * rate + twice(l1, time) * g1
                       + twice(l2, time) * g2)
    out[BALL_RATE] = rate + once(l1, time) * g1 + once(l2, time) * g2
    out[PENDULUM_ANGLE], out[PENDULUM_RATE] = state[PENDULUM_ANGLE], swing
    rolled = rolling_loss(state, time, spin, robot)
    out[CONTACT_LOSS], out[FRICTION_LOSS] = state[CONTACT_LOSS], state[FRICTION_LOSS]
    out[ROLLING_LOSS] = state[ROLLING_LOSS] + rolled
    out[JOINT_LOSS], out[MOTOR_WORK] = state[JOINT_LOSS], state[MOTOR_WORK]
    if robot.swing_inertia <= 0.0:
        return
    out[PENDULUM_ANGLE], out[PENDULUM_RATE] = swing_of(state, time, spin)
    drag, torque = spin_law(robot, drive)
    turned = (out[PENDULUM_ANGLE] - out[BALL_ANGLE]
              - state[PENDULUM_ANGLE] + state[BALL_ANGLE])
    gained = 0.5 * (
        robot.ball_inertia * (out[BALL_RATE] - rate) * (out[BALL_RATE] + rate)
        + robot.swing_inertia * (out[PENDULUM_RATE] - swing) * (out[PENDULUM_RATE] + swing))
    if drag > 0.0:
        taken = torque * turned - gained - rolled  # by c: joint and back voltage
        share = robot.joint_friction / drag
        out[JOINT_LOSS] += share * taken
        out[MOTOR_WORK] += torque * turned - (1.0 - share) * taken
    else:
        out[MOTOR_WORK] += torque * turned


@compiled
def within_limit(state: Any, time: float, spin: tuple, robot: Any, drive: Any) -> bool:
    """Tell whether the motor stays below its limit during a flight."""
    if robot.swing_inertia <= 0.0 or drive.law != VOLTAGE or drive.limit == math.inf:
        return True
    l1, l2, g1, h1, g2, h2 = spin
    joint = state[PENDULUM_RATE] - state[BALL_RATE]
    # The joint's rate is a sum of two monotonous terms: bounded by the sums of their ends.
    first, second = once(l1, time) * (h1 - g1), once(l2, time) * (h2 - g2)
    most = joint + max(first, 0.0) + max(second, 0.0)
    least = joint + min(first, 0.0) + min(second, 0.0)
    return (drive.kp * abs(drive.set_value - drive.kd_or_ki * most) < drive.limit
            and drive.kp * abs(drive.set_value - drive.kd_or_ki * least) < drive.limit)


@compiled
def clear_time(x: float, y: float, velocity_x: float, velocity_y: float, bend: float,
               reach: float, radius: float, ground: Any) -> float:
    """
    Return a time before which the ball touches nothing [s].

    Parameters
    ----------
    bend : float
        Bound of the acceleration of the centre [m/s2], above 0.
    reach : float
        Segments that lie further from x than this are not looked at [m].

    """
    least = math.inf
    last = len(ground) - 2
    for segment in range(first_segment(ground, x - reach), last + 1):
        away_x, away_y = x - ground[segment, VERTEX_X], y - ground[segment, VERTEX_Y]
        if -away_x > reach and segment > 0:
            break
        along_x, along_y = ground[segment, TANGENT_X], ground[segment, TANGENT_Y]
        along = away_x * along_x + away_y * along_y
        # The nearest point: the foot of the perpendicular, or an end that is not infinite.
        if along < 0.0 and segment > 0:
            along = 0.0
        if segment < last:
            end = ((ground[segment + 1, VERTEX_X] - ground[segment, VERTEX_X]) * along_x
                   + (ground[segment + 1, VERTEX_Y] - ground[segment, VERTEX_Y]) * along_y)
            along = min(along, end)
        away_x -= along * along_x
        away_y -= along * along_y
        distance = math.sqrt(away_x * away_x + away_y * away_y)
        gap = max(distance - radius, 0.0)
        speed = (velocity_x * away_x + velocity_y * away_y) / distance
        root = math.sqrt(speed * speed + 2.0 * bend * gap)
        # The positive root of gap + speed h - bend h^2 / 2, without cancellation.
        wait = (speed + root) / bend if speed > 0.0 else (
            2.0 * gap / (root - speed) if gap > 0.0 else 0.0)
        least = min(least, wait)
    return least


@outlined
def time_of_touch(state: Any, most: float, width: float, spin: tuple, robot: Any,
                  ground: Any) -> float:
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
    arm = robot.pendulum_moment / robot.mass if robot.swing_inertia > 0.0 else 0.0
    swing_up = abs(h1) + abs(h2)  # a bound of |phi''|: each part only decays
    looks = 0
    while done < most:
        window = min(WINDOW, most - done)
        until = done + window
        swing = abs(state[PENDULUM_RATE]) + swing_up * until
        bend = robot.gravity + arm * (swing * swing + swing_up) + 1e-9
        while done < until:
            x, y, velocity_x, velocity_y = centre_after(state, done, spin, robot)
            speed = math.sqrt(velocity_x * velocity_x + velocity_y * velocity_y)
            reach = robot.radius + (speed + bend * window) * window
            wait = clear_time(x, y, velocity_x, velocity_y, bend, reach, robot.radius, ground)
            looks += 1
            done += wait + 0.5 * width
            if wait <= 0.5 * width or looks > MOST_LOOKS:
                return done
        done = min(done, until)  # the bound holds no further
    return NO_TOUCH
