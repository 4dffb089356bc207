# SPDX-License-Identifier: Apache-2.0
"""The driver of the toy."""
from toy_drive import codec

from ballbot_ros.drives.contract import Identity, WireBudget
from ballbot_ros.drives.driver import Driver


class Toy(Driver):
    """Accepts every reply."""

    protocol = maker = 'toy'

    def _begin(self):
        self._parser = codec.parser()

    def identify(self, timeout=0.5):
        """Return what it always is."""
        self._ask_until(lambda: self.counts['replies'] > 0, self._requests,
                        self.clock() + timeout)
        return Identity('toy', 'none', '1')

    def read_settings(self, timeout=0.5):
        """Return none."""
        return ()

    def feed(self):
        """Do nothing."""

    def budget(self):
        """Return two frames and one."""
        return WireBudget(10, 5)

    def _arm(self, deadline):
        self._send(codec.frame(codec.TORQUE))

    def _stop_message(self):
        return codec.frame(codec.STOP) + self._requests()

    def _torque_message(self, torque):
        return codec.frame(codec.TORQUE, round(torque / codec.UNIT))

    def _requests(self):
        return codec.frame(codec.REQUEST)

    def _take_reply(self, reply, now):
        letter, number = reply
        if letter == codec.DISARMED:
            self._off_requested_at = now
        self.telemetry = self.telemetry._replace(
            time=now, current=number * codec.UNIT, armed=letter == codec.ARMED)
