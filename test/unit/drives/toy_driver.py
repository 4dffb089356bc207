# SPDX-License-Identifier: Apache-2.0
"""The least that a driver must be; it stands for a fourth one in the tests."""
from ballbot_ros.drives.driver import Driver, Identity
from ballbot_ros.drives.wire import WireBudget


class Toy(Driver):
    """Answers without asking."""

    protocol = 'toy'

    def identify(self, patience=0.5):
        """Return what it always is."""
        return Identity('toy', 'none', '1')

    def read_settings(self, patience=0.5):
        """Return none."""
        return ()

    def feed(self):
        """Do nothing."""

    def stopped_since(self, time):
        """Believe it."""
        return True

    def budget(self):
        """Return two bytes."""
        return WireBudget(1, 1)

    def _arm(self, deadline):
        pass

    def _stop_message(self):
        return b'0'

    def _torque_message(self, torque):
        return b't'

    def _questions(self):
        return b'?'

    def _take(self, data, now):
        pass
