# SPDX-License-Identifier: Apache-2.0
"""
Speed control by the angle of the pendulum, with compensation of slopes.

A pendulum at the angle phi accelerates the ball along a slope s (positive where it rises
towards +x) by::

    a = R (M2 g e sin(phi) - D) / (J1 + M R^2 - M2 e R cos(phi - s)),   D = M g R sin(s)

An observer estimates the resistance D from speed and pendulum angle.  It uses the measured angle,
not the set angle, so it does not wind up while the pendulum moves or is at its largest lean, as an
integral of the speed error would.  The desired angle compensates D and gives the acceleration
speed_gain (set_speed - speed); the set angle for law (11) leads it, because law (11) lags by
kd / kp.  See docs/speed_law.md.

All functions are pure and compiled.  From Python, pass ``law[:]`` for a `SpeedLaw`: kernels take
plain tuples.
"""
import math
from typing import NamedTuple

from ballbot_ros.control.rolling_model import RollingModel
from ballbot_ros.control.tuning import ControlTuning
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.jit import compiled
from ballbot_ros.physics.model.robot import Robot

# The numbers of a `SpeedLaw`.
Numbers = tuple[float, float, float, float, float, float, float, float, float]

FURTHEST = math.pi / 2.0  # limit of the set angle: a level pendulum [rad]
MOST_RESISTANCE = 1.5  # limit, relative to the resistance that a level pendulum holds
BRAKING = 0.7  # fraction of the possible deceleration used on the approach to a position
LEAST_BRAKING = 0.02  # [m/s2]
SHORTFALL_RATE = 3.0  # rate of the low-pass filter for the steady-state error of law (11) [1/s]
MOST_SHORTFALL = 0.35  # [rad]


class SpeedState(NamedTuple):
    """State of the speed law between two steps."""

    speed: float  # estimated [m/s]
    resistance: float  # estimated [N m]
    angle: float  # of the pendulum at the last step [rad]
    predicted: float  # angle of the pendulum, by law (11) without its error [rad]
    shortfall: float  # mean steady-state error of law (11) [rad]
    set_angle: float  # at the last step [rad]


class SpeedLaw(NamedTuple):
    """Parameters of robot and gains for the functions of this module."""

    gravity_torque: float  # M2 g e [N m]
    weight_torque: float  # M g R [N m]
    inertia: float  # J1 + M R^2 [kg m2]
    coupling: float  # M2 e R [kg m2]
    radius: float  # [m]
    lag: float  # kd / kp of law (11) [s]
    speed_gain: float  # desired acceleration per speed error [1/s]
    swing_time: float  # response time of the pendulum to the desired angle [s]
    observer_rate: float  # convergence rate of the resistance estimate [1/s]

    @classmethod
    def tuned(cls, robot: Robot, tuning: ControlTuning) -> 'SpeedLaw':
        """
        Return the law for a robot whose controller has these gains.

        Raises `ConfigurationError` if the robot has no pendulum, or law (11) lacks a gain.
        """
        rolling = RollingModel(robot).own
        if tuning.position_kp == 0.0 or tuning.position_kd == 0.0:
            raise ConfigurationError(
                'the speed law needs a law (11) that follows set angles: position_kp and '
                f'position_kd above 0, got {tuning.position_kp:g} and {tuning.position_kd:g}',
                'inconsistent', 'position_kp')
        return cls(
            rolling.gravity_torque, rolling.weight_torque, rolling.ball_inertia, rolling.lever,
            robot.ball_radius, tuning.position_kd / tuning.position_kp, tuning.speed_gain,
            tuning.swing_time, tuning.observer_rate)


@compiled
def speed_law_start(speed: float, pendulum_angle: float, slope: float, law: Numbers) -> SpeedState:
    """Return the initial state of the law at a speed [m/s] on an expected slope [rad]."""
    return SpeedState(speed, SpeedLaw(*law).weight_torque * math.sin(slope), pendulum_angle,
                      pendulum_angle, 0.0, pendulum_angle)


