# SPDX-License-Identifier: Apache-2.0
"""A graph with a bridge that is made to pull, and the emulated motor that it pulls with."""
import math
import time

from graph import TIMEOUT
import pytest
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from ballbot_ros.bridge.motor_state import MotorState, Power
from ballbot_ros.drives.contract import Telemetry
from ballbot_ros.msg import MotorStatus
from ballbot_ros.ros.conversions import command_message

TORQUE = 0.6  # at the pendulum [N m]
WATCHDOG = 0.5  # of the drive: a busy machine may hold the bridge up for as long [s]

# Reasons of an e-stop that a machine busy for longer than WATCHDOG explains, or their beginnings.
_armed = Power(MotorState.ARMED)
HELD_UP = (_armed.observe(Telemetry(), math.inf, 0.0)[1],
           _armed.observe(Telemetry(), 0.0, math.inf)[1],
           _armed.observe(Telemetry(status_time=1.0, armed=False), 0.0, 0.0)[1].split(':')[0],
           'the line was lost')


class Driving:
    """A graph with a bridge that is made to pull."""

    def __init__(self, graph, motor):
        self.graph, self.motor = graph, motor
        self.states = graph.subscribe('joint_states', JointState)
        self.status = graph.subscribe('motor_status', MotorStatus)

    def command(self, torque=TORQUE):
        """Return a command for the newest state."""
        return command_message(self.states[-1].header.stamp, torque)

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
        """Return why arming failed, if a machine that is held up while it waits explains that."""
        reason = self.status[-1].e_stop if self.status else ''
        held_up = any(word in reason for word in ('not report', 'not answer', 'WATCHDOG'))
        return reason if 'cannot arm' in reason and held_up else ''

    def pull(self):
        """Command a torque until the motor makes it, and forget earlier reports."""
        for _ in range(5):
            self.status.clear()
            found = self.graph.publish_until(
                lambda: 'torque' if self.motor.torque != 0.0 else self.held_up(),
                'the motor pulls', 'joint_commands', self.command)
            if found == 'torque':
                return
            self.release()
        pytest.fail(f'the drive disarms each time: {found}')

    def held_up(self):
        """Return the reason of an e-stop that a machine busy for longer than WATCHDOG explains."""
        reason = self.status[-1].e_stop if self.status else ''
        return reason if reason.startswith(HELD_UP) else ''

    def wait_until_reported(self, state):
        """Wait until the bridge has reported a state since the motor pulled."""
        self.graph.wait(lambda: state in [status.state for status in self.status], 'it says so')

    def wait_for_nothing(self):
        """Wait until the motor makes no torque, and see that it stays so."""
        self.graph.wait(lambda: self.motor.torque == 0.0, 'the motor is at zero')
        self.graph.spin(0.3)
        assert self.motor.torque == 0.0
