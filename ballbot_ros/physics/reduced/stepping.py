# SPDX-License-Identifier: Apache-2.0
"""
Adaptive steps in the slow variables of `rolling`, watched by monitors.

The pair of Dormand and Prince with the local error as a length at the rim, as the full model
has it.  After each step, and in between where other features of the ground are near, the full
state is looked at: another feature touches, the end of the feature is passed, the contact
pulls, the slip asks for more than the cone has, the motor reaches its limit; or what the model
neglects exceeds its threshold.  Then the run is left at the last moment at which all was well,
and the full model goes on from there.
"""
import math
from typing import Any

import numpy as np

from ballbot_ros.compiled import compiled, outlined
from ballbot_ros.physics.dormand_prince import A, C, ERROR, prepare_explicit_dense, STAGES
from ballbot_ros.physics.dynamics import BALL_ANGLE, PENDULUM_ANGLE, SIZE, X
from ballbot_ros.physics.embedded import add_rows, BEGIN, interpolate, PROBE, RATES
from ballbot_ros.physics.modes import (
    broken, FEATURE, features_within, MOTOR, PRESSED, SLIDING)
from ballbot_ros.physics.reduced.mechanics import (
    gain_rate, outlook, settling_time, SPIN, SWING, WAY)
from ballbot_ros.physics.reduced.rolling import (
    asked, follow, lift, measure, MOST_FRICTION, MOTOR_TORQUE, NEGLECTED, OWN_DENT, RISE, settle,
    SLIP, slip_lag, SPEED)
from ballbot_ros.physics.reduced.track import (
    lay_track, LEAST_X, MOST_X, PERIOD, ROUGHNESS, TURNING)
from ballbot_ros.physics.terrain import TURN

# The models that a run can be in.
WHOLE, ROLLING, FLYING = range(3)

# Why one was entered or left, for the log.
(SETTLED, NEGLECT, GROUND, PULLED, CONE, LIMIT, LANDED, LIFTED, COARSE, BEGUN) = range(10)
REASON_OF_KIND = np.array([GROUND, PULLED, CONE, LIMIT])

LARGEST_STEP = 1.0     # [s]
LARGEST_WAY = 0.25     # of the radius per step, where other features are near
LOOKS = 4              # within such a step
HALVINGS = 10          # of the part of a step in which the model broke
SHORTEST_STEP = 0.05   # of tau_n: shorter ones are left to the full model
LASTING = 10.0         # [s]: how long an error of the speed stays
ENTER = 0.3            # of the threshold: so far off may a state be that enters the model
GROWTH = 5.0
WORTH = 0.1            # rate of the motor's law over that of the slip, beyond which little is won
DENTED = 0.01          # of the dent at rest: ringing beyond it is not worth a closer look

# Rows of the room to work in: the slow state, the full one, what follows at the end of a step
# and in between, the track, a slow state in between, three for `follow`.
SLOW, FULL, FAST, GLIMPSE, TRACK, BETWEEN, FIRST, ROOM = 0, 1, 2, 3, 4, 5, 6, 9


@compiled
def note(log: Any, time: float, model: int, reason: int) -> None:
    """
    Note a change of the model in a log, an (n, 3) array of time, model and reason.

    Its first line holds the number of changes, of which so many are kept as there are lines, and
    the present model.
    """
    if log[0, 0] > 0.0 and log[0, 1] == model:
        return
    log[0, 0] += 1.0
    log[0, 1] = model
    line = int(log[0, 0])
    if line < len(log):
        log[line, 0], log[line, 1], log[line, 2] = time, model, reason


