# SPDX-License-Identifier: Apache-2.0
"""The ground as far as it has been seen, where nobody says what it is."""
from typing import Optional, Sequence

import numpy as np

from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics.model.terrain import Array, Terrain

# A new look that differs by less changes nothing [m]: noise would redraw the page all the time.
NEWS = 1e-3


class SeenGround:
    """
    Looks at the ground joined to one polyline; the newest look is believed where it looks.

    Parameters
    ----------
    radius : float
        Of the ball [m], whose centre the looks are measured from.

    """

    def __init__(self, radius: float):
        """Have seen nothing."""
        self._radius = radius
        self._points: Optional[Array] = None
        self._terrain: Optional[Terrain] = None

    @property
    def terrain(self) -> Optional[Terrain]:
        """Return the ground; another object where it has changed, None before any look."""
        return self._terrain

    def see_profile(self, x: float, y: float, along: Sequence[float],
                    above: Sequence[float]) -> None:
        """
        Take a polyline.

        Parameters
        ----------
        x, y : float
            Centre of the ball [m].
        along, above : sequence of float
            From the centre of the ball [m].

        """
        self._join(np.column_stack([np.asarray(along) + x, np.asarray(above) + y]))

    def see_step(self, x: float, y: float, distance: float, height: float) -> None:
        """Take the next step ahead; a height of 0 is a floor that is clear up to there [m]."""
        floor, face = y - self._radius, x + distance
        points = [[x, floor], [face, floor]]
        if height:
            points += [[face, floor + height], [face + self._radius, floor + height]]
        self._join(np.array(points))

    def _join(self, points: Array) -> None:
        points = points[np.isfinite(points).all(axis=1)]
        if len(points) < 2 or points[-1, 0] <= points[0, 0]:
            return
        known = self._points
        if known is not None:
            if self._known_already(points):
                return
            points = np.vstack([known[known[:, 0] < points[0, 0]], points,
                                known[known[:, 0] > points[-1, 0]]])
        points = _simplified(points)
        try:
            self._terrain, self._points = Terrain(points), points
        except ConfigurationError:
            pass  # an overhang, say: what was seen before is kept

    def _known_already(self, points: Array) -> bool:
        """Return whether a look shows nothing new."""
        assert self._points is not None and self._terrain is not None
        known = self._points
        inside = (known[:, 0] > points[0, 0]) & (known[:, 0] < points[-1, 0])
        if points[0, 0] < known[0, 0] - NEWS or points[-1, 0] > known[-1, 0] + 50.0 * NEWS:
            return False
        # Compared both ways, so that neither a new step nor one that is gone is missed.
        return _lies_on(points, known) and _lies_on(known[inside], points)


def _lies_on(points: Array, line: Array) -> bool:
    """Return whether all points lie on a polyline; at an upright face, slightly beside counts."""
    apart = np.abs([np.interp(points[:, 0] + aside, line[:, 0], line[:, 1]) - points[:, 1]
                    for aside in (-NEWS, 0.0, NEWS)]).min(axis=0)
    return bool((apart < NEWS).all())


def _simplified(points: Array) -> Array:
    """Return a polyline without doubles and without vertices on a straight line."""
    kept = [points[0]]
    for point, after in zip(points[1:], [*points[2:], None]):
        if point[0] < kept[-1][0] or np.hypot(*(point - kept[-1])) < 1e-9:
            continue
        if after is not None:
            along, onward = point - kept[-1], after - kept[-1]
            across = along[0] * onward[1] - along[1] * onward[0]
            if abs(across) < 1e-6 * max(np.hypot(*onward), 1e-9) and along @ onward > 0.0:
                continue
        kept.append(point)
    return np.array(kept)
