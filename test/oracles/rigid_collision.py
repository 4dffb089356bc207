# SPDX-License-Identifier: Apache-2.0
r"""
A rigid, impulsive collision with restitution and Coulomb friction, and a free pendulum.

The collision is instantaneous: positions are constant and velocities jump.  With normal n,
tangent t, impulses P_n and P_t, and a = (cos, sin)(phi), eqs. (3)-(6) give for the velocity of the
contact point, u_n = v_n and u_t = v_t + R theta1'::

    d u_n = w_nn d P_n + w_nt d P_t      w_nn = 1/M + q a_n^2      q = (m / M)^2 / I
    d u_t = w_nt d P_n + w_tt d P_t      w_tt = 1/M + q a_t^2 + R^2 / J1
                                         w_nt = q a_n a_t

*Friction* (Routh).  P_t follows P_n: while the contact slides, d P_t = -mu sign(u_t) d P_n; once
u_t = 0 it sticks, d P_t = -(w_nt / w_tt) d P_n, if the friction cone permits it; otherwise the
slip reverses.  P_t is therefore piecewise linear in P_n, with one bend at most.

*Restitution* (Stronge).  Compression ends with u_n = 0; then the contact returns e^2 of the
work of compression.  The energy therefore never increases, for any friction.

*The e of eq. (7).*  A mass 1/w on a spring and damper without pulling separates at N = 0 with

    e = exp(-z / sqrt(1 - z^2) (pi - 2 asin(z)))      z = kd / 2 sqrt(w / k)

of its speed; for z > 1 the exponent is -2 z acosh(z) / sqrt(z^2 - 1).  The full model converges
to this impulse for hard contacts and small slip thresholds, with w = d u_n / d P_n of sliding or
sticking; the limit is exact if the contact slides or sticks throughout.  The impulse neglects the
contact time of about ten milliseconds, during which the ball rolls and the pendulum swings.
"""
import math
from typing import NamedTuple

from ballbot_ros.physics import Model, Robot, State


class Blow(NamedTuple):
    """Result of a collision."""

    state: State  # just after it
    normal_impulse: float  # [N s]
    friction_impulse: float  # along (normal_y, -normal_x) [N s]
    sticks: bool  # whether the contact point ends without sliding
    lost: float  # energy [J]


def restitution(robot: Robot, compliance: float) -> float:
    """
    Return the coefficient of restitution of eq. (7).

    Parameters
    ----------
    robot : Robot
    compliance : float
        w, the change of speed per unit of impulse [1/kg].

    """
    damping = 0.5 * robot.contact_damping * math.sqrt(compliance / robot.contact_stiffness)
    if abs(damping - 1.0) < 1e-6:
        return math.exp(-2.0)
    if damping < 1.0:
        return math.exp(-damping / math.sqrt(1.0 - damping**2)
                        * (math.pi - 2.0 * math.asin(damping)))
    return math.exp(-2.0 * damping * math.acosh(damping) / math.sqrt(damping**2 - 1.0))


