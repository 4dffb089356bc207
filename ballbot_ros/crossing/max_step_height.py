# SPDX-License-Identifier: Apache-2.0
"""
The maximum step height of the ball, with an error bound.

Each height is one `attempt` with the adaptive method, a search is one call into compiled code,
and the scores of the attempts determine the next height.  The tests compare it with the paper's
ascending bracketing with a fixed-step method (test/oracles/reference_search.py).

Both ends of the bracket of a coarse tolerance are evaluated again with a finer one.  If both
results agree, the tolerance moves the maximum step height by less than the width of the
bracket; otherwise the search continues with the finer tolerance.  The reported error is the
width of the bracket plus the distance between the two brackets.

Like the paper, the search assumes that the ball crosses every step lower than one it crosses.
The option `scan` checks this assumption.
"""
from concurrent.futures import ThreadPoolExecutor
import os
from threading import local
from typing import (
    Any, Callable, Iterable, Iterator, List, NamedTuple, Optional, Sequence, Tuple, TypeVar, Union)
import warnings

import numpy as np

from ballbot_ros.config.fields import changed, check_value, count, quantity
from ballbot_ros.crossing.attempt import (
    attempt, Course, Crossing, find, FINEST, TOO_FAST, VERTICES)
from ballbot_ros.crossing.rules import check_gravity, HEIGHT, Rules, Site, SPEED, table
from ballbot_ros.errors import ConfigurationError, PlausibilityWarning
from ballbot_ros.jit import direct, row_reader, unlocked
from ballbot_ros.physics.mechanics.contact import IntArray
from ballbot_ros.physics.mechanics.equations import read_actuator, read_parameters, System
from ballbot_ros.physics.model.actuation import Actuation, refuse_degrees, set_rate_for_speed
from ballbot_ros.physics.model.robot import (
    ContactOptions, edge_warnings, load_robot, Parameters, Robot, RobotLike)
from ballbot_ros.physics.model.state import BALL_RATE, SIZE
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.simulation.solver import failure, Solver
from ballbot_ros.physics.solvers.values import (
    FINISHED, NO_OUTPUT, Output, Packed, unpack_workspace, Workspace)

ATTEMPT_TOLERANCE = 1e-7  # local error per step in `try_step` [m]
BUDGET = 50_000_000  # function evaluations of one attempt; they take seconds

# Columns of the results: the outcome, and for a step that was tried its score [m2/s2], see
# `attempt`, and the speed from the rotation of the ball at the verdict [m/s] ...
OUTCOME, SCORE, ROLLED = range(3)
# ... or for a maximum step height, see `attempt.find`.
LOW, HIGH, ERROR, FINE = range(1, 5)
SEARCHED: Array = np.zeros(0)  # the heights of crossings whose maximum step height is searched

# Arrays of `Crossing`: state, before, last, spent, output, workspace.
PackedArrays = tuple[Array, Array, Array, IntArray, Packed, Packed]


read_course = row_reader(Course)
# Column of the first field of each in a row.
PARAMETERS = len(Course._fields)
ACTUATOR = PARAMETERS + len(Parameters._fields)


@unlocked
def cross_rows(rows: Array, grounds: Array, heights: Array, precision: float, budget: int,
               results: Array, arrays: PackedArrays) -> None:
    """
    Try a step with each crossing, or find its maximum step height.

    A single kernel does both, because the integrator takes long to compile.

    Parameters
    ----------
    rows : (n, 31) array
        The fields of Course, Parameters and Actuator, concatenated.
    grounds : (n, 4, 7) array
        Their heights are overwritten.
    heights : (n,) array
        Of the steps to try [m]; `SEARCHED` for the maximum step heights.
    precision : float
        Tolerance of `attempt`, or accuracy of `find` [m].
    budget : int
        Function evaluations of one attempt.
    results : (n, 3) or (n, 5) array
        Overwritten.
    arrays : tuple
        See `PackedArrays`; one set for each thread.

    """
    state, before, last, spent, output, workspace = arrays
    for i in range(len(rows)):
        crossing = Crossing(
            read_course(rows[i], 0),
            System(read_parameters(rows[i], PARAMETERS), grounds[i],
                   read_actuator(rows[i], ACTUATOR)),
            budget, state, before, Output(*output), unpack_workspace(workspace), spent, last)
        if len(heights) > 0:
            results[i, SCORE], results[i, OUTCOME] = attempt(heights[i], precision, crossing)
            results[i, ROLLED] = -crossing.system.parameters.radius * state[BALL_RATE]
        else:
            spent[:] = 0
            low, high, error, tolerance, outcome = find(precision, crossing)
            results[i, LOW], results[i, HIGH], results[i, ERROR] = low, high, error
            results[i, FINE], results[i, OUTCOME] = tolerance, outcome


