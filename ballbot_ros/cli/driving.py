# SPDX-License-Identifier: Apache-2.0
"""What keys and sticks ask of a robot, apart from terminal and graph."""
from dataclasses import dataclass
import math
from typing import Optional

# With a dead man's switch a key counts as held for so long after it was last repeated [s]:
# keyboards wait up to 0.66 s before they repeat a key, and less after that.
HELD_FIRST, HELD = 0.75, 0.25

HELP = ('up/down faster, slower   space stop   e e-stop   R release it   q quit')
HOLD_HELP = ('hold up/down to drive   space stop   e e-stop   R release it   q quit')


@dataclass(frozen=True)
class Wish:
    """What a key asks for beside a speed."""

    engage: bool = False
    release: bool = False
    quit: bool = False


class Driving:
    """
    Turns keys into a speed.

    Parameters
    ----------
    step : float
        By which a key changes the speed, and with `hold` the speed while a key is held [m/s].
    largest : float
        Speed that is not exceeded [m/s].
    hold : bool
        Drive only while a key is held.

    Attributes
    ----------
    speed : float
        That is asked for [m/s].

    """

    def __init__(self, step: float, largest: float, hold: bool = False):
        """Stand."""
        self._step, self._largest, self.hold = step, largest, hold
        self.speed = 0.0
        self._until = math.inf
        self._last = ''

    def press(self, key: str, now: float) -> Wish:
        """Take a key at a time [s], and return what it asks for beside a speed."""
        if key in ('up', 'down', 'left', 'right'):
            self._drive(1.0 if key in ('up', 'right') else -1.0, key, now)
        elif key in ('space', 's', '0'):
            self.stop()
        elif key in ('e', 'E'):
            self.stop()
            return Wish(engage=True)
        elif key == 'R':
            self.stop()
            return Wish(release=True)
        elif key in ('q', 'Q', 'interrupt'):
            self.stop()
            return Wish(quit=True)
        return Wish()

    def _drive(self, sign: float, key: str, now: float) -> None:
        if self.hold:
            repeated = key == self._last and now < self._until
            self.speed = sign * self._step
            self._until = now + (HELD if repeated else HELD_FIRST)
            self._last = key
            return
        wanted = round((self.speed + sign * self._step) / self._step) * self._step
        self.speed = min(max(wanted, -self._largest), self._largest)

    def stick(self, part: float) -> None:
        """Take the position of a stick, from -1 to 1."""
        self.speed = min(max(part, -1.0), 1.0) * self._largest

    def stop(self) -> None:
        """Ask for a stop."""
        self.speed, self._last = 0.0, ''

    def at(self, now: float) -> float:
        """Return the speed that is asked for at a time [s]; none after a key was let go."""
        if self.hold and now >= self._until:
            self.stop()
        return self.speed


def line(wanted: float, speed: Optional[float], pendulum: Optional[float], decision: str,
         e_stop: Optional[bool], followers: int, said: str, width: int) -> str:
    """Return what whoever drives sees: one line, no longer than the terminal is wide."""
    words = [f'ask {wanted:+.2f} m/s']
    words.append('drives   -  m/s' if speed is None else f'drives {speed:+.2f} m/s')
    words.append('pendulum    - deg' if pendulum is None
                 else f'pendulum {math.degrees(pendulum):+4.0f} deg')
    if e_stop is not None:
        words.append('E-STOP' if e_stop else 'e-stop off')
    if decision:
        words.append(decision)
    if not followers:
        words.append('nobody follows cmd_vel')
    if said:
        words.append(' '.join(said.split()))
    text = '  '.join(words)
    return text if len(text) < width else f'{text[:max(width - 4, 0)]}...'
