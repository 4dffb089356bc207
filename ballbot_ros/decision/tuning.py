# SPDX-License-Identifier: Apache-2.0
"""Decision tuning: speeds, margins and timeouts."""
from dataclasses import dataclass

from ballbot_ros.config.fields import Checked, count, fixed, quantity
from ballbot_ros.config.files import load_config
from ballbot_ros.control import RollingModel
from ballbot_ros.crossing.rules import CLEARANCE
from ballbot_ros.decision.planning.curve import HeightCurve
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics.model.robot import Robot

# Reason why some values cannot change during an approach.
SEEN = 'earlier observations depend on it'
# Law and set angle [rad] at the touch of an approach that is planned by a height curve.
APPROACH = ('position', 0.0)


@dataclass(frozen=True)
class DecisionTuning(Checked):
    """
    Parameters of the decision and the approach.

    Raises
    ------
    ConfigurationError
        If a value is out of range, the cruise speed is above the highest speed, or the
        emergency lean is below the largest lean.

    """

    cruise_speed: float = quantity(
        'm/s', 'speed without an obstacle', above=0.0, maximum=10.0, default=0.4)
    highest_speed: float = quantity(
        'm/s', 'highest set speed', above=0.0, maximum=10.0, default=1.1)
    acceleration: float = quantity(
        'm/s2', 'guaranteed acceleration', above=0.0, maximum=20.0, default=0.46)
    deceleration: float = quantity(
        'm/s2', 'guaranteed deceleration', above=0.0, maximum=20.0, default=0.4)
    reaction_time: float = quantity(
        's', 'time until a set angle is commanded and the pendulum starts to follow', above=0.0,
        maximum=5.0, default=0.2)
    speed_margin: float = quantity(
        '1', 'fraction by which the required speed is increased', minimum=0.0, maximum=1.0,
        default=0.08)
    height_margin: float = quantity(
        'm', 'margin added to the height of a step', minimum=0.0, maximum=0.5, default=0.002)
    sigma_margin: float = quantity(
        '1', 'number of standard deviations added to the height of a step', minimum=0.0,
        maximum=10.0, default=2.0)
    stop_gap: float = quantity(
        'm', 'gap between the resting ball and the step', minimum=0.0, maximum=10.0, default=0.25)
    largest_lean: float = quantity(
        'rad', 'largest pendulum angle', above=0.0, maximum=1.5, default=0.7)
    emergency_lean: float = quantity(
        'rad', 'largest pendulum angle if the ball would otherwise not stop in time',
        above=0.0, maximum=1.55, default=1.4)
    largest_swing: float = quantity(
        'rad', 'largest pendulum angle of a swing before or on a step', minimum=0.0, maximum=3.1,
        default=2.6)
    observation_timeout: float = quantity(
        's', 'age at which an observation expires', above=0.0, maximum=60.0, default=0.6)
    contradiction_sigma: float = fixed(SEEN, quantity(
        '1', 'standard deviations beyond which an observation contradicts the estimate', above=0.0,
        maximum=100.0, default=5.0))
    forget_after: int = fixed(SEEN, count(
        'consecutive contradictions after which the newest observation replaces the estimate',
        minimum=1, default=5))

    required_probability: float = quantity(
        '1', 'required success probability of a crossing', minimum=0.5,
        maximum=0.999, default=0.9)
    room_behind: float = fixed('it applies to the start position of the ball', quantity(
        'm', 'length of ground behind the start position that is known to be free', minimum=0.0,
        maximum=1000.0, default=0.0))
    unseen_room: float = quantity(
        'm', 'length of floor assumed behind each edge where a sensor does not '
        'observe it; a stop takes 1 m; 0: such an edge is not crossed', minimum=0.0,
        maximum=100.0, default=0.0)
    highest_descent: float = quantity(
        'm', 'highest step down that may be crossed; a higher one is a drop', minimum=0.0,
        maximum=1.0, default=0.05)
    actuation_delay: float = quantity(
        's', 'time from an odometry message until the resulting set angle takes effect',
        minimum=0.0, maximum=0.5, default=0.0)
    height_bias_sd: float = fixed(SEEN, quantity(
        'm', 'standard deviation of the constant error of a height sensor',
        minimum=0.0, maximum=0.1, default=0.0005))
    unreported_bias_sd: float = fixed(SEEN, quantity(
        'm', 'height_bias_sd of a sensor that does not report its standard deviation', minimum=0.0,
        maximum=0.1, default=0.002))

    def __post_init__(self) -> None:
        """Check each value, then their consistency."""
        super().__post_init__()
        if self.cruise_speed > self.highest_speed:
            raise ConfigurationError(
                f'DecisionTuning: cruise_speed must be at most highest_speed '
                f'({self.highest_speed:g} m/s), got {self.cruise_speed:g} m/s',
                'inconsistent', 'cruise_speed')
        if self.emergency_lean < self.largest_lean:
            raise ConfigurationError(
                f'DecisionTuning: emergency_lean must be at least largest_lean '
                f'({self.largest_lean:g} rad), got {self.emergency_lean:g} rad',
                'inconsistent', 'emergency_lean')

    @property
    def dead_time(self) -> float:
        """Return the time from an odometry message until the pendulum starts to follow [s]."""
        return self.reaction_time + self.actuation_delay

    def height_bias(self, reported: bool) -> float:
        """Return the bias deviation of heights with or without `reported` deviations [m]."""
        return self.height_bias_sd if reported else max(
            self.height_bias_sd, self.unreported_bias_sd)