class ThreadWorkspace(local):
    """Workspace of a thread; it keeps the last attempt, which explains the outcome."""

    def __init__(self) -> None:
        self.state, self.last = np.zeros(SIZE), np.zeros(1)
        self.spent = np.zeros(2, dtype=np.int64)
        self.packed: PackedArrays = (
            self.state, np.zeros(SIZE), self.last, self.spent, NO_OUTPUT[:],
            Workspace.of(VERTICES).plain)


WORKSPACE = ThreadWorkspace()


class Crossings(NamedTuple):
    """Any number of crossings, in the format of the kernels."""

    rows: Array  # (n, 31), see `cross_rows`
    grounds: Array  # (n, 4, 7)

    @classmethod
    def of(cls, number: int, robot: Robot, speed: Any, pendulum_angle: Any, actuation: Actuation,
           site: Site, rules: Rules, options: ContactOptions = ContactOptions()) -> 'Crossings':
        """
        Return a table of `number` crossings at speeds [m/s] and pendulum angles [rad].

        The arguments are already checked, also for consistency; their values may be columns.
        """
        numbers = (*rules.course(speed, pendulum_angle), *Parameters.of(robot, options),
                   *actuation.actuators(robot, 0.0, pendulum_angle))
        return cls(table(numbers, number), site.grounds(robot, number))

    def tried(self, heights: Array, tolerance: float, budget: int = BUDGET) -> Array:
        """Return the results at a step of each height [m]; see `cross_rows`."""
        results = np.empty((len(self.rows), 3))
        direct(cross_rows)(*self, heights, tolerance, budget, results, WORKSPACE.packed)
        return results

    def found(self, accuracy: float) -> Array:
        """Return the maximum step heights to an accuracy [m]; see `cross_rows`."""
        results = np.empty((len(self.rows), 5))
        direct(cross_rows)(*self, SEARCHED, accuracy, BUDGET, results, WORKSPACE.packed)
        return results


ACCURACY = quantity('m', 'largest error of the height', minimum=1e-8, maximum=1e-2).metadata
ANGLE = quantity('rad', 'angle of the pendulum at first contact').metadata
SCAN = count('number of heights tried on each side', maximum=10_000).metadata
# An actuation, or a function that returns one for a speed [m/s].
Actuations = Union[Actuation, Callable[[float], Actuation]]
Item = TypeVar('Item')
Found = TypeVar('Found')


class MaxStepHeight(NamedTuple):
    """The maximum step height at one speed; all SI."""

    speed: float  # of the centre at first touch [m/s]
    height: float  # of a step that is crossed, 0 if none is [m]
    error: float  # bound on the difference from the true maximum [m]
    monotone: Optional[bool]  # all lower steps are crossed, no higher one; None without `scan`
    attempts: int  # number of attempts
    work: int  # number of function evaluations


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

    Warns
    -----
    PlausibilityWarning
        If the impact on the edge is too fast for the stiffness of the shell.

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
    outcome, low, high, error, fine = crossing.found(accuracy)[0].tolist()
    if outcome == TOO_FAST:
        raise ConfigurationError(
            f'no step up to {high:g} m stops {robot.name!r} at {speed:g} m/s: this speed is '
            'outside the range of the search', 'out_of_range', 'speed')
    _check(outcome, fine)
    for sentence in edge_warnings(robot, speed, low):
        warnings.warn(sentence, PlausibilityWarning, stacklevel=2)
    monotone = None
    if scan > 0:
        parts = (np.arange(scan) + 0.5) / scan
        heights = np.concatenate([low * parts if low > 0.0 else [], high * (1.0 + parts)])
        overs = [_try(item, fine, crossing)[0] for item in heights.tolist()]
        monotone = overs == (heights < high).tolist()
    return MaxStepHeight(float(speed), low, error, monotone, *WORKSPACE.spent.tolist())


def _check(outcome: float, tolerance: float) -> None:
    """Raise the error that explains the last attempt, unless it finished."""
    if outcome != FINISHED:
        raise failure(int(outcome), float(WORKSPACE.last[0]), WORKSPACE.state, Solver(
            'adaptive', tolerance=max(tolerance, FINEST), work_budget=BUDGET))


def try_step(robot: RobotLike, speed: float, height: float, actuation: Actuation = Actuation(),
             pendulum_angle: Optional[float] = None, tolerance: float = ATTEMPT_TOLERANCE,
             site: Site = Site(), rules: Rules = Rules(),
             options: ContactOptions = ContactOptions()) -> Tuple[bool, float]:
    """
    Try one step of a height above 0 [m]; return whether the ball gets over, and the score.

    The score is above 0 for a success, else below [m2/s2], see `attempt`; the tolerance is the
    local error per step of the adaptive method [m].  See `max_step_height` for the other
    parameters and for the exceptions.
    """
    height = check_value('height', height, HEIGHT, 'try_step')
    crossing = _prepare(
        load_robot(robot), speed, actuation, pendulum_angle, site, rules, options)
    return _try(height, tolerance, crossing)


