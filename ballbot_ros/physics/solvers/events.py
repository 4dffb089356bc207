# SPDX-License-Identifier: Apache-2.0
"""Where a frozen mode ends within a step: violated guards, located on the dense output."""
from ballbot_ros.compiled import compiled
from ballbot_ros.physics.mechanics.modes import guard_of, violated_guards
from ballbot_ros.physics.model.parameters import System
from ballbot_ros.physics.solvers.controller import smallest_step
from ballbot_ros.physics.solvers.dense import interpolate
from ballbot_ros.physics.solvers.values import EventRate, Workspace

MOST_EVENTS = 64      # located within one look; of more, an early one will do
LOOKS = 4             # times within a step at which the mode is checked
NO_EVENT = 2.0        # for theta, which is 0 to 1 within the step

CHATTER = 1e-9        # [s] between events that rounding makes
PATIENCE = 20         # such events in a row, then ever longer steps over them
SOON, CROWD = 0.1, 3  # of the step; so many events in a row that soon, then shorter steps
STUCK = 1000          # events, or smallest steps, in a row without any time between them


@compiled
def time_width(time: float) -> float:
    """Return how closely an event is located [s]: to rounding, for long runs."""
    return max(1e-13, 4e-16 * time)


@compiled
def guard_at(theta: float, index: int, time: float, step: float, system: System,
             workspace: Workspace) -> float:
    """Return a violated guard at `theta` of the last step."""
    interpolate(theta, workspace.dense, workspace.probe)
    return guard_of(workspace.violated[index, 0], workspace.violated[index, 1],
                    time + theta * step, workspace.probe, system, workspace.mode)


@compiled
def locate(index: int, low: float, high: float, time: float, step: float, system: System,
           workspace: Workspace) -> float:
    """
    Return theta where a violated guard has just become negative, between two others.

    Regula falsi, Illinois variant, on the dense output; ends on the far side of the zero, so
    that the next mode differs.
    """
    at_low = guard_at(low, index, time, step, system, workspace)
    at_high = guard_at(high, index, time, step, system, workspace)
    width = time_width(time) / step
    for _ in range(60):
        if high - low <= width:
            break
        if at_low > 0.0 and at_high < 0.0:
            theta = low + (high - low) * at_low / (at_low - at_high)
            # Aim a little beyond the zero, to close the bracket from both sides.
            theta = min(max(theta + 0.25 * width, low + 0.25 * width), high - 0.25 * width)
        else:
            theta = 0.5 * (low + high)
        guard = guard_at(theta, index, time, step, system, workspace)
        if guard > 0.0:
            low, at_low, at_high = theta, guard, 0.5 * at_high
        else:
            high, at_high, at_low = theta, guard, 0.5 * at_low
    return high


@compiled
def first_event(time: float, step: float, first: int, behind: int, system: System,
                workspace: Workspace) -> float:
    """
    Return theta at which the mode ends, NO_EVENT if it does not.

    Among features from `first` to `behind`.  A guard may have been violated for a while before
    the one that a look finds: a ball lands on a segment and rolls over its end.  So what has
    been located is looked at again, from just before.
    """
    for look in range(1, LOOKS + 1):
        before, theta = (look - 1) / LOOKS, look / LOOKS
        event = NO_EVENT
        for _ in range(MOST_EVENTS):
            if theta <= before:
                break
            interpolate(theta, workspace.dense, workspace.probe)
            found = violated_guards(time + theta * step, workspace.probe, system, workspace.mode,
                                    first, behind, workspace.violated)
            if found == 0:
                break
            event = theta
            for index in range(found):
                event = min(event, locate(index, before, theta, time, step, system, workspace))
            theta = event - 4.0 * time_width(time) / step
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
    if chattering > PATIENCE and theta <= 1.0:
        push = time_width(time) * 2.0**min(chattering - PATIENCE, 40)
        theta = max(theta, min(1.0, push / step))
    return EventRate(chattering, rate.crowded + 1 if theta < SOON else 0,
                rate.stuck + 1 if min(theta, 1.0) * step <= smallest_step(time) else 0), theta
