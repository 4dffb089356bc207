# SPDX-License-Identifier: Apache-2.0
"""
Turn a decision into a pendulum angle for law (11).

The pendulum angle is the accelerator: leaning it forward by phi speeds the ball up by
about 0.78 sin(phi) m/s2 (GimBall), and law (11) follows a new angle within a quarter of a
second.  A gain from speed error to angle then makes a well damped speed loop.

Why not law (12), which controls speed already?  Its gravity compensation takes away what
would pull the pendulum down, and leaves a rocking of 3.2 s that is all but undamped: at
rest the ball would roll to and fro in front of the step.
"""
import math

from ballbot_ros.decision.tuning import DecisionTuning
from ballbot_ros.decision.values import Decision, Kind
from ballbot_ros.physics.model.robot import Robot

# A remaining gap smaller than this is none: the ball rests instead of creeping on [m].
REST = 0.01


def approach_speed(decision: Decision, robot: Robot, tuning: DecisionTuning) -> float:
    """
    Return the speed to drive at just now [m/s].

    With ``GO_ROUND`` the ball comes as near as the stop gap, braking on the way: the v for
    which v reaction_time + v^2 / (2 deceleration) equals the remaining gap.
    """
    if decision.kind is not Kind.GO_ROUND:
        return decision.set_speed
    gap = decision.distance - robot.ball_radius - tuning.stop_gap
    if not gap > REST:
        return 0.0
    lost = tuning.deceleration * tuning.reaction_time
    return min(decision.set_speed, math.sqrt(lost**2 + 2.0 * tuning.deceleration * gap) - lost)


def set_angle(decision: Decision, speed: float, robot: Robot, tuning: DecisionTuning) -> float:
    """
    Return the set angle of the pendulum for law (11) [rad].

    Parameters
    ----------
    decision : Decision
    speed : float
        Of the ball [m/s]; without a finite one the pendulum hangs down.
    robot : Robot
    tuning : DecisionTuning

    Returns
    -------
    float
        Absolute angle, positive to speed up.  A crossing that is slower than required
        leans as far as allowed, also in contact, where a raised pendulum helps over.

    """
    if not math.isfinite(speed):
        return 0.0
    most = tuning.largest_lean
    if decision.kind is Kind.CROSS and speed < decision.required_speed:
        return most
    angle = tuning.speed_gain * (approach_speed(decision, robot, tuning) - speed)
    return min(max(angle, -most), most)
