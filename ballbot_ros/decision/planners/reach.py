# SPDX-License-Identifier: Apache-2.0
"""What a step asks for and what the ball can give from where it is."""
from dataclasses import dataclass
import math
from typing import Optional

from ballbot_ros.crossing.rules import touch_distance
from ballbot_ros.decision.curve import HeightCurve
from ballbot_ros.decision.profile import Face
from ballbot_ros.decision.tuning import DecisionTuning
from ballbot_ros.physics.model.robot import Robot


@dataclass(frozen=True)
class Reach:
    """
    What a step asks for and what can be had; all speeds are those at touch.

    Attributes
    ----------
    conservative : float
        Height with its margins [m].
    run_up : float
        Distance until touch [m].
    top : float
        What is allowed and still on the curve [m/s].
    required : float or None
        With its margin; None above the end of the curve [m/s].
    reachable : float
        Speeding up from here, at most `top` [m/s].
    slowest : float
        Braking from here [m/s].
    spare : float
        What could be added to the height until `reachable` is not enough, negative where it
        is not; NaN where `reachable` lies below the curve [m].

    """

    conservative: float
    run_up: float
    top: float
    required: Optional[float]
    reachable: float
    slowest: float
    spare: float


def reach(step: Face, distance: float, speed: float, margins: tuple[float, float, float],
          robot: Robot, curve: HeightCurve, tuning: DecisionTuning) -> Reach:
    """
    Return what the step asks for and what can be had.

    Parameters
    ----------
    step : Face
    distance : float
        Ball's centre to the face [m].
    speed : float
        Now [m/s].
    margins : tuple of float
        Added to the speed as a part of it [1], to the height [m], and to the height in standard
        deviations of it [1].
    robot, curve, tuning

    """
    speed_margin, height_margin, sigma_margin = margins
    # A deviation below zero is none; it must never make the step look lower.
    conservative = step.height + sigma_margin * max(0.0, step.height_sd) + height_margin
    run_up = max(0.0, distance - touch_distance(robot.ball_radius, step.height))
    required = curve.required_speed(conservative)
    forward = max(0.0, speed)
    top = min(tuning.highest_speed, curve.highest_speed)
    # Products, for a power of a mad speed would raise; infinity compares as it should.
    reachable = min(top, math.sqrt(forward * forward + 2.0 * tuning.acceleration * run_up))
    clean = reachable / (1.0 + speed_margin)
    return Reach(
        conservative=conservative, run_up=run_up, top=top,
        required=None if required is None else required * (1.0 + speed_margin),
        reachable=reachable,
        slowest=math.sqrt(max(0.0, forward * forward - 2.0 * tuning.deceleration * run_up)),
        spare=(curve.height(clean) - conservative if clean >= curve.lowest_speed
               else math.nan))
