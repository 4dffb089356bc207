# SPDX-License-Identifier: Apache-2.0
"""
The maximum step height of the ball, with an error bound.

Each height is one `attempt` of the adaptive method, a search is one call into compiled code,
and the scores of the attempts choose the next height.  The tests compare it with the paper's
ascending bracketing with a fixed-step method (test/oracles/reference_search.py).

Both ends of the bracket of a coarse tolerance are evaluated again with a finer one.  If both
results agree, the tolerance moves the maximum step height by less than the width of the
bracket; otherwise the search continues with the finer tolerance.  The reported error is the
width of the bracket plus the distance between the two brackets.

Like the paper, the search assumes that the ball crosses every step below one that it crosses.
The option `scan` checks this assumption.
"""
from concurrent.futures import ThreadPoolExecutor
import math
import os
from typing import Callable, List, NamedTuple, Optional, Sequence, Tuple, Union

import numpy as np

from ballbot_ros.config.columns import changed
from ballbot_ros.config.fields import check_value, count, quantity
from ballbot_ros.crossing.rules import check_gravity, HEIGHT, Rules, Site, SPEED, too_fast
from ballbot_ros.crossing.search import FINEST, TOO_FAST
from ballbot_ros.crossing.table import BUDGET, Crossings, DESK, TOLERANCE
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics.model.actuation import Actuation, refuse_degrees
from ballbot_ros.physics.model.contact_options import ContactOptions
from ballbot_ros.physics.model.robot import load_robot, Robot, RobotLike
from ballbot_ros.physics.simulation.failures import failure
from ballbot_ros.physics.simulation.solver import Solver
from ballbot_ros.physics.solvers.values import FINISHED

ACCURACY = quantity('m', 'largest error of the height', minimum=1e-8, maximum=1e-2).metadata
SCAN = count('heights on each side that are tried', maximum=10_000).metadata
# A law of actuation, or one for each speed [m/s].
Actuations = Union[Actuation, Callable[[float], Actuation]]


class MaxStepHeight(NamedTuple):
    """The highest step at one speed; all SI."""

    speed: float  # of the centre at first touch [m/s]
    height: float  # of a step that is passed, 0 if none is [m]
    error: float  # the highest one is at most this much higher or lower [m]
    monotone: Optional[bool]  # all lower steps are passed, no higher one; None: not looked
    attempts: int  # that it took
    work: int  # right-hand sides


def max_step_height(robot: RobotLike, speed: float, actuation: Actuation = Actuation(),
                    pendulum_angle: Optional[float] = None, accuracy: float = 5e-5,
                    site: Site = Site(), rules: Rules = Rules(),
                    options: ContactOptions = ContactOptions(), scan: int = 0) -> MaxStepHeight:
    """
    Find the maximum step height at a collision speed.

    Parameters
    ----------
    robot : Robot, or the name or file of one
    speed : float
        Speed of the centre at first contact [m/s], above 0.
    actuation : Actuation
        Applied from the first contact on.
    pendulum_angle : float, optional
        Absolute angle at first contact [rad]; by default the one that law (11) holds, else 0.
    accuracy : float
        Maximum error of the height [m].
    site : Site
        Slopes and frictions of the ground.
    rules : Rules
        Which attempts count, and for how long.
    options : ContactOptions
    scan : int
        Number of heights to check below the result (all must be crossed), and as many between
        the result and its double (none must be crossed).

    Returns
    -------
    MaxStepHeight
        Its ``error`` exceeds the accuracy where the finest tolerances do not agree.

    Raises
    ------
    ConfigurationError
        If an argument is out of range, or the ball crosses every height.
    SimulationError
        If an attempt fails.

    """
    accuracy = check_value('accuracy', accuracy, ACCURACY, 'max_step_height')
    scan = check_value('scan', scan, SCAN, 'max_step_height')
    robot = load_robot(robot)
    crossing = _prepare(robot, speed, actuation, pendulum_angle, site, rules, options)
    low, high, error, fine, outcome = crossing.found(accuracy)[0].tolist()
    if outcome == TOO_FAST:
        raise too_fast(robot, speed, high)
    _check(outcome, fine)
    monotone = None
    if scan > 0:
        parts = (np.arange(scan) + 0.5) / scan
        heights = np.concatenate([low * parts if low > 0.0 else [], high * (1.0 + parts)])
        overs = [_try(item, fine, crossing)[0] for item in heights.tolist()]
        monotone = overs == (heights < high).tolist()
    return MaxStepHeight(speed, low, error, monotone, *DESK.spent.tolist())


def _check(outcome: float, tolerance: float) -> None:
    """Raise the error that explains how the last attempt ended, if it did not end well."""
    if outcome != FINISHED:
        raise failure(int(outcome), float(DESK.last[1]), DESK.state, Solver(
            'adaptive', tolerance=max(tolerance, FINEST), work_budget=BUDGET))


