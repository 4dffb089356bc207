# SPDX-License-Identifier: Apache-2.0
"""A graph with a bridge, and the emulated motor that it drives under torque."""
import time
from types import MappingProxyType

import pytest
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from waiting import TIMEOUT
import yaml

from ballbot_ros.bridge.supervisor import StopReason
from ballbot_ros.config.files import read_yaml, shipped_folder
from ballbot_ros.msg import MotorStatus
from ballbot_ros.ros.message_bytes import command_bytes

TORQUE = 0.6  # at the pendulum [N m]
WATCHDOG = 0.5  # of the drive: a busy machine may delay the bridge that long [s]

# Reasons of an e-stop that a delay of the machine longer than WATCHDOG explains.
HELD_UP = (StopReason.SILENT, StopReason.UNCONFIRMED, StopReason.DISARMED_BY_DRIVE,
           StopReason.LOST, StopReason.HELD_UP)


def write_hardware(path, name='gimball_odrive', limits=MappingProxyType({}), **connection):
    """Write a hardware file of the package with changed limits and connection; return its path."""
    content = read_yaml(shipped_folder('config') / 'hardware' / f'{name}.yaml')
    content['connection'].update(watchdog=WATCHDOG, **connection)
    content['limits'].update(limits)
    path.write_text(yaml.safe_dump(content))
    return str(path)


class Driving:
    """A graph with a bridge that drives its motor under torque."""

    def __init__(self, graph, motor):
        self.graph, self.motor = graph, motor
        self.states = graph.subscribe('joint_states', JointState)
        self.status = graph.subscribe('motor_status', MotorStatus)

    def command(self, torque=TORQUE):
        """Return a command for the newest state."""
        return command_bytes(self.states[-1].header.stamp, torque)

    def release(self):
        """Release the e-stop until the motor has power."""
        self.graph.wait(lambda: self.states, 'joint states flow')
        deadline = time.monotonic() + TIMEOUT
        for _ in range(5):
            while not (answer := self.graph.call('bridge/release_e_stop', Trigger)).success:
                assert 'remains engaged' in answer.message
                assert time.monotonic() < deadline, answer.message
            self.status.clear()
            if self.graph.wait(lambda: self.has_power() or self.not_armed(),
                               'the motor has power') is True:
                return
        pytest.fail(f'the drive is not armed: {self.not_armed()}')

    def has_power(self):
        """Return whether the newest status says that the motor has power."""
        return bool(self.status) and self.status[-1].state in ('waiting', 'following')

    def not_armed(self):
        """Return why arming failed, if a delay of the machine explains it."""
        return self.stopped_by(StopReason.NOT_ARMED)

    def pull(self):
        """Discard earlier reports, and command a torque until the motor applies one."""
        for _ in range(5):
            self.status.clear()
            found = self.graph.publish_until(
                lambda: 'torque' if self.motor.torque != 0.0 else self.held_up(),
                'the motor applies a torque', 'joint_commands', self.command)
            if found == 'torque':
                return
            self.release()
        pytest.fail(f'the drive disarms each time: {found}')

    def held_up(self):
        """Return the text of an e-stop that a delay longer than WATCHDOG explains."""
        return self.stopped_by(*HELD_UP)

    def stopped_by(self, *reasons):
        """Return the text of an e-stop with one of these reasons."""
        status = self.status[-1] if self.status else MotorStatus()
        return status.e_stop if status.e_stop_reason in reasons else ''

    def wait_until_reported(self, state):
        """Wait until the bridge has reported a state since the motor had torque."""
        self.graph.wait(lambda: state in [status.state for status in self.status], 'the report')

    def wait_for_nothing(self):
        """Wait until the motor torque is zero, and verify that it stays zero."""
        self.graph.wait(lambda: self.motor.torque == 0.0, 'the motor torque is zero')
        self.graph.spin(0.3)
        assert self.motor.torque == 0.0