def load_decision_tuning(name_or_path: str) -> DecisionTuning:
    """
    Read a decision tuning by name or path.

    Raises
    ------
    ConfigurationError
        With file, field, value and allowed range.

    """
    return load_config(DecisionTuning, 'decision_tunings', name_or_path)


def check_decision(robot: Robot, curve: HeightCurve, tuning: DecisionTuning) -> None:
    """
    Check that robot, curve and tuning are consistent.

    Raises
    ------
    ConfigurationError
        If the curve is for another robot, success criterion, control law or pendulum angle, starts
        above the maximum speed or has a residual above the height margin, or if the pendulum
        cannot produce the assumed accelerations.

    """
    if curve.robot != robot.name:
        raise ConfigurationError(
            f'curve {curve.name} was made for {curve.robot}, not for {robot.name}: make one '
            'for this robot', 'inconsistent', 'curve')
    if curve.made is not None and curve.made.robot_digest != robot.digest:
        raise ConfigurationError(
            f'curve {curve.name} was made for a {robot.name} with other parameters (digest '
            f'{curve.made.robot_digest}, this one has {robot.digest}): make it again with '
            'ballbot fit-curve', 'inconsistent', 'curve')
    if curve.made is not None and curve.made.clearance < CLEARANCE:
        rule = 'its centre has passed the edge' if curve.made.over == 'edge' else \
            f'it gets {curve.made.clearance:g} radii beyond the edge'
        raise ConfigurationError(
            f'curve {curve.name} was made by the rule that a ball is over when {rule}; from there '
            f'it may roll back, so a decision needs at least {CLEARANCE:g} radii: make it again '
            'with ballbot fit-curve --over clear', 'inconsistent', 'curve')
    if tuning.highest_speed < curve.lowest_speed:
        raise ConfigurationError(
            f'highest_speed must be at least the lowest speed of curve {curve.name} '
            f'({curve.lowest_speed:g} m/s), got {tuning.highest_speed:g} m/s',
            'inconsistent', 'highest_speed')
    if tuning.height_margin < curve.residual:
        raise ConfigurationError(
            f'height_margin must be at least the residual of curve {curve.name} '
            f'({curve.residual:g} m), got {tuning.height_margin:g} m',
            'inconsistent', 'height_margin')
    if curve.made is not None and (curve.made.law, curve.made.set_angle) != APPROACH:
        raise ConfigurationError(
            f'curve {curve.name} is for law {curve.made.law} at a set angle of '
            f'{curve.made.set_angle:g} rad, but at the touch the pendulum is held by law '
            f'{APPROACH[0]} at {APPROACH[1]:g} rad: make a curve for that',
            'inconsistent', 'curve')
    possible = RollingModel(robot).held_acceleration(tuning.largest_lean)
    for name in ('acceleration', 'deceleration'):
        if getattr(tuning, name) > possible:
            raise ConfigurationError(
                f'{name} must be at most {possible:.3g} m/s2, which {robot.name} reaches at a '
                f'largest_lean of {tuning.largest_lean:g} rad, got {getattr(tuning, name):g} '
                'm/s2', 'out_of_range', name)
