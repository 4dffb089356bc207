# SPDX-License-Identifier: Apache-2.0
"""
Torque of the pendulum motor: laws (11), (12) and the DC motor, as pure functions.

The simulator's own actuation and the controller node call these same functions.  All
angles are counter-clockwise positive; ``pendulum_angle`` is absolute (theta1 + theta2, 0
hanging down, positive towards +x), ``joint_rate`` is theta2', relative to the ball.
"""
import math

from ballbot_ros.jit import compiled


@compiled
def position_torque(pendulum_angle: float, pendulum_rate: float, set_angle: float,
                    kp: float, kd: float, gravity_torque: float) -> float:
    """
    Return the torque of the position law, eq. (11) [N m].

    Parameters
    ----------
    pendulum_angle, pendulum_rate : float
        Absolute angle [rad] and rate [rad/s].
    set_angle : float
        Wanted absolute angle [rad].
    kp, kd : float
        Gains [N m/rad], [N m s/rad]; 40 and 10 in the paper.
    gravity_torque : float
        M2 g e [N m], or 0 to leave gravity compensation out.

    """
    return (position_feedback(pendulum_angle, pendulum_rate, set_angle, kp, kd)
            + gravity_torque * math.sin(pendulum_angle))


@compiled
def position_feedback(pendulum_angle: float, pendulum_rate: float, set_angle: float, kp: float,
                      kd: float) -> float:
    """Return the result of `position_torque` without gravity compensation [N m]."""
    return kp * (set_angle - pendulum_angle) - kd * pendulum_rate


@compiled
def velocity_torque(pendulum_angle: float, joint_rate: float, joint_lag: float,
                    set_rate: float, kp: float, ki: float, gravity_torque: float) -> float:
    """
    Return the torque of the velocity law, eq. (12) [N m].

    Parameters
    ----------
    pendulum_angle : float
        Absolute angle [rad], for gravity compensation.
    joint_rate : float
        theta2', rate of the joint [rad/s].  Rolling forward at v, it is v / R.
    joint_lag : float
        Integral of the rate error since the set-point was given [rad]; the paper's
        ``set_rate * t - theta2``.
    set_rate : float
        Wanted theta2' [rad/s].
    kp, ki : float
        Gains [N m s/rad], [N m/rad]; 10 and 0 in the paper.
    gravity_torque : float
        M2 g e [N m], or 0 to leave gravity compensation out.

    """
    return (velocity_feedback(joint_rate, joint_lag, set_rate, kp, ki)
            + gravity_torque * math.sin(pendulum_angle))


@compiled
def velocity_feedback(joint_rate: float, joint_lag: float, set_rate: float, kp: float,
                      ki: float) -> float:
    """Return the result of `velocity_torque` without gravity compensation [N m]."""
    return kp * (set_rate - joint_rate) + ki * joint_lag


@compiled
def motor_torque(voltage: float, joint_rate: float, stall_torque_per_volt: float,
                 back_voltage: float) -> float:
    """
    Return the torque of a DC motor and gear at the joint [N m].

    Parameters
    ----------
    voltage : float
        Armature voltage [V].
    joint_rate : float
        theta2' [rad/s].
    stall_torque_per_volt : float
        gear_ratio gear_efficiency torque_constant / resistance [N m/V].
    back_voltage : float
        gear_ratio speed_constant [V s/rad].

    """
    return stall_torque_per_volt * (voltage - back_voltage * joint_rate)


@compiled
def available_torque(joint_rate: float, stall_torque_per_volt: float, back_voltage: float,
                     supply: float, maximum_torque: float) -> tuple[float, float]:
    """
    Return the lowest and the highest torque that a DC motor can give at a rate [N m].

    Its speed-torque lines at minus and plus the supply voltage, cut to the largest torque.
    Against the rotation there is more than along it, for the back voltage helps then; beyond
    the idle speed supply / back_voltage even full voltage brakes.

    Parameters
    ----------
    joint_rate : float
        theta2' [rad/s].
    stall_torque_per_volt, back_voltage : float
        As in `motor_torque`.
    supply : float
        Voltage [V]; the armature gets any between minus and plus this.
    maximum_torque : float
        At the joint [N m].

    """
    return (
        limited(motor_torque(-supply, joint_rate, stall_torque_per_volt, back_voltage),
                maximum_torque),
        limited(motor_torque(supply, joint_rate, stall_torque_per_volt, back_voltage),
                maximum_torque))


@compiled
def applied_torque(asked: float, joint_rate: float, line: tuple[float, float, float, float],
                   limit: float) -> float:
    """
    Return the torque at the joint for the requested torque of a control law [N m].

    First the speed-torque line of the motor cuts it, then the limit of the drive: beyond the
    idle speed, where the line leaves braking only, a drive does not exceed its limit either.

    Parameters
    ----------
    asked : float
        [N m]
    joint_rate : float
        theta2' [rad/s].
    line : tuple of 4 floats
        See `Robot.motor_line`.
    limit : float
        [N m]

    """
    stall_torque_per_volt, back_voltage, supply, maximum_torque = line
    lowest, highest = available_torque(
        joint_rate, stall_torque_per_volt, back_voltage, supply, maximum_torque)
    return limited(min(max(asked, lowest), highest), limit)


@compiled
def limited(torque: float, limit: float) -> float:
    """Return `torque` cut to [-limit, limit]."""
    return min(max(torque, -limit), limit)