def collide(model: Model, state: State, normal_x: float, normal_y: float, friction: float,
            bounce: float = -1.0) -> Blow:
    """
    Return the result of a rigid collision of the ball.

    Parameters
    ----------
    model : Model
        Only its robot is used; motor and joint friction are negligible during an impact.
    state : State
        State just before the collision, with the contact point approaching the ground.
    normal_x, normal_y : float
        Outward unit normal of the ground.
    friction : float
        Coefficient of friction, at least 0; so small that d u_n / d P_n stays positive.
    bounce : float
        Coefficient of restitution, 0 to 1; less than 0 for that of eq. (7).

    """
    robot, numbers = model.robot, model.parameters
    tangent_x, tangent_y = normal_y, -normal_x
    approach = state.velocity_x * normal_x + state.velocity_y * normal_y
    slip = (state.velocity_x * tangent_x + state.velocity_y * tangent_y
            + robot.ball_radius * state.ball_rate)
    share = a_n = a_t = 0.0
    if robot.has_pendulum:
        cosine, sine = math.cos(state.pendulum_angle), math.sin(state.pendulum_angle)
        a_n, a_t = (cosine * normal_x + sine * normal_y, cosine * tangent_x + sine * tangent_y)
        share = (numbers.pendulum_moment / numbers.mass)**2 / numbers.swing_inertia
    w_nn = 1.0 / numbers.mass + share * a_n * a_n
    w_nt = share * a_n * a_t
    w_tt = 1.0 / numbers.mass + share * a_t * a_t + robot.ball_radius**2 / robot.ball_inertia
    pieces = _course(slip, friction, w_nn, w_nt, w_tt)
    if bounce < 0.0:
        bounce = restitution(robot, pieces[0][2])
    normal, along = _impulses(approach, pieces, bounce)
    after, lost = _apply(model, state, (normal_x, normal_y), normal, along, a_n, a_t)
    end = slip + w_nt * normal + w_tt * along
    return Blow(after, normal, along, abs(end) <= 1e-12 * (abs(slip) + abs(approach)), lost)


def _course(slip: float, friction: float, w_nn: float, w_nt: float, w_tt: float) -> list:
    """Return the pieces of P_t(P_n): normal impulse at the end, d P_t / d P_n, d u_n / d P_n."""
    stick = -w_nt / w_tt
    pieces = []
    if slip != 0.0:
        ratio = -math.copysign(friction, slip)
        slowing = w_nt + w_tt * ratio  # d u_t / d P_n
        end = -slip / slowing if slip * slowing < 0.0 else math.inf
        pieces.append((end, ratio, w_nn + w_nt * ratio))
        if end == math.inf:
            return pieces
    # Without slip: the contact sticks within the cone, or slides as the coupling drives it.
    ratio = stick if abs(stick) <= friction else math.copysign(friction, stick)
    return [*pieces, (math.inf, ratio, w_nn + w_nt * ratio)]


def _impulses(approach: float, pieces: list, bounce: float) -> tuple:
    """Return the normal and the friction impulse at the end of restitution."""
    normal = along = work = 0.0
    speed, compressing, target = approach, True, 0.0
    for end, ratio, rise in pieces:
        while True:
            if compressing:
                step = min(-speed / rise, end - normal)
            else:
                # The work of restitution, u P + w P^2 / 2, up to its target.
                left = target - work
                step = min((math.sqrt(speed * speed + 2.0 * rise * left) - speed) / rise,
                           end - normal)
            work += step * (speed + 0.5 * rise * step)
            normal, along = normal + step, along + ratio * step
            speed += rise * step
            if compressing and normal < end:
                compressing, target, work, speed = False, -bounce * bounce * work, 0.0, 0.0
                continue
            if normal >= end:
                break
            return normal, along
    return normal, along


def _apply(model: Model, state: State, direction: tuple, normal: float, along: float, a_n: float,
           a_t: float) -> tuple:
    """Return the state after the impulses, and the dissipated energy."""
    robot, numbers = model.robot, model.parameters
    normal_x, normal_y = direction
    swing = 0.0
    if robot.has_pendulum:
        swing = -numbers.pendulum_moment / numbers.mass * (
            a_n * normal + a_t * along) / numbers.swing_inertia
    push_x = normal * normal_x + along * normal_y
    push_y = normal * normal_y - along * normal_x
    kick = numbers.pendulum_moment * swing
    after = state._replace(
        ball_rate=state.ball_rate + robot.ball_radius * along / robot.ball_inertia,
        pendulum_rate=state.pendulum_rate + swing,
        velocity_x=state.velocity_x + (
            push_x - kick * math.cos(state.pendulum_angle)) / numbers.mass,
        velocity_y=state.velocity_y + (
            push_y - kick * math.sin(state.pendulum_angle)) / numbers.mass)
    return after, model.energies(state).kinetic - model.energies(after).kinetic
