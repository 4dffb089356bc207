# SPDX-License-Identifier: Apache-2.0
"""The line in memory behaves like a cable: replies are delayed, and missing when unplugged."""
import pytest
from refusals import refused

from ballbot_ros.drives.memory_line import MemoryLine
from ballbot_ros.errors import LinkError


class Echo:
    """A device that echoes received bytes."""

    def receive(self, data, now):
        """Return it."""
        return data

    def tick(self, now):
        """Do nothing."""


def test_a_reply_arrives_after_its_delay_and_once():
    line = MemoryLine(Echo(), delay=0.0025)
    line.write(b'hello')
    assert line.read() == b'' and not line.wait(0.001)
    while not line.wait(1.0):
        pass
    assert line.clock() == pytest.approx(0.003)
    assert line.read() == b'hello' and line.read() == b''


@pytest.mark.parametrize('use', [
    lambda line: line.write(b'x'), lambda line: line.read(), lambda line: line.wait(1.0)])
def test_without_its_cable_every_use_is_refused(use):
    line = MemoryLine(Echo())
    use(line)
    line.plugged = False
    with refused('gone', 'port', LinkError):
        use(line)
    line.plugged = True
    use(line)
