# SPDX-License-Identifier: Apache-2.0
"""The parameters of the node: name, unit, range, default and meaning."""
from dataclasses import dataclass

from ballbot_ros.bridge.realtime import DEFAULT_PRIORITY, Scheduling
from ballbot_ros.config.fields import count, fixed, flag, live, quantity, text
from ballbot_ros.control import ControlTuning, load_tuning
from ballbot_ros.ros.frames import described, frame, frame_prefix
from ballbot_ros.ros.settings import file_in, numbers_in, rate_of, Settings


@dataclass(frozen=True)
class BridgeSettings(Settings):
    """Parameters of the node ``bridge``."""

    hardware: str = fixed('it determines line, limits and estimator', file_in(
        'hardware', 'gimball_odrive', 'hardware file'))
    port: str = fixed('the line is opened with it', text(
        'serial device, URL or CAN interface; empty for that of the hardware file', default=''))
    baud: int = fixed('the line is opened with it', count(
        'bits per second; 0 for those of the hardware file', default=0, maximum=20_000_000))
    control: str = fixed('topics and laws are created for it', text(
        'source of the torque: `onboard` for the laws in the loop of the bridge, which follow '
        'set_point and cmd_vel; `direct` for joint_commands', default='onboard',
        choices=('onboard', 'direct')))
    tuning: str = live(file_in(
        'tunings', 'gentle', doc=': gains of the laws on board or, in direct control, of the '
        'controller, for the stability check of the loop'))
    delay: int = live(count(
        'samples from a joint state to the torque that answers it, for the stability check in '
        'direct control', default=1, maximum=10))
    set_point_timeout: float = live(quantity(
        's', 'on board, age of a set-point after which the pendulum is lowered', default=0.5,
        minimum=0.05, maximum=10.0))
    joint_state_rate: float = live(rate_of(
        'joint_states on board, at most the rate of the loop; in direct control it equals the '
        'rate of the loop', 100.0))
    autostart: bool = fixed('it applies at the start; change the state of the node instead', flag(
        'configure and activate at the start, with retries until this succeeds; the e-stop '
        'remains engaged', default=True))
    capture: str = fixed('the line is opened with it', text(
        'file for the raw traffic of the line; empty for none', default=''))
    black_box: str = fixed('it records from the start of the node', text(
        'folder for files with the last ten minutes before a fault, see `ballbot replay`; '
        '`ROS_HOME`, if set, replaces `~/.ros`; empty for none', default='~/.ros/ballbot'))
    status_rate: float = live(rate_of('motor_status', 10.0, minimum=0.1, maximum=100.0))
    realtime_priority: int = fixed('it applies at the start of the loop', count(
        'SCHED_FIFO priority of the loop (other threads have one less); 0 for none, -1 for '
        f'{DEFAULT_PRIORITY} where the system permits it', default=-1, minimum=-1, maximum=99))
    cpu: int = fixed('it applies at the start of the loop', count(
        'processor that the loop runs on; -1 for any', default=-1, minimum=-1, maximum=1023))
    lock_memory: bool = fixed('it applies at the start of the loop', flag(
        'keep the memory of the process from being swapped out', default=False))
    odom_rate: float = live(rate_of(
        'odom and, where tf2_msgs is installed, /tf; 0 leaves odom to another node', 100.0,
        minimum=0.0, maximum=1000.0))
    publish_description: bool = described()
    frame_prefix: str = frame_prefix()
    odom_frame: str = frame('odom')
    footprint_frame: str = frame('footprint')
    base_frame: str = frame('base')
    imu_frame: str = frame('imu')
    gains: ControlTuning = numbers_in('tuning', ControlTuning, load_tuning, 'gains.')

    @property
    def joint_state_period(self) -> float:
        """Return the time between joint states [s], 0 for one with each estimate."""
        return 1.0 / self.joint_state_rate if self.control == 'onboard' else 0.0

    @property
    def scheduling(self) -> Scheduling:
        """Return the scheduling that the loop requests from the system."""
        return Scheduling(self.realtime_priority, self.cpu, self.lock_memory)
