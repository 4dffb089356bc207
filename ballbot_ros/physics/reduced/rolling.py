# SPDX-License-Identifier: Apache-2.0
r"""
Rolling without slip along one feature of the ground: two degrees of freedom.

On a `track` with normal n, tangent t, dent p and d = R - p, the velocity is v = v_n n + v_t t
with v_n = -p', and the slip is s = v_t + lever theta1'.  The full model says

    N = k p - kd v_n                         eq. (7): the normal force
    F = -mu N scale(s)                       eq. (9): friction, a stiff function of the slip

The ramp of (9) makes the slip forget its past within tau = m_s v_threshold / (mu N), a
millisecond; the dent rings with the period of tau_n = sqrt(M / k), some ten.  Where the motion
is slower, and no ringing is left, both *follow*: the dent is the one that carries, the slip the
one that gives the friction which the motion asks for.  Way and pendulum remain.  So this is not
the rigid ball of the books: it dents, and it creeps, as the full model does.

*Variables.*  Momenta whose rates hold neither F nor an acceleration, so that an error of the slip
does not come back as one of the speed; with the momentum P = M v + m phi' (cos, sin)(phi)::

    K = J1 theta1' - d P_t      K' = -c1 theta1' - tau2 + c2 theta2' + d M g t_y
                                     - v_n P_t + W d P_n
    Q = dL/dphi'                Q' = tau2 - c2 theta2' - m g sin(phi) + m phi' (v_n b_n + v_t b_t)

with a = (cos, sin)(phi), b = (-sin, cos)(phi); so b_n = a_t and b_t = -a_n.  These are exact:
all that is approximate is dent and slip.

*Following.*  At a given slow state the acceleration equations with v_n' = 0 and s' = 0 give the
forces, and these a dent p0 and a slip s0.  Followed along the motion for a moment they give
rates, and with these the equations are solved once more, with v_n = -p0', v_n' = -p0'' and
s1 = s0 - tau s0'.  What a third round would change is estimated; that is NEGLECTED, as a length at
the rim, and whoever uses the model compares it with the tolerance.

To let only the slip follow, and the dent ring, was tried: fewer steps, but each so much dearer
that nothing was won.
"""
import math
from typing import Any

from ballbot_ros.compiled import compiled, outlined
from ballbot_ros.physics.contact import friction_scale
from ballbot_ros.physics.dynamics import (
    BALL_RATE, CONTACT_LOSS, FRICTION_LOSS, JOINT_LOSS, MOTOR_WORK, PENDULUM_ANGLE,
    PENDULUM_RATE, ROLLING_LOSS, SIZE, VELOCITY_X, VELOCITY_Y, X, Y)
from ballbot_ros.physics.reduced.mechanics import (
    forces, gain_rate, inertias, motion, outlook, outlook_near, settling_time, SPIN, SWING,
    torque_of, WAY, write_slow_rates)
from ballbot_ros.physics.reduced.track import (
    centre, DENT_ANSWER, normal_at, PERIOD, place, QUICKEST, ROUGHNESS, SLIP_ANSWER)

# What follows from a slow state: dent, normal velocity, slip, rates of ball and pendulum, velocity
# along the track, torque of the motor, and the estimate of what is neglected [m].
(OWN_DENT, RISE, SLIP, OWN_RATE, SWING_RATE, SPEED, MOTOR_TORQUE, NEGLECTED) = range(8)

GLANCE = 0.1  # of tau_n: how far ahead to look for rates
MOST_FRICTION = 0.95  # of the cone; the ramp ends at 1


@compiled
def asked(time: float, slow: Any, dent: float, slip: float, saturated: int, look: tuple,
          track: Any, robot: Any, drive: Any, probe: Any) -> tuple:
    """Return the forces that a motion without v_n, v_n' and s' asks for."""
    moved = motion(slow, dent, 0.0, slip, look, robot)
    motor = torque_of(time, slow, moved[0], moved[1], saturated, robot, drive, probe)
    return forces(slow, dent, moved, motor, 0.0, 0.0, look, track, robot)


@outlined
def measure(time: float, slow: Any, saturated: int, track: Any, robot: Any, drive: Any,
            probe: Any) -> None:
    """
    Write into the track how the forces asked for answer slip and dent, by differences.

    They change slowly, and only speed up the solution for slip and dent.  And QUICKEST, the rate
    at which anything but these may change: the motor and the pendulum.
    """
    look = outlook(slow, track)
    track[PERIOD] = settling_time(robot)
    track[QUICKEST] = gain_rate(robot, drive)
    if robot.swing_inertia > 0.0:
        track[QUICKEST] += abs(slow[SWING]) / robot.pendulum_inertia
    dent = robot.mass * robot.gravity * look[1] / robot.stiffness
    slip, deeper = 0.1 * robot.slip_threshold, 1e-3 * robot.radius
    normal, friction = asked(time, slow, dent, 0.0, saturated, look, track, robot, drive, probe)
    _, other = asked(time, slow, dent, slip, saturated, look, track, robot, drive, probe)
    pressed, _ = asked(
        time, slow, dent + deeper, 0.0, saturated, look, track, robot, drive, probe)
    track[SLIP_ANSWER] = (other - friction) / slip
    track[DENT_ANSWER] = (pressed - normal) / deeper


