# SPDX-License-Identifier: Apache-2.0
"""
The emulated drives communicate with independent implementations of their protocols.

PyVESC and basicmicro are optional (requirements/test.txt). The tools of ODrive do not use
ASCII; the maker's test of that protocol is in test_emulator_devices.py.
"""
from hypothesis import given, strategies as st
import pytest

from ballbot_ros.drives.emulated_device import DriveSettings
from ballbot_ros.drives.roboclaw.emulated import RoboClawDevice
from ballbot_ros.drives.vesc.uart import codec
from ballbot_ros.drives.vesc.uart.emulated import VescDevice

SETTINGS = DriveSettings(watchdog=0.3)


class Port:
    """A port of pyserial as basicmicro uses it, with a RoboClaw at the other end."""

    is_open = True

    def __init__(self):
        self.drive = RoboClawDevice(SETTINGS)
        self.drive.sensed = self.drive.sensed._replace(
            position=-100.0, velocity=-7.5, bus_voltage=23.4, temperature=41.5)
        self.waiting = b''

    def write(self, data):
        """Send bytes to the drive."""
        self.waiting += self.drive.receive(bytes(data), 0.0)
        return len(data)

    def read(self, size=1):
        """Return waiting bytes."""
        data, self.waiting = self.waiting[:size], self.waiting[size:]
        return data

    def flushInput(self):
        """Discard waiting bytes."""
        self.waiting = b''


@pytest.fixture
def roboclaw():
    """Return basicmicro's controller, connected to an emulated RoboClaw."""
    basicmicro = pytest.importorskip(
        'basicmicro', reason='pip install -r requirements/test.txt')
    controller = basicmicro.Basicmicro('none', 115200)
    controller._port, controller._connected = Port(), True
    return controller


def test_basicmicro_reads_the_emulated_roboclaw(roboclaw):
    assert roboclaw.ReadVersion(0x80) == (True, 'USB Roboclaw 2x30a v4.2.8\n')
    counts = -100.0 / 6.283185307179586 * 4096
    good, count, _ = roboclaw.ReadEncM1(0x80)
    # The library returns the counter without its sign.
    assert good and count - 2**32 == pytest.approx(counts, abs=1)
    assert roboclaw.ReadMainBatteryVoltage(0x80) == (True, 234)
    assert roboclaw.ReadTemp(0x80) == (True, 415)
    assert roboclaw.ReadError(0x80) == (True, 0)
    assert roboclaw.GetTimeout(0x80) == (True, pytest.approx(0.3))
    assert roboclaw.ReadM1MaxCurrent(0x80)[:2] == (True, 400)


def test_basicmicro_drives_the_emulated_roboclaw(roboclaw):
    assert roboclaw.DutyM1(0x80, -16384)
    assert roboclaw.ReadPWMs(0x80) == (True, -16384, 0)
    drive = roboclaw._port.drive
    assert drive.torque() < 0.0
    good, current, _ = roboclaw.ReadCurrents(0x80)
    assert good and current / 100.0 == pytest.approx(
        drive.torque() / SETTINGS.torque_constant, abs=0.01)
    assert roboclaw.SetTimeout(0x80, 0.5) and roboclaw.GetTimeout(0x80) == (True, 0.5)


@pytest.fixture(scope='module')
def pyvesc():
    """Return PyVESC."""
    pytest.importorskip('PyCRC', reason='pip install -r requirements/test.txt')
    return pytest.importorskip('pyvesc', reason='pip install -r requirements/test.txt')


@given(payload=st.binary(min_size=1, max_size=400))
def test_pyvesc_unpacks_our_packets(pyvesc, payload):
    from pyvesc.packet.codec import unframe
    assert unframe(codec.frame(payload), 'strict') == (payload, len(codec.frame(payload)))


@given(payload=st.binary(min_size=1, max_size=250))
def test_we_unpack_the_packets_of_pyvesc(pyvesc, payload):
    from pyvesc.packet.codec import frame
    assert codec.FrameParser().feed(frame(payload)) == [payload]


@given(current=st.integers(-4000, 4000))
def test_pyvesc_drives_the_emulated_vesc(pyvesc, current):
    from pyvesc.messages.setters import SetCurrent
    drive = VescDevice(SETTINGS)
    drive.receive(pyvesc.encode(SetCurrent(current)), 0.0)
    assert drive.torque() == pytest.approx(SETTINGS.torque_constant * current / 1000.0)
