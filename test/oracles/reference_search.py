# SPDX-License-Identifier: Apache-2.0
"""
The maximum step height by the search of the paper: ascending bracketing with fixed steps.

`crossing.max_step_height` must return the same heights.  The two searches share the rules and
the start of a crossing, but neither the solver nor the search; this one evaluates full runs.
"""
import math

import numpy as np

from ballbot_ros.crossing import held_at, Rules, Site
from ballbot_ros.crossing.attempt import place, RETREAT
from ballbot_ros.physics import (
    Actuation, ContactOptions, load_robot, Model, Solver, State, Terrain)
from ballbot_ros.physics.simulation.run import run_once

# Robot and actuation of the documented maximum step heights.
CASES = {
    'shellball free': (load_robot('shellball'), Actuation()),
    'gimball free': (load_robot('gimball'), Actuation()),
    'gimball down': (load_robot('gimball'), held_at(0.0)),
    'gimball level': (load_robot('gimball'), held_at(math.pi / 2))}
# An attempt that is undecided at these times is repeated with a longer run [s].
FIRST_LIMITS = (0.5, 1.5)


def terrain_of(site, height):
    """Return the ground of a site with a step of some height [m]."""
    before, behind = site.slope_before, site.slope_behind
    floor, edge, upper = (math.nan if value is None else value for value in (
        site.friction_before, site.friction_edge, site.friction_behind))
    return Terrain(
        [[-math.cos(before), -math.sin(before)], [0.0, 0.0], [0.0, height],
         [math.cos(behind), height + math.sin(behind)]],
        [floor, math.nan, upper], [math.nan, math.nan, edge, math.nan])


def crosses(robot, speed, height, actuation=Actuation(), options=ContactOptions(),
            solver=Solver(), site=Site(), rules=Rules()):
    """Return whether the ball crosses a step [m] at a collision speed [m/s]."""
    model = Model(robot, terrain_of(site, height), options, solver)
    vector = np.array(State()[1:])
    touch_x = place(vector, rules.course(speed, actuation.start_angle), model.parameters,
                    model.profile)
    limit = int(rules.time_limit / solver.step) * solver.step
    for duration in (*FIRST_LIMITS, limit):
        # Near the maximum height runs are so sensitive that `simulate` would refuse the steps.
        run = run_once(
            model, State(0.0, *vector), actuation, min(duration, limit), solver.step)
        goal, behind = rules.beyond * robot.ball_radius, math.tan(site.slope_behind)
        over = (run['x'] > goal) & (run['y'] > height + goal * behind + 0.5 * robot.ball_radius)
        back = (run['x'] < touch_x - RETREAT) & (run['velocity_x'] < 0.0)
        first_over, first_back = (
            np.argmax(rows) if rows.any() else math.inf
            for rows in (over, back & (rules.attempts == 'first')))
        if min(first_over, first_back) < math.inf:
            return bool(first_over < first_back)
    return False


def highest_step(robot, speed, actuation=Actuation(), tolerance=5e-5, **rest):
    """
    Return the maximum step height at a collision speed [m].

    The height doubles until the ball fails; then bisection reduces the bracket to the tolerance
    [m].  The result is the lower end of the bracket, which the ball crosses.
    """
    def passes(height):
        return crosses(robot, speed, height, actuation, **rest)

    low, high = 0.0, max(tolerance, 0.25 * speed * speed / (2.0 * robot.gravity))
    while passes(high):
        low, high = high, 2.0 * high
    while high - low > tolerance:
        middle = 0.5 * (low + high)
        if passes(middle):
            low = middle
        else:
            high = middle
    return low