@compiled
def creep(normal: float, friction: float, track: Any, robot: Any) -> tuple:
    """
    Return the slip that gives the friction asked for, and how much of it a newton makes.

    Parameters
    ----------
    friction : float
        Asked for without any slip [N]; slip adds SLIP_ANSWER of the track.

    Returns
    -------
    slip : float
        [m/s]; eq. (9) the other way round.
    answer : float
        Its change with the friction [m/s/N].

    """
    strength = track[ROUGHNESS] * normal
    if strength <= 0.0:
        return math.inf, 0.0
    answer = track[SLIP_ANSWER]
    if robot.smooth_friction == 0.0:
        step = -robot.slip_threshold / strength
        return step * friction / (1.0 - step * answer), step / (1.0 - step * answer)
    slip = ratio = 0.0
    for _ in range(3):  # r (3 - r^2) / 2 = sin(3 x) for r = 2 sin(x)
        used = min(max(-(friction + answer * slip) / strength, -1.0), 1.0)
        ratio = 2.0 * math.sin(math.asin(used) / 3.0)
        slip = ratio * robot.slip_threshold
    step = -robot.slip_threshold / (strength * max(1.5 * (1.0 - ratio * ratio), 1e-6))
    return slip, step / (1.0 - step * answer)


@compiled
def slip_inertia(dent: float, look: tuple, robot: Any) -> float:
    """Return m_s, the friction that a unit of s' asks for [kg]."""
    _, _, c11, c12, c21, c22 = inertias(dent, look, robot)
    part = robot.pendulum_moment * look[5]
    return robot.ball_inertia * (robot.mass * c22 - part * part) / (c11 * c22 - c12 * c21)


@compiled
def look_ahead(slow: Any, rates: Any, glance: float, ahead: Any) -> None:
    """Write the slow state a moment later into `ahead`."""
    for i in range(VELOCITY_Y):
        ahead[i] = slow[i] + glance * rates[i]


@compiled
def write_following(time: float, slow: Any, dent: float, rise: float, slip: float,
                    saturated: int, look: tuple, track: Any, robot: Any, drive: Any, probe: Any,
                    fast: Any, rates: Any) -> None:
    """Write the motion with a settled slip and dent into `fast`, and the rates of it all."""
    moved = motion(slow, dent, rise, slip, look, robot)
    rate, swing, speed, _ = moved
    motor = torque_of(time, slow, rate, swing, saturated, robot, drive, probe)
    normal = robot.stiffness * dent - robot.damping * rise
    scale = slip / robot.slip_threshold
    if robot.smooth_friction > 0.0:
        scale = friction_scale(slip, robot.slip_threshold, 1.0)
    friction = -track[ROUGHNESS] * normal * scale
    fast[OWN_DENT], fast[RISE], fast[SLIP], fast[SPEED] = dent, rise, slip, speed
    fast[OWN_RATE], fast[SWING_RATE], fast[MOTOR_TORQUE] = rate, swing, motor
    write_slow_rates(slow, dent, moved, motor, look, track, robot, rates)
    rates[CONTACT_LOSS] = robot.damping * rise * rise
    rates[FRICTION_LOSS] = -friction * (speed + (robot.radius - dent) * rate)
    rates[ROLLING_LOSS] = robot.rolling_friction * rate * rate
    rates[JOINT_LOSS] = robot.joint_friction * (swing - rate) * (swing - rate)
    rates[MOTOR_WORK] = motor * (swing - rate)


@compiled
def slip_lag(normal: float, dent: float, track: Any, robot: Any) -> float:
    """Return tau, the time in which the slip forgets [s]; without the pendulum's help."""
    distance = robot.radius - dent
    inertia = 1.0 / (1.0 / robot.mass + distance * distance / robot.ball_inertia)
    return inertia * robot.slip_threshold / (track[ROUGHNESS] * normal)