@outlined
def fits(time: float, state: Any, mode: Any, count: int, threshold: float, robot: Any,
         ground: Any, drive: Any, room: Any) -> bool:
    """
    Tell whether a full state is one of rolling, to within the threshold; prepares `room`.

    Parameters
    ----------
    mode, count
        From `find_mode`.
    threshold : float
        For what is neglected, and for the way from the state to the model's [m].
    room : (ROOM, 13) array
        Gets track and slow state.

    """
    if count != 1 or mode[0, PRESSED] != 1 or mode[0, SLIDING] != 0:
        return False
    feature = mode[0, FEATURE]
    if feature % 2 == 1 and ground[feature // 2 + 1, TURN] > 0.0:
        return False
    slow, fast, track = room[SLOW], room[FAST], room[TRACK]
    lay_track(feature, ground, track)
    dent, rise, slip = settle(state, track, robot, slow)
    normal, period = robot.stiffness * dent, settling_time(robot)
    if track[ROUGHNESS] <= 0.0 or normal <= 0.0:
        return False
    # First what is quick to see: a motor that is as stiff as the slip, a dent that rings.
    lag = slip_lag(normal, dent, track, robot)
    allowed = threshold + DENTED * robot.mass * robot.gravity / robot.stiffness
    if lag * gain_rate(robot, drive) > WORTH or period * abs(rise) > allowed:
        return False
    saturated = mode[len(mode) - 1, MOTOR]
    carried, _ = asked(time, slow, dent, slip, saturated, outlook(slow, track), track, robot,
                       drive, fast)
    if not abs(normal - carried) <= allowed * robot.stiffness:
        return False
    measure(time, slow, saturated, track, robot, drive, fast)
    follow(time, slow, saturated, track, robot, drive, room[FIRST:], fast, room[FIRST + 2])
    if not fast[NEGLECTED] <= ENTER * threshold:
        return False
    away = (abs(dent - fast[OWN_DENT]) + period * abs(rise - fast[RISE])
            + lag * abs(slip - fast[SLIP]))
    return away <= threshold


@outlined
def slow_stages(time: float, step: float, saturated: int, robot: Any, drive: Any, room: Any,
                work: Any) -> None:
    """Compute stages 2 to 7 from stage 1, the new slow state and its estimated error."""
    slow = room[SLOW]
    for stage in range(1, STAGES):
        for i in range(SIZE):
            work[PROBE, i] = slow[i]
        add_rows(stage, A[stage], step, work, work[PROBE])
        follow(time + C[stage] * step, work[PROBE], saturated, room[TRACK], robot, drive,
               room[FIRST:], room[FAST], work[stage])
    for i in range(SIZE):
        work[RATES, i] = 0.0
    add_rows(STAGES, ERROR, step, work, work[RATES])


@compiled
def slow_error(track: Any, robot: Any, errors: Any) -> float:
    """Return estimated errors of a slow state as a length at the rim [m]."""
    radius = robot.radius
    rim = robot.ball_inertia + robot.mass * radius * radius
    own = robot.swing_inertia if robot.swing_inertia > 0.0 else 1.0
    worst = 0.0
    for i in range(SWING + 1):
        weight = 1.0
        if i == BALL_ANGLE or i == PENDULUM_ANGLE or (i == WAY and track[TURNING] > 0.0):
            weight = radius
        elif i == SPIN:
            weight = LASTING * radius / rim
        elif i == SWING:
            weight = settling_time(robot) * radius / own
        part = weight * abs(errors[i])
        if not part < math.inf:
            return math.inf
        worst = max(worst, part)
    return worst


@outlined
def trouble(time: float, slow: Any, fast: Any, mode: Any, threshold: float, first: int,
            behind: int, robot: Any, ground: Any, drive: Any, table: Any, room: Any, kinds: Any,
            items: Any) -> int:
    """Return why a slow state is not one that the model may be in, SETTLED if it is."""
    lift(slow, fast, room[TRACK], robot, room[FULL])
    if broken(time, room[FULL], mode, 1, first, behind, robot, ground, drive, table, kinds,
              items) > 0:
        return REASON_OF_KIND[kinds[0]]
    if abs(fast[SLIP]) > MOST_FRICTION * robot.slip_threshold:
        return CONE
    return SETTLED if fast[NEGLECTED] <= threshold else NEGLECT


@outlined
def good_part(time: float, step: float, mode: Any, threshold: float, looks: int, first: int,
              behind: int, robot: Any, ground: Any, drive: Any, table: Any, room: Any, work: Any,
              kinds: Any, items: Any) -> tuple:
    """Return the part of a step, 0 to 1, up to which the model held, and why not further."""
    good, bad, reason = 0.0, 1.0, SETTLED
    for look in range(1, looks):
        part = look / looks
        glimpse(time, step, part, mode, robot, drive, room, work)
        reason = trouble(time + part * step, room[BETWEEN], room[GLIMPSE], mode, threshold,
                         first, behind, robot, ground, drive, table, room, kinds, items)
        if reason != SETTLED:
            bad = part
            break
        good = part
    if reason == SETTLED:
        reason = trouble(time + step, work[PROBE], room[FAST], mode, threshold, first, behind,
                         robot, ground, drive, table, room, kinds, items)
    if reason == SETTLED:
        return 1.0, reason
    for _ in range(HALVINGS):
        part = 0.5 * (good + bad)
        glimpse(time, step, part, mode, robot, drive, room, work)
        found = trouble(time + part * step, room[BETWEEN], room[GLIMPSE], mode, threshold,
                        first, behind, robot, ground, drive, table, room, kinds, items)
        if found == SETTLED:
            good = part
        else:
            bad, reason = part, found
    return good, reason


@outlined
def glimpse(time: float, step: float, part: float, mode: Any, robot: Any, drive: Any, room: Any,
            work: Any) -> None:
    """Write the slow state at a part of the last step, and what follows, into BETWEEN, GLIMPSE."""
    interpolate(part, work, room[BETWEEN])
    follow(time + part * step, room[BETWEEN], mode[len(mode) - 1, MOTOR], room[TRACK], robot,
           drive, room[FIRST:], room[GLIMPSE], room[FIRST + 2])


@compiled
def free_way(x: float, track: Any, robot: Any) -> float:
    """Return how far the ball may go before it can touch another feature [m]."""
    return max(0.0, min(x - track[LEAST_X], track[MOST_X] - x) - robot.radius)


@outlined
def advance_slow(time: float, state: Any, end: float, tolerance: float, threshold: float,
                 step: float, robot: Any, ground: Any, drive: Any, table: Any, work: Any,
                 mode: Any, room: Any, kinds: Any, items: Any, rows: Any, begin: float,
                 interval: float, filled: int, tally: Any, budget: int) -> tuple:
    """
    Advance in place a state that `fits` has accepted, and left in `room`.

    Parameters
    ----------
    begin, filled
        Row i is at ``begin + (i + 1) * interval``; the first `filled` of them are.
    other parameters
        As of `adaptive.advance_adaptive`.

    Returns
    -------
    time, step : float
        Reached, and to try next [s].
    filled : int
        Rows that are filled now.
    reason : int
        Why the model was left; SETTLED at `end` or where the budget is used up.

    """
    slow, fast, track = room[SLOW], room[FAST], room[TRACK]
    saturated, near = mode[len(mode) - 1, MOTOR], LARGEST_WAY * robot.radius
    smallest = 1e-14 * max(1.0, abs(time))
    follow(time, slow, saturated, track, robot, drive, room[FIRST:], fast, work[BEGIN])
    lift(slow, fast, track, robot, state)
    while time < end and tally[3] + tally[4] < budget:
        clear = free_way(state[X], track, robot)
        fastest = abs(fast[SPEED]) + 1e-3 + robot.gravity * min(step, LARGEST_STEP)
        used = min(step, LARGEST_STEP, max(clear, near) / fastest, end - time)
        slow_stages(time, used, saturated, robot, drive, room, work)
        tally[3] += STAGES - 1
        error = slow_error(track, robot, work[RATES])
        if not error <= tolerance:
            shrink = 0.9 * (tolerance / error)**0.2 if math.isfinite(error) else 0.1
            step = used * max(0.1, shrink)
            tally[1] += 1
            if step < SHORTEST_STEP * track[PERIOD]:
                return time, step, filled, COARSE
            follow(time, slow, saturated, track, robot, drive, room[FIRST:], fast, work[BEGIN])
            continue
        tally[0] += 1
        grow = GROWTH if error == 0.0 else min(GROWTH, 0.9 * (tolerance / error)**0.2)
        step = max(step, used * grow) if used < step else used * grow
        prepare_explicit_dense(slow, used, work)
        first, behind, looks = mode[0, FEATURE], mode[0, FEATURE] + 1, 1
        if clear < fastest * used:
            first, behind = features_within(state[X], robot.radius + near, ground)
            looks = LOOKS
        part, reason = good_part(
            time, used, mode, threshold, looks, first, behind, robot, ground, drive, table, room,
            work, kinds, items)
        reached = min(time + used, end) if part == 1.0 else time + part * used
        while filled < len(rows) and begin + (filled + 1) * interval <= reached + smallest:
            moment = begin + (filled + 1) * interval
            glimpse(time, used, min((moment - time) / used, 1.0), mode, robot, drive, room, work)
            lift(room[BETWEEN], room[GLIMPSE], track, robot, room[FULL])
            write_row(moment, room[FULL], room[GLIMPSE, MOTOR_TORQUE], rows[filled])
            filled += 1
        if part == 1.0:
            for i in range(SIZE):
                slow[i] = work[PROBE, i]
                work[BEGIN, i] = work[STAGES - 1, i]
        else:
            glimpse(time, used, part, mode, robot, drive, room, work)
            for i in range(SIZE):
                slow[i], fast[i] = room[BETWEEN, i], room[GLIMPSE, i]
        lift(slow, fast, track, robot, state)
        time = end if end - reached < smallest else reached
        if part < 1.0:
            return time, step, filled, reason
    return time, step, filled, SETTLED


@compiled
def write_row(time: float, state: Any, motor: float, row: Any) -> None:
    """Fill a row of a trajectory."""
    row[0] = time
    for i in range(SIZE):
        row[1 + i] = state[i]
    row[1 + SIZE] = motor
