# SPDX-License-Identifier: Apache-2.0
"""Where a frozen mode ends within a step: located on the dense output."""
from typing import Any

from ballbot_ros.compiled import compiled
from ballbot_ros.physics.mechanics.modes import broken, margin_of
from ballbot_ros.physics.solvers.embedded import interpolate

MOST_ENDS = 64        # located within one look; of more, an early one will do
LOOKS = 4             # times within a step at which the mode is checked


@compiled
def time_width(time: float) -> float:
    """Return how closely an event is located [s]: to rounding, for long runs."""
    return max(1e-13, 4e-16 * time)


@compiled
def locate(kind: int, item: int, low: float, high: float, time: float, step: float, mode: Any,
           count: int, robot: Any, ground: Any, drive: Any, table: Any, work: Any,
           probe: Any) -> float:
    """
    Return the part of the step at which a margin has just become negative.

    Regula falsi, Illinois variant, on the dense output; ends on the far side of the zero, so
    that the next mode differs.
    """
    interpolate(low, work, probe)
    at_low = margin_of(kind, item, time + low * step, probe, mode, count, robot, ground, drive,
                       table)
    interpolate(high, work, probe)
    at_high = margin_of(kind, item, time + high * step, probe, mode, count, robot, ground,
                        drive, table)
    width = time_width(time) / step
    for _ in range(60):
        if high - low <= width:
            break
        if at_low > 0.0 and at_high < 0.0:
            part = low + (high - low) * at_low / (at_low - at_high)
            # Aim a little beyond the zero, to close the bracket from both sides.
            part = min(max(part + 0.25 * width, low + 0.25 * width), high - 0.25 * width)
        else:
            part = 0.5 * (low + high)
        interpolate(part, work, probe)
        margin = margin_of(kind, item, time + part * step, probe, mode, count, robot, ground,
                           drive, table)
        if margin > 0.0:
            low, at_low, at_high = part, margin, 0.5 * at_high
        else:
            high, at_high, at_low = part, margin, 0.5 * at_low
    return high


@compiled
def mode_end(time: float, step: float, mode: Any, count: int, first: int, behind: int,
             robot: Any, ground: Any, drive: Any, table: Any, work: Any, probe: Any, kinds: Any,
             items: Any) -> float:
    """
    Return the part of the step at which the mode ends, 2 if it does not.

    A margin may have come and gone before the one that a look finds: a ball lands on a segment
    and rolls over its end.  So what has been located is looked at again, from just before.
    """
    for look in range(1, LOOKS + 1):
        before, part = (look - 1) / LOOKS, look / LOOKS
        ending = 2.0
        for _ in range(MOST_ENDS):
            if part <= before:
                break
            interpolate(part, work, probe)
            found = broken(time + part * step, probe, mode, count, first, behind, robot, ground,
                           drive, table, kinds, items)
            if found == 0:
                break
            ending = part
            for index in range(found):
                ending = min(ending, locate(
                    kinds[index], items[index], before, part, time, step, mode, count, robot,
                    ground, drive, table, work, probe))
            part = ending - 4.0 * time_width(time) / step
        if ending < 2.0:
            return ending
    return 2.0
