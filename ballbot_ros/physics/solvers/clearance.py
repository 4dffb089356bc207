# SPDX-License-Identifier: Apache-2.0
"""
Conservative time to contact of a ball in the air: a bound that no contact precedes.

The distance of a point to a segment is convex along a straight line, and the
centre leaves the straight line by at most A t^2 / 2, where A bounds its acceleration.  So for
each segment ``gap + gap' h - A h^2 / 2 <= 0`` gives a time h before which there is no touch, and
the least h of all segments is a safe step.  Repeated, this converges quadratically to the first
contact, and cannot pass it.

A ball at release still overlaps the ground: gap < 0.  Its speed away stays above gap' - A h,
so with ``gap'^2 > -2 A gap`` it has left before it comes back, and all the while the force of
spring and damper, k (-gap) - d gap', stays below a parabola that opens upwards and is not above
zero at either end.  Then the later root is the time h.
"""
import math

from ballbot_ros.jit import compiled, outlined
from ballbot_ros.physics.mechanics.contact import away_from, first_segment
from ballbot_ros.physics.mechanics.guards import mode_holds
from ballbot_ros.physics.model.parameters import System
from ballbot_ros.physics.model.state import VELOCITY_X, VELOCITY_Y, X, Y
from ballbot_ros.physics.model.terrain import Array, VERTEX_X
from ballbot_ros.physics.solvers import rows
from ballbot_ros.physics.solvers.dense import motion_at
from ballbot_ros.physics.solvers.rows import WIDTH
from ballbot_ros.physics.solvers.values import Workspace

MOST_LOOKS = 64     # within a step; then it is left to the looks at fixed times
SHORTEST = 1e-4     # of the step: a touch that is shorter may be passed
NO_TOUCH = 2.0      # for theta, which is 0 to 1 within the step


@compiled
def clear_time(x: float, y: float, velocity_x: float, velocity_y: float, bend: float,
               reach: float, radius: float, ground: Array) -> float:
    """
    Return a time before which no contact force acts on a released ball [s].

    Parameters
    ----------
    bend : float
        Bound of the acceleration of the centre [m/s2], above 0.
    reach : float
        Segments farther from x than this are ignored [m].

    """
    least = math.inf
    last = len(ground) - 2
    for segment in range(first_segment(ground, x - reach), last + 1):
        if ground[segment, VERTEX_X] - x > reach and segment > 0:
            break
        away_x, away_y = away_from(segment, x, y, ground)
        distance = math.sqrt(away_x * away_x + away_y * away_y)
        gap = distance - radius
        speed = (velocity_x * away_x + velocity_y * away_y) / distance
        square = speed * speed + 2.0 * bend * gap
        # The later root of gap + speed h - bend h^2 / 2, without cancellation.
        wait = 0.0
        if speed > 0.0 and square > 0.0:
            wait = (speed + math.sqrt(square)) / bend
        elif gap > 0.0:
            wait = 2.0 * gap / (math.sqrt(square) - speed)
        least = min(least, wait)
    return least


@compiled
def most_acceleration(step: float, work: Array) -> float:
    """Return a bound of the acceleration of the centre within the last step [m/s2]."""
    change_x = change_y = 0.0
    for row in range(1, 5):
        # Slopes of the functions of theta that each coefficient is multiplied with, see `dense`.
        steepest = 0.2 if row == 4 else 1.0
        at = rows.DENSE + WIDTH * row
        change_x += steepest * abs(work[at + VELOCITY_X])
        change_y += steepest * abs(work[at + VELOCITY_Y])
    return (change_x + change_y) / step + 1e-9


@outlined
def touch_within(time: float, step: float, first: int, behind: int, system: System,
                 workspace: Workspace) -> float:
    """Return theta of the last step where a ball in the air touches, NO_TOUCH if it does not."""
    work, probe, radius = workspace.work, workspace.probe, system.parameters.radius
    bend, done = most_acceleration(step, work), 0.0
    for _ in range(MOST_LOOKS):
        motion_at(done, work)
        if done > 0.0 and not mode_holds(
                time + done * step, probe, first, behind, system, workspace.mode):
            return done
        left = (1.0 - done) * step
        speed = abs(probe[VELOCITY_X]) + abs(probe[VELOCITY_Y])
        wait = clear_time(probe[X], probe[Y], probe[VELOCITY_X], probe[VELOCITY_Y], bend,
                          radius + (speed + bend * left) * left, radius, system.ground)
        done += max(wait / step, SHORTEST)
        if done >= 1.0:
            break
    return NO_TOUCH