@outlined
def follow(time: float, slow: Any, saturated: int, track: Any,
                   robot: Any, drive: Any, room: Any, fast: Any, rates: Any) -> None:
    """
    Write what follows from a slow state into `fast`, and its time derivative into `rates`.

    Parameters
    ----------
    track : array
        With what `measure` writes.
    room : (2, 13) array
        To work in.
    rates : (13,) array
        With the five losses.

    """
    ahead, probe, stiffness = room[0], room[1], robot.stiffness
    look = outlook(slow, track)
    gain = 1.0 / (1.0 - track[DENT_ANSWER] / stiffness)
    dent = robot.mass * robot.gravity * look[1] / stiffness
    slip = 0.0
    for _ in range(2):
        normal, friction = asked(time, slow, dent, 0.0, saturated, look, track, robot,
                                 drive, probe)
        dent += gain * (normal / stiffness - dent)
    slip, answer = creep(stiffness * dent, friction, track, robot)
    # Two short steps ahead give rate and bend of the dent along the motion.
    glance = GLANCE * track[PERIOD]
    moved = motion(slow, dent, 0.0, slip, look, robot)
    motor = torque_of(time, slow, moved[0], moved[1], saturated, robot, drive, probe)
    write_slow_rates(slow, dent, moved, motor, look, track, robot, rates)
    look_ahead(slow, rates, glance, ahead)
    there = outlook_near(look, glance * rates[WAY], glance * rates[PENDULUM_ANGLE], track)
    next_dent = dent
    for _ in range(2):
        normal, friction = asked(time + glance, ahead, next_dent, 0.0, saturated,
                                 there, track, robot, drive, probe)
        next_dent += gain * (normal / stiffness - next_dent)
    next_slip, _ = creep(stiffness * next_dent, friction, track, robot)
    moved = motion(ahead, next_dent, 0.0, next_slip, there, robot)
    motor = torque_of(time + glance, ahead, moved[0], moved[1], saturated, robot, drive, probe)
    write_slow_rates(ahead, next_dent, moved, motor, there, track, robot, rates)
    look_ahead(ahead, rates, glance, ahead)
    there = outlook_near(there, glance * rates[WAY], glance * rates[PENDULUM_ANGLE], track)
    last_dent = 2.0 * next_dent - dent
    normal, friction = asked(time + 2.0 * glance, ahead, last_dent, 0.0, saturated, there, track,
                             robot, drive, probe)
    last_dent += gain * (normal / stiffness - last_dent)
    last_slip, _ = creep(stiffness * last_dent, friction, track, robot)
    dent_rate = (-3.0 * dent + 4.0 * next_dent - last_dent) / (2.0 * glance)
    slip_rate = (-3.0 * slip + 4.0 * next_slip - last_slip) / (2.0 * glance)
    bend = (last_dent - 2.0 * next_dent + dent) / (glance * glance)
    # Once more, with the rates.
    moved = motion(slow, dent, -dent_rate, slip, look, robot)
    motor = torque_of(time, slow, moved[0], moved[1], saturated, robot, drive, probe)
    normal, _ = forces(slow, dent, moved, motor, -bend, slip_rate, look, track, robot)
    own = (normal - robot.damping * dent_rate) / stiffness
    lag = -answer * slip_inertia(dent, look, robot)
    settled = slip - lag * slip_rate
    write_following(time, slow, own, -dent_rate, settled, saturated, look, track, robot,
                    drive, probe, fast, rates)
    period, quickest = track[PERIOD], track[QUICKEST]
    ratio = min(1.0, quickest * (period * (quickest * period + GLANCE)
                                 + robot.damping / stiffness))
    fast[NEGLECTED] = (ratio * abs(own - dent)
                       + lag * lag * abs(slip_rate) * min(1.0, lag * quickest))
    if not (normal > 0.0 and abs(settled) <= MOST_FRICTION * robot.slip_threshold):
        fast[NEGLECTED] = math.inf


@compiled
def lift(slow: Any, fast: Any, track: Any, robot: Any, state: Any) -> None:
    """Write the full state of a slow one, and of what follows from it, into `state`."""
    for i in range(SIZE):
        state[i] = slow[i]
    normal_x, normal_y = normal_at(slow[WAY], track)
    speed, rise = fast[SPEED], fast[RISE]
    state[X], state[Y] = centre(
        slow[WAY], robot.radius - fast[OWN_DENT], normal_x, normal_y, track)
    state[BALL_RATE] = fast[OWN_RATE]
    state[PENDULUM_RATE] = fast[SWING_RATE]
    state[VELOCITY_X] = rise * normal_x + speed * normal_y
    state[VELOCITY_Y] = rise * normal_y - speed * normal_x


@outlined
def settle(state: Any, track: Any, robot: Any, slow: Any) -> tuple:
    """
    Write the slow state of a full one into `slow`.

    Returns
    -------
    dent, rise, slip : float
        What the slow state does not hold.

    """
    for i in range(SIZE):
        slow[i] = state[i]
    way, distance, normal_x, normal_y = place(state[X], state[Y], track)
    velocity_x, velocity_y = state[VELOCITY_X], state[VELOCITY_Y]
    rate, swing = state[BALL_RATE], state[PENDULUM_RATE]
    rise = velocity_x * normal_x + velocity_y * normal_y
    speed = velocity_x * normal_y - velocity_y * normal_x
    sine, cosine = math.sin(state[PENDULUM_ANGLE]), math.cos(state[PENDULUM_ANGLE])
    a_n = cosine * normal_x + sine * normal_y
    a_t = cosine * normal_y - sine * normal_x
    moment = robot.pendulum_moment
    lever = robot.radius if robot.radius_lever > 0.0 else distance
    own = robot.pendulum_inertia if robot.swing_inertia > 0.0 else 1.0
    slow[WAY] = way
    slow[SPIN] = robot.ball_inertia * rate - distance * (
        robot.mass * speed + moment * a_t * swing)
    slow[SWING] = own * swing + moment * (a_n * rise + a_t * speed)
    slow[Y] = slow[VELOCITY_X] = slow[VELOCITY_Y] = 0.0
    return robot.radius - distance, rise, speed + lever * rate

