# SPDX-License-Identifier: Apache-2.0
"""
How long a ball in the air touches nothing: a bound that no touch, however short, gets past.

The distance of a point to a segment is convex along a straight line, and the
centre leaves the straight line by at most A t^2 / 2, where A bounds its acceleration.  So for
each segment ``gap + gap' h - A h^2 / 2 <= 0`` gives a time h before which there is no touch, and
the least h of all segments may be stepped over.  Repeated, this converges on the first touch
quadratically, and cannot pass it.
"""
import math

from ballbot_ros.compiled import compiled, outlined
from ballbot_ros.physics.mechanics.contact import first_segment
from ballbot_ros.physics.mechanics.holding import mode_holds
from ballbot_ros.physics.model.parameters import System
from ballbot_ros.physics.model.state import VELOCITY_X, VELOCITY_Y, X, Y
from ballbot_ros.physics.model.terrain import Array, TANGENT_X, TANGENT_Y, VERTEX_X, VERTEX_Y
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
    Return a time before which the ball touches nothing [s].

    Parameters
    ----------
    bend : float
        Bound of the acceleration of the centre [m/s2], above 0.
    reach : float
        Segments that lie further from x than this are not looked at [m].

    """
    least = math.inf
    last = len(ground) - 2
    for segment in range(first_segment(ground, x - reach), last + 1):
        away_x, away_y = x - ground[segment, VERTEX_X], y - ground[segment, VERTEX_Y]
        if -away_x > reach and segment > 0:
            break
        along_x, along_y = ground[segment, TANGENT_X], ground[segment, TANGENT_Y]
        along = away_x * along_x + away_y * along_y
        # The nearest point: the foot of the perpendicular, or an end that is not infinite.
        if along < 0.0 and segment > 0:
            along = 0.0
        if segment < last:
            end = ((ground[segment + 1, VERTEX_X] - ground[segment, VERTEX_X]) * along_x
                   + (ground[segment + 1, VERTEX_Y] - ground[segment, VERTEX_Y]) * along_y)
            along = min(along, end)
        away_x -= along * along_x
        away_y -= along * along_y
        distance = math.sqrt(away_x * away_x + away_y * away_y)
        gap = max(distance - radius, 0.0)
        speed = (velocity_x * away_x + velocity_y * away_y) / distance
        root = math.sqrt(speed * speed + 2.0 * bend * gap)
        # The positive root of gap + speed h - bend h^2 / 2, without cancellation.
        wait = (speed + root) / bend if speed > 0.0 else (
            2.0 * gap / (root - speed) if gap > 0.0 else 0.0)
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