def _try(height: float, tolerance: float, crossing: Crossings) -> Tuple[bool, float]:
    """Return whether the ball gets over, and the score."""
    outcome, score, _ = crossing.tried(np.array([height]), tolerance)[0].tolist()
    _check(outcome, tolerance)
    return score > 0.0, score


def _prepare(robot: Robot, speed: float, actuation: Actuation, pendulum_angle: Optional[float],
             site: Site, rules: Rules, options: ContactOptions) -> Crossings:
    """Return one checked crossing in the format of the kernels."""
    speed = check_value('speed', speed, SPEED, 'max_step_height')
    check_gravity(robot)
    if not isinstance(actuation, Actuation):
        raise ConfigurationError(
            "max_step_height: actuation must be an Actuation, such as Actuation('velocity', "
            f'set_rate=3.0) or held_at(0.0), got {actuation!r}', 'wrong_type', 'actuation')
    for name, value, wanted in (('site', site, Site), ('rules', rules, Rules),
                                ('options', options, ContactOptions)):
        if not isinstance(value, wanted):
            raise ConfigurationError(
                f'max_step_height: {name} must be of class {wanted.__name__}, got {value!r}',
                'wrong_type', name)
    actuation.check_fits(robot)
    if pendulum_angle is None:
        pendulum_angle = actuation.start_angle
    refuse_degrees('max_step_height', 'pendulum_angle', pendulum_angle)
    pendulum_angle = check_value('pendulum_angle', pendulum_angle, ANGLE, 'max_step_height')
    return Crossings.of(1, robot, speed, pendulum_angle, actuation, site, rules, options)


def max_step_heights(robot: RobotLike, speeds: Iterable[float],
                     actuation: Actuations = Actuation(),
                     pendulum_angle: Optional[float] = None, accuracy: float = 5e-5,
                     site: Site = Site(), rules: Rules = Rules(),
                     options: ContactOptions = ContactOptions(), scan: int = 0,
                     threads: Optional[int] = None) -> List[MaxStepHeight]:
    """
    Find the maximum step height at several speeds [m/s], in parallel.

    The actuation may be a function that returns one for a speed, such as ``rolling(robot)``;
    `threads` is the number of parallel searches, by default one per core.  See `max_step_height`
    for the other parameters and for the exceptions.
    """
    robot = load_robot(robot)

    def find(speed: float) -> MaxStepHeight:
        drive = actuation(speed) if callable(actuation) else actuation
        return max_step_height(robot, speed, drive, pendulum_angle, accuracy, site, rules,
                               options, scan)
    return list(parallel_searches(find, list(speeds), threads))


def parallel_searches(find: Callable[[Item], Found], items: Sequence[Item],
                      threads: Optional[int] = None) -> Iterator[Found]:
    """
    Yield the results of searches in their order, which run in threads, by default one per core.

    The first one, which may compile kernels, runs in the thread of the caller: Ctrl-C ends it at
    once, and a search in another thread only when that is finished.
    """
    yield from map(find, items[:1])
    with ThreadPoolExecutor(threads or os.cpu_count() or 1) as pool:
        yield from pool.map(find, items[1:])


def rolling(robot: Robot, actuation: Actuation = Actuation()) -> Callable[[float], Actuation]:
    """Return law (12) with the joint rate that rolls the ball at each speed."""
    return lambda speed: changed(
        actuation, {'law': 'velocity', 'set_rate': set_rate_for_speed(robot, speed)})


def cruising(robot: Robot, actuation: Actuation = Actuation()) -> Callable[[float], Actuation]:
    """
    Return the open-loop voltage that rolls the ball at each speed on a level floor.

    The motor then compensates the friction of joint and ball, (c1 + c2) v / R.  Raises
    `ConfigurationError` if the robot has no motor.
    """
    motor = robot.motor
    if motor is None:
        raise ConfigurationError(
            f"law 'voltage' needs a motor and robot {robot.name!r} describes none; add a motor "
            'section to its file', 'missing', 'motor')
    per_rate = ((robot.rolling_friction + robot.joint_friction) / motor.stall_torque_per_volt
                + motor.back_voltage)
    return lambda speed: changed(
        actuation, {'law': 'voltage', 'voltage': per_rate * speed / robot.ball_radius})


def actuation_for(robot: Robot, actuation: Actuation) -> Callable[[float], Actuation]:
    """Return the actuation at each speed; law (12) and a voltage of 0 are adapted to the speed."""
    if actuation.law == 'velocity':
        return rolling(robot, actuation)
    if actuation.law == 'voltage' and np.all(actuation.voltage == 0.0):
        return cruising(robot, actuation)
    return lambda _: actuation
