# SPDX-License-Identifier: Apache-2.0
"""A session in real time on a virtual CAN bus of python-can."""
from contextlib import suppress
from dataclasses import replace
import threading
import time

import can
import pytest
from refusals import refused
from test_bridge_hardware import GENTLE, GIMBALL
from tiers import slow
from virtual_robot import VirtualRobot

from ballbot_ros.bridge.drive_line import connector
from ballbot_ros.bridge.feasibility import check_feasible
from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.bridge.motor_state import MotorState
from ballbot_ros.bridge.session import Session
from ballbot_ros.clock import steady_time
from ballbot_ros.drives import device_class
from ballbot_ros.drives.can_transport import CanLink
from ballbot_ros.drives.emulated_device import DriveSettings
from ballbot_ros.errors import ConfigurationError, LinkError

PROTOCOLS = ('odrive_can', 'vesc_can')
RATE = 1000000
PERIOD = 0.004


class BusDrive(threading.Thread):
    """An emulated drive on a virtual bus."""

    def __init__(self, protocol, settings):
        super().__init__(daemon=True)
        self.device, self.running = device_class(protocol)(settings), True
        self.device.baud = RATE
        self._line = CanLink(f'virtual:{protocol}', RATE)
        self.start()

    def run(self):
        """Run until `running` is False or the bus is closed."""
        with suppress(LinkError):
            self._loop()
        self._line.close()

    def _loop(self):
        while self.running:
            self._line.wait(0.001)
            now = steady_time()
            self.device.tick(now)
            reply = self.device.receive(self._line.read(), now)
            if reply:
                self._line.write(reply)


class BusRobot:
    """A session whose drive is on a virtual bus."""

    def __init__(self, protocol):
        suffix = '_emulated' if protocol == 'odrive_can' else ''
        hardware = load_hardware(f'gimball_{protocol}{suffix}').at(port=f'virtual:{protocol}')
        self.hardware = replace(hardware, connection=replace(
            hardware.connection, imu_required=False, loop_rate=1.0 / PERIOD))
        torque = self.hardware.options().torque_limit
        self.drive = BusDrive(protocol, DriveSettings(
            torque_limit=torque, current_limit=torque / DriveSettings.torque_constant))
        self.session = Session(self.hardware, GIMBALL, connector(self.hardware))

    def run(self, seconds, torque=None, until=lambda report: False):
        """Tick the session, command a torque if one is given, and return the last report."""
        end = steady_time() + seconds
        report = None
        while steady_time() < end and not (report and until(report)):
            report = self.session.report(self.session.tick()) or report
            if torque is not None:
                self.session.command(torque, steady_time())
            time.sleep(PERIOD)
        return report

    def close(self):
        """Close the session and stop the drive."""
        self.session.close()
        self.drive.running = False
        self.drive.join()


@pytest.fixture(params=PROTOCOLS)
def robot(request):
    """Yield a session whose motor is armed."""
    made = BusRobot(request.param)
    made.session.configure()
    made.run(0.1)
    made.session.activate()
    made.session.release()
    report = made.run(2.0, 0.0, lambda report: report.state is MotorState.ARMED)
    assert report.state is MotorState.ARMED
    yield made
    made.close()


def test_a_session_on_a_can_bus_applies_torque_and_removes_it(robot):
    wanted = 0.9 / (50.0 * 0.9)
    robot.run(2.0, 0.9, lambda _: robot.drive.device.torque() == pytest.approx(wanted, rel=0.01))
    assert robot.drive.device.torque() == pytest.approx(wanted, rel=0.01)
    robot.session.engage('test')
    robot.run(2.0, None, lambda report: report.state is MotorState.DISARMED)
    assert robot.drive.device.torque() == 0.0
    assert robot.session.control.power.state is MotorState.DISARMED


def test_bus_off_disconnects_the_drive_and_its_watchdog_ends_the_torque(robot):
    robot.run(0.2, 0.9)
    with can.Bus(robot.hardware.connection.port.partition(':')[2], interface='virtual') as other:
        other.send(can.Message(arbitration_id=0x40, is_error_frame=True, dlc=8))
        robot.drive.running = False  # the drive leaves the bus, too
        robot.run(0.1, None, lambda report: report.state is MotorState.DISCONNECTED)
    assert robot.session.control.power.state is MotorState.DISCONNECTED
    assert robot.session.control.counts['links_lost'] == 1
    robot.drive.join()
    robot.drive.device.tick(steady_time() + 0.2)
    assert robot.drive.device.torque() == 0.0


def test_a_file_without_confirmed_settings_is_refused_for_firmware_0_5():
    robot = VirtualRobot('odrive_can')
    with refused('inconsistent', 'torque limit', ConfigurationError) as caught:
        robot.session.configure()
    assert 'odrv0.axis0.motor.config.torque_lim = ' in str(caught.value)
    assert robot.lines == 0


@pytest.mark.parametrize('protocol, baud, enough', [
    ('odrive_can', 250000, 500000), *slow(('vesc_can', 500000, 1000000))])
def test_a_bus_that_is_too_slow_is_refused_and_a_supported_bit_rate_is_proposed(
        protocol, baud, enough):
    hardware = load_hardware(f'gimball_{protocol}')
    hardware = replace(hardware, connection=replace(hardware.connection, loop_rate=500.0))
    check_feasible(hardware, GIMBALL, GENTLE)
    with refused('inconsistent', 'loop_rate') as caught:
        check_feasible(hardware.at(baud=baud), GIMBALL, GENTLE)
    assert str(enough) in str(caught.value)
