# SPDX-License-Identifier: Apache-2.0
"""The left stick and two buttons of a gamepad, by evdev or pygame where one is installed."""
from importlib import import_module
from typing import Any, List, NamedTuple

from ballbot_ros.errors import ConfigurationError

# Positions of a released stick, as part of its range.
DEAD_ZONE = 0.1
MISSING = ('a gamepad is read with the Python package evdev or pygame, and neither is installed: '
           'pip install evdev')
NONE_THERE = 'no gamepad is connected, or this user may not open it: sudo usermod -aG input $USER'


class StickReading(NamedTuple):
    """Position of the stick, forward positive from -1 to 1, and keys of the buttons."""

    stick: float
    keys: List[str]


def open_gamepad() -> Any:
    """
    Return the first gamepad, which has a method ``read``.

    Raises
    ------
    ConfigurationError
        If no gamepad or no package to read it is available.

    """
    for module, reader in (('evdev', EvdevGamepad), ('pygame', PygameGamepad)):
        try:
            return reader(import_module(module))
        except ImportError:
            continue
    raise ConfigurationError(MISSING, 'not_installed', 'evdev')


def centred(part: float) -> float:
    """Return a position of a stick without its dead zone, still from -1 to 1."""
    if abs(part) <= DEAD_ZONE:
        return 0.0
    return (abs(part) - DEAD_ZONE) / (1.0 - DEAD_ZONE) * (1.0 if part > 0.0 else -1.0)


class EvdevGamepad:
    """
    A gamepad read by evdev.

    Parameters
    ----------
    evdev : module

    """

    def __init__(self, evdev: Any):
        codes = self._codes = evdev.ecodes
        for path in evdev.list_devices():
            device = evdev.InputDevice(path)
            able = device.capabilities(absinfo=False)
            if codes.ABS_Y in able.get(codes.EV_ABS, ()) \
                    and codes.BTN_SOUTH in able.get(codes.EV_KEY, ()):
                break
        else:
            raise ConfigurationError(NONE_THERE, 'unavailable', 'gamepad')
        self._device = device
        # A: stop, B: e-stop.  The button to release it is a key on purpose.
        self._buttons = {codes.BTN_SOUTH: 'space', codes.BTN_EAST: 'e'}
        information = device.absinfo(codes.ABS_Y)
        self._low, self._high = information.min, information.max
        self._value = information.value

    def read(self) -> StickReading:
        """Return stick and keys since the last call; raise OSError if unplugged."""
        keys = []
        while (event := self._device.read_one()) is not None:
            if event.type == self._codes.EV_ABS and event.code == self._codes.ABS_Y:
                self._value = event.value
            elif event.type == self._codes.EV_KEY and event.value == 1 \
                    and event.code in self._buttons:
                keys.append(self._buttons[event.code])
        part = (2.0 * self._value - self._low - self._high) / (self._high - self._low)
        return StickReading(centred(-part), keys)  # forward is towards low


class PygameGamepad:
    """
    A gamepad read by pygame.

    Parameters
    ----------
    pygame : module

    """

    def __init__(self, pygame: Any):
        self._pygame = pygame
        pygame.display.init()  # its events need that, not a window
        pygame.joystick.init()
        if not pygame.joystick.get_count():
            raise ConfigurationError(NONE_THERE, 'unavailable', 'gamepad')
        self._stick = pygame.joystick.Joystick(0)
        self._stick.init()

    def read(self) -> StickReading:
        """Return stick and keys since the last call; raise OSError if unplugged."""
        keys = []
        for event in self._pygame.event.get():
            if event.type == self._pygame.JOYBUTTONDOWN and event.button in (0, 1):
                keys.append(('space', 'e')[event.button])
            if event.type == self._pygame.JOYDEVICEREMOVED:
                raise OSError('the gamepad was unplugged')
        return StickReading(centred(-self._stick.get_axis(1)), keys)
