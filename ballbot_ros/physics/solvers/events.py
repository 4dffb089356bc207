# SPDX-License-Identifier: Apache-2.0
"""Where a frozen mode ends within a step: violated guards, located on the dense output."""
import numpy as np

from ballbot_ros.jit import compiled
from ballbot_ros.physics.mechanics.contact import touches
from ballbot_ros.physics.mechanics.contact_law import PRESSED
from ballbot_ros.physics.mechanics.guards import (
    guard_of, in_contact, mode_holds, OF_FEATURE, OF_FORCE, violated_guards)
from ballbot_ros.physics.mechanics.modes import contact_count, ContactMode
from ballbot_ros.physics.model.parameters import System
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.solvers import rows
from ballbot_ros.physics.solvers.clearance import touch_within
from ballbot_ros.physics.solvers.controller import smallest_step
from ballbot_ros.physics.solvers.dense import COEFFICIENTS, factors_at, motion_at
from ballbot_ros.physics.solvers.rows import sum_rows
from ballbot_ros.physics.solvers.values import EventRate, Workspace
from ballbot_ros.physics.solvers.whole_step import holds_throughout

MOST_EVENTS = 64      # located within one look; of more, an early one will do
LOOKS = 4             # times within a step at which the mode is checked
LOOK_FACTORS = np.array([factors_at((look + 1) / LOOKS) for look in range(LOOKS)]).ravel()
NO_EVENT = 2.0        # for theta, which is 0 to 1 within the step
INSIDE = 1e-300       # for a guard that is zero by rounding
FALSI_ALONE, MOST_TURNS = 10, 100  # of the search for an event: before it halves, and in all

CHATTER = 1e-9        # [s]: maximum time between events caused by rounding
CHATTERING = 20         # number of such events before steps skip them, with growing length
SOON, CROWD = 0.1, 3  # of the step; number of events within it before steps shorten
STUCK = 1000          # events, or smallest steps, in a row without any time between them


@compiled
def time_width(time: float) -> float:
    """Return how closely an event is located [s]: to rounding, for long runs."""
    return max(1e-13, 4e-16 * time)


@compiled
def ends_at_zero(kind: int, item: int, mode: ContactMode, ground: Array) -> bool:
    """Return whether a mode has ended where a guard is zero, else only where it is below."""
    if kind == OF_FORCE:
        return mode.signs[item, PRESSED] > 0
    if kind != OF_FEATURE:
        return False
    return in_contact(item, mode) != touches(item, 0.0, ground)


@compiled
def guard_at(theta: float, index: int, time: float, step: float, system: System,
             workspace: Workspace) -> float:
    """
    Return a violated guard at `theta` of the last step.

    By rounding it may be zero for a while: positive, where that is inside the mode still.  Else
    the next step would begin in the same mode, and could pass a short contact between two looks.
    """
    motion_at(theta, workspace.work)
    kind, item = workspace.violated[index, 0], workspace.violated[index, 1]
    guard = guard_of(kind, item, time + theta * step, workspace.probe, system, workspace.mode)
    if guard == 0.0 and not ends_at_zero(kind, item, workspace.mode, system.ground):
        return INSIDE
    return guard


@compiled
def anderson_bjorck_weight(guard: float, before: float) -> float:
    """Return the factor for the guard at the end of the bracket that was kept twice."""
    share = 1.0 - guard / before
    return share if share > 0.0 else 0.5


@compiled
def locate(index: int, low: float, high: float, time: float, step: float, system: System,
           workspace: Workspace) -> float:
    """
    Return theta where a violated guard has just become negative, between two others.

    Regula falsi, as Anderson and Bjoerck have it, on the dense output; ends on the far side of
    the zero, so that the next mode differs.  A guard may be far from a line, as where a ball rolls
    off an edge; so after the first few times every other one halves the bracket.
    """
    at_low = guard_at(low, index, time, step, system, workspace)
    at_high = guard_at(high, index, time, step, system, workspace)
    width, kept = time_width(time) / step, 0
    for turn in range(MOST_TURNS):
        if high - low <= width:
            break
        if at_low > 0.0 and at_high < 0.0 and (turn < FALSI_ALONE or turn % 2 == 0):
            theta = low + (high - low) * at_low / (at_low - at_high)
            # Aim a little beyond the zero, to close the bracket from both sides.
            theta = min(max(theta + 0.25 * width, low + 0.25 * width), high - 0.25 * width)
        else:
            theta = 0.5 * (low + high)
        guard = guard_at(theta, index, time, step, system, workspace)
        if guard > 0.0:
            if kept > 0:  # the same end twice: it counts for less
                at_high *= anderson_bjorck_weight(guard, at_low)
            low, at_low, kept = theta, guard, 1
        else:
            if kept < 0:
                at_low *= anderson_bjorck_weight(guard, at_high)
            high, at_high, kept = theta, guard, -1
    return high


@compiled
def event_between(before: float, theta: float, time: float, step: float, features: tuple[int, int],
                  system: System, workspace: Workspace) -> float:
    """
    Return the first theta up to a given one at which the mode ends, NO_EVENT if it does not.

    A guard may have been violated for a while before the one that a look finds: a ball lands on
    a segment and rolls over its end.  So what has been located is looked at again, from just
    before.
    """
    (first, behind), event = features, NO_EVENT
    for _ in range(MOST_EVENTS):
        if theta <= before:
            break
        motion_at(theta, workspace.work)
        found = violated_guards(time + theta * step, workspace.probe, system, workspace.mode,
                                first, behind, workspace.violated)
        if found == 0:
            break
        event = theta
        for index in range(found):
            event = min(event, locate(index, before, theta, time, step, system, workspace))
        theta = event - 4.0 * time_width(time) / step
    return event


@compiled
def first_event(time: float, step: float, first: int, behind: int, system: System,
                workspace: Workspace) -> float:
    """Return theta at which the mode ends, NO_EVENT if not; with features from `first` on."""
    if holds_throughout(time, step, workspace.work, first, behind, system, workspace.mode):
        return NO_EVENT
    touch = NO_EVENT
    if contact_count(workspace.mode) == 0:  # it may touch, and roll off again, between two looks
        touch = touch_within(time, step, first, behind, system, workspace)
    for look in range(LOOKS):
        sum_rows(workspace.work, rows.PROBE, rows.ZERO, 1.0, LOOK_FACTORS, COEFFICIENTS * look,
                 rows.DENSE, COEFFICIENTS)
        before, theta = look / LOOKS, (look + 1) / LOOKS
        if before < touch < theta:
            theta = touch
        if theta == touch or not mode_holds(time + theta * step, workspace.probe, first, behind,
                                            system, workspace.mode):
            event = event_between(before, theta, time, step, (first, behind), system, workspace)
            if event < NO_EVENT:
                return event
    return NO_EVENT


@compiled
def rated(rate: EventRate, theta: float, time: float, step: float) -> tuple[EventRate, float]:
    """
    Return the rate of events after a step, and theta where it ends.

    A guard that changes by less than its rounding flickers: after a while it is stepped over.
    """
    chattering = rate.chattering + 1 if theta * step < CHATTER else 0
    if chattering > CHATTERING and theta <= 1.0:
        push = time_width(time) * 2.0**min(chattering - CHATTERING, 40)
        theta = max(theta, min(1.0, push / step))
    return EventRate(chattering, rate.crowded + 1 if theta < SOON else 0,
                rate.stuck + 1 if min(theta, 1.0) * step <= smallest_step(time) else 0), theta