def try_step(robot: RobotLike, speed: float, height: float, actuation: Actuation = Actuation(),
             pendulum_angle: Optional[float] = None, tolerance: float = TOLERANCE,
             site: Site = Site(), rules: Rules = Rules(),
             options: ContactOptions = ContactOptions()) -> Tuple[bool, float]:
    """
    Try one step.

    Parameters
    ----------
    height : float
        Of the step [m], above 0.
    tolerance : float
        Local error per step of the adaptive method [m].
    robot, speed, actuation, pendulum_angle, site, rules, options
        See `max_step_height`, also for its exceptions.

    Returns
    -------
    over : bool
    score : float
        By how much it succeeded (above 0) or failed [m2/s2]; see `attempt`.

    """
    height = check_value('height', height, HEIGHT, 'try_step')
    crossing = _prepare(
        load_robot(robot), speed, actuation, pendulum_angle, site, rules, options)
    return _try(height, tolerance, crossing)


def _try(height: float, tolerance: float, crossing: Crossings) -> Tuple[bool, float]:
    """Return whether the ball gets over, and the score."""
    passes, score, outcome = crossing.tried(np.array([height]), tolerance)[0].tolist()
    _check(outcome, tolerance)
    return passes > 0.0, score


def _prepare(robot: Robot, speed: float, actuation: Actuation, pendulum_angle: Optional[float],
             site: Site, rules: Rules, options: ContactOptions) -> Crossings:
    """Return one crossing as the kernels read it; checked."""
    speed = check_value('speed', speed, SPEED, 'max_step_height')
    check_gravity(robot)
    if not isinstance(actuation, Actuation):
        raise ConfigurationError(
            "max_step_height: actuation must be an Actuation, such as Actuation('velocity', "
            f'set_rate=3.0) or held_at(0.0), got {actuation!r}')
    actuation.check_fits(robot)
    if pendulum_angle is None:
        pendulum_angle = actuation.start_angle
    refuse_degrees('max_step_height: pendulum_angle', pendulum_angle)
    if not math.isfinite(pendulum_angle):
        raise ConfigurationError(
            'max_step_height: pendulum_angle must be any finite number rad, '
            f'got {pendulum_angle!r}')
    return Crossings.of(1, robot, speed, pendulum_angle, actuation, site, rules, options)


def max_step_heights(robot: RobotLike, speeds: Sequence[float],
                     actuation: Actuations = Actuation(),
                     pendulum_angle: Optional[float] = None, accuracy: float = 5e-5,
                     site: Site = Site(), rules: Rules = Rules(),
                     options: ContactOptions = ContactOptions(), scan: int = 0,
                     threads: Optional[int] = None) -> List[MaxStepHeight]:
    """
    Find the maximum step height at several speeds, in parallel.

    Parameters
    ----------
    speeds : sequence of float
        [m/s]
    actuation : Actuation, or a function that returns one for a speed
        Such as ``rolling(robot)``.
    threads : int, optional
        Number of parallel searches; by default one per core.
    robot, pendulum_angle, accuracy, site, rules, options, scan
        See `max_step_height`, also for its exceptions.

    """
    robot = load_robot(robot)

    def find(speed: float) -> MaxStepHeight:
        drive = actuation(speed) if callable(actuation) else actuation
        return max_step_height(robot, speed, drive, pendulum_angle, accuracy, site, rules,
                               options, scan)
    with ThreadPoolExecutor(threads or os.cpu_count() or 1) as pool:
        return list(pool.map(find, speeds))


def rolling(robot: Robot, actuation: Actuation = Actuation()) -> Callable[[float], Actuation]:
    """Return law (12) with the joint rate that rolls the ball at each speed."""
    return lambda speed: changed(
        actuation, {'law': 'velocity', 'set_rate': speed / robot.ball_radius})


def cruising(robot: Robot, actuation: Actuation = Actuation()) -> Callable[[float], Actuation]:
    """
    Return the open-loop voltage that rolls the ball at each speed on a level floor.

    There the motor carries the friction of joint and ball, (c1 + c2) v / R.

    Raises
    ------
    ConfigurationError
        If the robot has no motor.

    """
    motor = robot.motor
    if motor is None:
        raise ConfigurationError(
            f"law 'voltage' needs a motor and robot {robot.name!r} describes none; add a motor "
            'section to its file')
    per_volt = motor.gear_ratio * motor.gear_efficiency * motor.torque_constant / motor.resistance
    per_rate = ((robot.rolling_friction + robot.joint_friction) / per_volt
                + motor.gear_ratio * motor.speed_constant)
    return lambda speed: changed(
        actuation, {'law': 'voltage', 'voltage': per_rate * speed / robot.ball_radius})


def actuation_for(robot: Robot, actuation: Actuation) -> Callable[[float], Actuation]:
    """Return the actuation at each speed: a law (12), and a voltage of 0, follow it."""
    if actuation.law == 'velocity':
        return rolling(robot, actuation)
    if actuation.law == 'voltage' and np.all(actuation.voltage == 0.0):
        return cruising(robot, actuation)
    return lambda _: actuation