@compiled
def acceleration(pendulum_angle: float, slope: float, law: Numbers) -> float:
    """Return the acceleration along a slope with a held pendulum, without friction [m/s2]."""
    own = SpeedLaw(*law)
    return own.radius * (
        own.gravity_torque * math.sin(pendulum_angle) - own.weight_torque * math.sin(slope)) / (
            own.inertia - own.coupling * math.cos(pendulum_angle - slope))


@compiled
def wanted_angle(wanted: float, resistance: float, lean: float, law: Numbers) -> float:
    """
    Return the pendulum angle for an acceleration against a resistance, within +-lean [rad].

    Parameters
    ----------
    wanted : float
        Acceleration [m/s2].
    resistance : float
        [N m] about the contact; on a slope s it is M g R sin(s).
    lean : float
        [rad], at most pi / 2.
    law : Numbers

    """
    own = SpeedLaw(*law)
    # R M2 g e sin(phi) + a M2 e R cos(phi) = a (J1 + M R^2) + R D
    along, across = own.radius * own.gravity_torque, wanted * own.coupling
    share = (wanted * own.inertia + own.radius * resistance) / math.hypot(along, across)
    angle = math.asin(min(max(share, -1.0), 1.0)) - math.atan2(across, along)
    return min(max(angle, -lean), lean)


@compiled
def motion_law_step(state: SpeedState, speed: float, pendulum_angle: float, set_speed: float,
                    set_acceleration: float, lean: float, period: float, law: Numbers
                    ) -> tuple[SpeedState, float]:
    """
    Return the next state of the law, and the set angle for law (11) [rad].

    Parameters
    ----------
    state : SpeedState
        See `speed_law_start`.
    speed : float
        Speed of the ball [m/s].
    pendulum_angle : float
        Absolute [rad]; NaN if not measured: then it is predicted from the set angles.
    set_speed, set_acceleration : float
        [m/s] and its time derivative [m/s2].
    lean : float
        Largest desired angle of the pendulum [rad], at most pi / 2.
    period : float
        Time since the last step, above 0 [s].
    law : Numbers

    """
    own = SpeedLaw(*law)
    estimate, resistance, before, followed, shortfall, set_angle = state
    followed = set_angle + (followed - set_angle) * math.exp(-period / own.lag)
    angle = followed if math.isnan(pendulum_angle) else pendulum_angle
    # The observer has both poles at observer_rate, for any period.
    middle = 0.5 * (before + angle)
    inertia = (own.inertia - own.coupling * math.cos(middle)) / own.radius
    estimate += period * (own.gravity_torque * math.sin(middle) - resistance) / inertia
    error, pole = speed - estimate, math.exp(-own.observer_rate * period)
    estimate += (1.0 - pole * pole) * error
    most = MOST_RESISTANCE * own.gravity_torque
    resistance -= (1.0 - pole) * (1.0 - pole) / period * inertia * error
    resistance = min(max(resistance, -most), most)
    # Mean steady-state error of law (11).
    shortfall += (1.0 - math.exp(-SHORTFALL_RATE * period)) * (followed - angle - shortfall)
    shortfall = min(max(shortfall, -MOST_SHORTFALL), MOST_SHORTFALL)
    wanted = wanted_angle(set_acceleration + own.speed_gain * (set_speed - estimate),
                          resistance, lean, law)
    lead = max(own.lag / own.swing_time - 1.0, 0.0)
    set_angle = wanted + lead * (wanted - angle) + shortfall
    set_angle = min(max(set_angle, -FURTHEST), FURTHEST)
    return SpeedState(estimate, resistance, angle, followed, shortfall, set_angle), set_angle


@compiled
def speed_law_step(state: SpeedState, speed: float, pendulum_angle: float, set_speed: float,
                   lean: float, period: float, law: Numbers) -> tuple[SpeedState, float]:
    """Drive at a constant set speed, 0 to stop; see `motion_law_step`."""
    return motion_law_step(state, speed, pendulum_angle, set_speed, 0.0, lean, period, law)


