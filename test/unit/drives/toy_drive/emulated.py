# SPDX-License-Identifier: Apache-2.0
"""The firmware of the toy."""
from toy_drive import codec

from ballbot_ros.drives.emulated_device import Device


class ToyDevice(Device):
    """Obeys each command."""

    protocol = 'toy'

    def _boot(self):
        self._parser = codec.Parser((codec.TORQUE, codec.STOP, codec.REQUEST))
        self._armed, self._torque = False, 0.0

    def tick(self, now):
        """Do nothing."""

    def torque(self):
        """Return the torque at the shaft."""
        limit = self.settings.torque_limit
        return min(max(self._torque, -limit), limit)

    def over_current(self):
        """Do nothing."""

    def _receive(self, data, now):
        reply = b''
        for letter, number in self._parser.feed(data):
            if letter == codec.REQUEST:
                reply += codec.frame(codec.ARMED if self._armed else codec.DISARMED,
                                     round(self._torque / codec.UNIT))
            else:
                self._armed, self._torque = letter == codec.TORQUE, number * codec.UNIT
        return reply
