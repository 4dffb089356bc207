# SPDX-License-Identifier: Apache-2.0
"""The parameters of the nodes of a real robot, and of one that is emulated."""
from dataclasses import dataclass

from ballbot_ros.bridge.realtime import Scheduling
from ballbot_ros.config.fields import count, fixed, flag, live, quantity, text
from ballbot_ros.control import ControlTuning, load_tuning
from ballbot_ros.imus import IMUS
from ballbot_ros.ros.frames import described, frame, frame_prefix
from ballbot_ros.ros.setting_fields import file_in, numbers_in, rate_of, Settings


@dataclass(frozen=True)
class BridgeSettings(Settings):
    """Parameters of the node ``bridge``."""

    hardware: str = fixed('line, limits and estimate are made for it', file_in(
        'hardware', 'gimball_odrive', 'hardware file'))
    port: str = fixed('the line is opened with it', text(
        'serial device, URL or CAN interface; empty for that of the hardware file', default=''))
    baud: int = fixed('the line is opened with it', count(
        'bits per second; 0 for those of the hardware file', default=0, maximum=20_000_000))
    control: str = fixed('topics and laws are made for it', text(
        'where the torque comes from: `onboard` from the laws, run in the loop of the bridge, by '
        'set_point and cmd_vel; `direct` from joint_commands', default='onboard',
        choices=('onboard', 'direct')))
    tuning: str = live(text(
        'gains of the laws on board, or that the controller runs with: the loop is checked for '
        'them', default='gentle'))
    delay: int = live(count(
        'samples from a joint state to the torque that answers it, for the check of direct '
        'control', default=1, maximum=10))
    set_point_timeout: float = live(quantity(
        's', 'on board, age of a set-point after which the pendulum is let down', default=0.5,
        minimum=0.05, maximum=10.0))
    joint_state_rate: float = live(rate_of(
        'joint_states on board, at most that of the loop; in direct control it is that of the '
        'loop', 100.0))
    autostart: bool = fixed('it says how to begin; change the state of the node instead', flag(
        'configure and activate at start, and again until it works; the e-stop is engaged all '
        'the same', default=True))
    capture: str = fixed('the line is opened with it', text(
        'file for the raw traffic of the line; empty for none', default=''))
    black_box: str = fixed('it keeps the last ten minutes from the start on', text(
        'folder for files with the last ten minutes before a fault, see `ballbot replay`; '
        '`~/.ros` is `ROS_HOME` where that is set; empty for none', default='~/.ros/ballbot'))
    status_rate: float = live(rate_of('motor_status', 10.0, minimum=0.1, maximum=100.0))
    realtime_priority: int = fixed('the loop begins with it', count(
        'SCHED_FIFO priority of the loop (other threads have one less); 0 for none', default=0,
        maximum=99))
    cpu: int = fixed('the loop begins with it', count(
        'processor that the loop runs on; -1 for any', default=-1, minimum=-1, maximum=1023))
    lock_memory: bool = fixed('the loop begins with it', flag(
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
        """Return what the loop asks of the system."""
        return Scheduling(self.realtime_priority, self.cpu, self.lock_memory)


@dataclass(frozen=True)
class ImuSettings(Settings):
    """Parameters of the node ``imu``."""

    sensor: str = fixed('the port is opened for it', text(
        'vendor of the sensor', default='witmotion', choices=IMUS))
    port: str = fixed('the port is opened with it', text(
        'serial device or URL; best a name in /dev/serial/by-id', default='/dev/ballbot_imu'))
    baud: int = fixed('the port is opened with it', count(
        'bits per second; a sensor at the 9600 of the factory is changed to it', default=115200,
        minimum=4800, maximum=4_000_000))
    rate: int = fixed('the sensor is configured when it is found', count(
        'readings per second; WitMotion: 10, 20, 50, 100 or 200', default=200, minimum=1,
        maximum=10_000))
    bandwidth: int = fixed('the sensor is configured when it is found', count(
        'bandwidth of the filters in the sensor [Hz]; WitMotion: 5, 10, 20, 42, 98, 188 or 256',
        default=98, minimum=1, maximum=10_000))
    axes: str = live(text(
        'which axis of the sensor points forward, which left and which up when the shell stands '
        'at ball angle 0, such as `-y x z`', default='x y z'))
    latency: float = live(quantity(
        's', 'time from the motion to the first byte that reports it; the filters of 98 Hz '
        'take 0.003', default=0.003, minimum=0.0, maximum=0.1))
    gyro_sd: float = live(quantity(
        'rad/s', 'noise of the gyro per reading, for the covariance', default=0.005, above=0.0,
        maximum=10.0))
    force_sd: float = live(quantity(
        'm/s2', 'noise of the accelerometer per reading, likewise', default=0.05, above=0.0,
        maximum=10.0))
    frame_prefix: str = frame_prefix()
    imu_frame: str = frame('imu')


@dataclass(frozen=True)
class EmulatedRobotSettings(Settings):
    """Parameters of the node ``emulated_robot``."""

    hardware: str = fixed('the emulated drive is made with it', file_in(
        'hardware', 'gimball_odrive', 'hardware file',
        ', whose protocol and baud rate the drive has'))
    firmware: str = fixed('the emulated drive is made with it', text(
        'generation that the drive is of, `0.5` or `0.6` for an ODrive; empty for the only or '
        'oldest one', default=''))
    scene: str = fixed('the world is built of it', file_in('scenes', 'doorstep'))
    link: str = fixed('the device is there already', text(
        'symbolic link to keep pointing to the serial device', default='/tmp/ballbot_motor'))
    publish_odom: bool = fixed('the topic is made at the start', flag(
        'publish the true odom, 83 times a second, for a bridge whose odom_rate is 0',
        default=False))
    imu_link: str = fixed('the device is made at the start', text(
        'symbolic link to the serial device of an emulated WitMotion sensor, in place of the '
        'topic imu; empty for the topic', default=''))
    imu_rate: float = live(rate_of('imu', 250.0, minimum=10.0, maximum=1000.0))
    gyro_sd: float = live(quantity(
        'rad/s', 'noise of the gyro per reading', default=0.005, minimum=0.0, maximum=10.0))
    gyro_bias: float = live(quantity(
        'rad/s', 'constant error of the gyro', default=0.005, minimum=-1.0, maximum=1.0))
    force_sd: float = live(quantity(
        'm/s2', 'noise of the accelerometer per reading', default=0.1, minimum=0.0, maximum=10.0))
    frame_prefix: str = frame_prefix()
    odom_frame: str = frame('odom')
    base_frame: str = frame('base')
    imu_frame: str = frame('imu')