@compiled
def place_law_step(state: SpeedState, speed: float, pendulum_angle: float, gap: float,
                   top_speed: float, lean: float, period: float, law: Numbers
                   ) -> tuple[SpeedState, float]:
    """
    Stop at a position and hold it; see `motion_law_step`.

    The set speed v solves gap = v / speed_gain + v^2 / (2 b), with b = BRAKING times the
    deceleration by the lean under the estimated resistance, to avoid overshoot.  The gap is the
    distance from the ball to the position, positive towards +x [m]; `top_speed` limits v [m/s].
    """
    own = SpeedLaw(*law)
    ahead = math.copysign(1.0, gap)
    braking = max(LEAST_BRAKING, BRAKING * own.radius * (
        own.gravity_torque * math.sin(lean) + ahead * state.resistance) / own.inertia)
    lost = braking / own.speed_gain
    distance = math.fabs(gap)
    set_speed = 2.0 * braking * distance / (
        math.sqrt(lost * lost + 2.0 * braking * distance) + lost)
    # d(set_speed)/dt while the gap closes with the speed of the ball
    change = -speed * braking / (lost + set_speed) if set_speed <= top_speed else 0.0
    set_speed = min(set_speed, top_speed)
    return motion_law_step(
        state, speed, pendulum_angle, ahead * set_speed, change, lean, period, law)


@compiled
def estimated_slope(state: SpeedState, law: Numbers) -> float:
    """Return the slope that the law estimates, positive uphill towards +x [rad]."""
    return math.asin(min(max(state.resistance / SpeedLaw(*law).weight_torque, -1.0), 1.0))


@compiled
def holding_angle(slope: float, law: Numbers) -> float:
    """Return the pendulum angle that holds the ball on a slope, NaN if too steep [rad]."""
    own = SpeedLaw(*law)
    share = own.weight_torque * math.sin(slope) / own.gravity_torque
    return math.asin(share) if -1.0 <= share <= 1.0 else math.nan


@compiled
def steepest_slope(lean: float, law: Numbers) -> float:
    """Return the steepest slope that a lean holds, asin(M2 e sin(lean) / (M R)) [rad]."""
    own = SpeedLaw(*law)
    return math.asin(min(own.gravity_torque * math.sin(lean) / own.weight_torque, 1.0))


@compiled
def braking_distance(speed: float, slope: float, lean: float, reaction: float,
                     law: Numbers) -> float:
    """
    Return the stopping distance of `speed_law_step`, for a set speed of 0 [m].

    It is v (reaction + swing_time) + v^2 / (2 b) + b / (2 speed_gain^2), as the lean decreases
    below b / speed_gain; for a v below that, v (reaction + swing_time + 1 / speed_gain); infinity
    if the ball cannot brake.

    Parameters
    ----------
    speed : float
        Towards +x [m/s], rolling steadily; the distance is 0 for a negative speed.
    slope : float
        Positive where it rises towards +x [rad].
    lean : float
        Lean of the pendulum against the motion [rad].
    reaction : float
        Delay of the set angle [s].
    law : Numbers

    """
    if speed <= 0.0:
        return 0.0
    braking = -acceleration(-lean, slope, law)
    if braking <= 0.0:
        return math.inf
    own = SpeedLaw(*law)
    eased = min(speed, braking / own.speed_gain)
    return (speed * (reaction + own.swing_time) + (speed * speed - eased * eased) / (2.0 * braking)
            + eased / own.speed_gain)


@compiled
def stopping_speed(gap: float, slope: float, lean: float, reaction: float,
                   law: Numbers) -> float:
    """
    Return the speed from which the ball stops within a gap: inverse of `braking_distance` [m/s].

    It is 0 without a gap, or if the ball cannot brake.
    """
    braking = -acceleration(-lean, slope, law)
    if gap <= 0.0 or braking <= 0.0:
        return 0.0
    own = SpeedLaw(*law)
    delay, eased = reaction + own.swing_time, braking / own.speed_gain
    if gap <= eased * (delay + 1.0 / own.speed_gain):
        return gap / (delay + 1.0 / own.speed_gain)
    lost, gap = braking * delay, gap - 0.5 * eased / own.speed_gain
    return 2.0 * braking * gap / (math.sqrt(lost * lost + 2.0 * braking * gap) + lost)
