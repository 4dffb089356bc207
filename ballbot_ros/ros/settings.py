# SPDX-License-Identifier: Apache-2.0
"""The parameters of the nodes: name, unit, range, default and meaning of each."""
from dataclasses import dataclass, field
from typing import Any

from ballbot_ros.bridge.realtime import Scheduling
from ballbot_ros.config.fields import Checked, count, flag, quantity, text
from ballbot_ros.decision.planners import PLANNERS
from ballbot_ros.physics.solvers.registry import METHODS
from ballbot_ros.plant import SensorFaults
from ballbot_ros.ros.cmd_vel import cmd_vel_type


def _file(folder: str, default: str, kind: str = '', doc: str = '') -> Any:
    """Declare the name of a file in a folder of config."""
    return text(f'name of a {kind or folder[:-1]} in config/{folder}, or a YAML file{doc}',
                default=default)


def _rate(topic: str, default: float, minimum: float = 1.0, maximum: float = 10000.0) -> Any:
    """Declare how often a topic is published."""
    return quantity('Hz', f'rate of {topic}', default=default, minimum=minimum, maximum=maximum)


def _fault(name: str) -> Any:
    """Declare a fault of both sensors as `SensorFaults` does."""
    declared = SensorFaults.__dataclass_fields__[name]
    return field(default=declared.default, metadata=declared.metadata)


@dataclass(frozen=True)
class SimulatorSettings(Checked):
    """Parameters of the node ``simulator``."""

    scene: str = _file('scenes', 'doorstep')
    robot: str = text('name or file of a robot to put into the scene; empty keeps its own',
                      default='')
    control_rate: float = quantity(
        'Hz', 'rate of control, and in direct control of joint_states; the motor torque is '
        'constant over a period', default=500.0, minimum=1.0, maximum=10000.0)
    physics_step: float = quantity(
        's', 'integration step of a method that has one; a control period is a whole number of '
        'them', default=1e-4, minimum=1e-7, maximum=0.01)
    method: str = text('integrator, where no accuracy is asked for', default='rk4',
                       choices=METHODS)
    accuracy: float = quantity(
        'm', 'error of position allowed under given torques; chooses the method and is watched on '
        '/diagnostics; 0 to use method and physics_step', default=0.0, minimum=0.0, maximum=0.1)
    real_time_factor: float = quantity(
        '1', 'simulated seconds per wall second; 0 for as fast as it goes', default=1.0,
        minimum=0.0, maximum=1000.0)
    lockstep: bool = flag(
        'wait for the command that answers each state, so that a run is repeatable to the bit',
        default=False)
    lockstep_patience: float = quantity(
        's', 'wall time after which a missing answer is reported', default=2.0, minimum=0.1,
        maximum=3600.0)
    start_paused: bool = flag('wait for the service ~/resume or ~/step', default=False)
    control: str = text(
        'where the torque comes from: `direct` from joint_commands; `onboard` from the laws, run '
        'inside the simulator as in a bridge, by set_point and cmd_vel', default='direct',
        choices=('direct', 'onboard'))
    tuning: str = _file('tunings', 'published', doc=': gains of the laws inside')
    set_point_timeout: float = quantity(
        's', 'on board, simulated age of a set-point after which the pendulum is let down; 0 for '
        'never', default=0.5, minimum=0.0, maximum=3600.0)
    cmd_vel_type: str = cmd_vel_type()
    joint_state_rate: float = _rate(
        'joint_states on board; in direct control it is control_rate', 100.0)
    command_timeout: float = quantity(
        's', 'simulated time after which a command is not followed any more', default=0.1,
        minimum=1e-3, maximum=10.0)
    torque_limit: float = quantity(
        'N m', 'largest torque at the pendulum, where the motor could give more; 0 for none but '
        'that of the motor', default=0.0, minimum=0.0, maximum=1e6)
    clock_rate: float = _rate('/clock in simulated time', 100.0, maximum=250.0)
    odom_rate: float = _rate('odom', 100.0)
    ball_state_rate: float = _rate('ball_state', 100.0)
    observation_rate: float = _rate('step_observation; 0 for none', 50.0, minimum=0.0)
    observation_reach: float = quantity(
        'm', 'how far ahead the step sensor sees', default=3.0, above=0.0, maximum=1000.0)
    observation_distance_sd: float = quantity(
        'm', 'standard deviation of the observed distance', default=0.0, minimum=0.0, maximum=10.0)
    observation_height_sd: float = quantity(
        'm', 'standard deviation of the observed height', default=0.0, minimum=0.0, maximum=1.0)
    terrain_rate: float = _rate('terrain_observation; 0 for none', 0.0, minimum=0.0)
    terrain_reach: float = quantity(
        'm', 'how far ahead the terrain sensor sees', default=3.0, above=0.0, maximum=100.0)
    terrain_height_sd: float = quantity(
        'm', 'standard deviation of the height of a point of the terrain', default=0.0,
        minimum=0.0, maximum=1.0)
    sensor_told: float = _fault('told')
    sensor_bias: float = _fault('bias')
    sensor_scale: float = _fault('scale')
    sensor_growth: float = _fault('growth')
    sensor_dropout: float = _fault('dropout')
    sensor_latency: float = _fault('latency')
    sensor_holes: float = _fault('holes')
    sensor_offset: float = _fault('offset')
    sensor_tilt: float = _fault('tilt')
    seed: int = count('of the noise and the losses of the sensors', default=0)


@dataclass(frozen=True)
class ControllerSettings(Checked):
    """Parameters of the node ``controller``."""

    robot: str = _file('robots', 'gimball')
    tuning: str = _file('tunings', 'published')
    torque_limit: float = quantity(
        'N m', 'largest torque asked for; 0 takes that of the tuning', default=0.0, minimum=0.0,
        maximum=1e6)
    rate: float = quantity(
        'Hz', 'rate of joint_states that the loop is checked for, and must then have',
        default=500.0, minimum=1.0, maximum=100000.0)
    delay: int = count(
        'samples between a state and the torque that answers it; 0 fits the simulator, which '
        'applies the answer to the very period that the state begins', default=0, maximum=10)
    state_timeout: float = quantity(
        's', 'wall time without a joint state after which the torque is set to 0', default=0.1,
        minimum=0.005, maximum=10.0)
    set_point_timeout: float = quantity(
        's', 'age of a set-point, on the clock of the joint states, after which the pendulum is '
        'let down; 0 for never', default=0.5, minimum=0.0, maximum=3600.0)
    cmd_vel_type: str = cmd_vel_type()
    lockstep_set_point_period: float = quantity(
        's', 'answer a state only with the set-point of its own period of this length, for runs '
        'that are repeatable to the bit; 0 to take what is there', default=0.0, minimum=0.0,
        maximum=10.0)


@dataclass(frozen=True)
class DecisionSettings(Checked):
    """Parameters of the node ``obstacle_decision``."""

    robot: str = _file('robots', 'gimball')
    curve: str = _file('curves', 'gimball_down', 'height curve')
    variant: str = text(
        'of the curve: the best fit, or the one that is nowhere above the simulation',
        default='fit', choices=('fit', 'conservative'))
    tuning: str = _file('tunings', 'decision_default', 'decision tuning')
    control_tuning: str = _file(
        'tunings', 'published', doc=': that of the laws that drive')
    outcome_log: str = text(
        'file that keeps what came of each attempt, and is learned from at the start; empty for '
        'none', default='')
    terrain_frame: str = text(
        'frame in which terrain_observation must be: level, at the centre of the ball, and not '
        'rolling', default='base_link')
    planner: str = text('how decisions are made', default='rollout', choices=tuple(PLANNERS))


@dataclass(frozen=True)
class BridgeSettings(Checked):
    """Parameters of the node ``bridge``."""

    hardware: str = _file('hardware', 'gimball_odrive', 'hardware file')
    port: str = text(
        'serial device, URL or CAN interface; empty for that of the hardware file', default='')
    baud: int = count('bits per second; 0 for those of the hardware file', default=0,
                      maximum=20_000_000)
    control: str = text(
        'where the torque comes from: `onboard` from the laws, run in the loop of the bridge, by '
        'set_point and cmd_vel; `direct` from joint_commands', default='onboard',
        choices=('onboard', 'direct'))
    tuning: str = text('gains of the laws on board, or that the controller runs with: the loop is '
                       'checked for them', default='gentle')
    delay: int = count('samples from a joint state to the torque that answers it, for the check '
                       'of direct control', default=1, maximum=10)
    set_point_timeout: float = quantity(
        's', 'on board, age of a set-point after which the pendulum is let down', default=0.5,
        minimum=0.05, maximum=10.0)
    cmd_vel_type: str = cmd_vel_type()
    joint_state_rate: float = _rate(
        'joint_states on board, at most that of the loop; in direct control it is that of the '
        'loop', 100.0)
    autostart: bool = flag(
        'configure and activate at start, and again until it works; the e-stop is engaged all '
        'the same', default=True)
    capture: str = text('file for the raw traffic of the line; empty for none', default='')
    black_box: str = text(
        'folder for files with the last ten minutes before a fault, see `ballbot replay`; '
        '`~/.ros` is `ROS_HOME` where that is set; empty for none', default='~/.ros/ballbot')
    status_rate: float = _rate('motor_status', 10.0, minimum=0.1, maximum=100.0)
    realtime_priority: int = count(
        'of SCHED_FIFO for the loop, and one less for the other threads; 0 for none', default=0,
        maximum=99)
    cpu: int = count('processor that the loop runs on; -1 for any', default=-1, minimum=-1,
                     maximum=1023)
    lock_memory: bool = flag('keep the memory of the process from being swapped out',
                             default=False)
    odom_rate: float = _rate('odom and, where tf2_msgs is installed, /tf; 0 for none', 100.0,
                             minimum=0.0, maximum=1000.0)

    @property
    def scheduling(self) -> Scheduling:
        """Return what the loop asks of the system."""
        return Scheduling(self.realtime_priority, self.cpu, self.lock_memory)


@dataclass(frozen=True)
class ImuSettings(Checked):
    """Parameters of the node ``imu``."""

    port: str = text('serial device or URL; best a name in /dev/serial/by-id',
                     default='/dev/ballbot_imu')
    baud: int = count(
        'bits per second; a sensor at the 9600 of the factory is told to use these',
        default=115200, minimum=4800, maximum=230400)
    rate: int = count('readings a second that the sensor is told to send: 10, 20, 50, 100 or 200',
                      default=200, minimum=10, maximum=200)
    bandwidth: int = count(
        'of the filters in the sensor [Hz] that it is told to use: 5, 10, 20, 42, 98, 188 or 256',
        default=98, minimum=5, maximum=256)
    axes: str = text(
        'which axis of the sensor points forward, which left and which up when the shell stands '
        'at ball angle 0, such as `-y x z`', default='x y z')
    latency: float = quantity(
        's', 'from what is measured to the first byte that says so; the filters of 98 Hz take '
        '0.003', default=0.003, minimum=0.0, maximum=0.1)
    gyro_sd: float = quantity(
        'rad/s', 'noise of the gyro per reading, for the covariance', default=0.005, above=0.0,
        maximum=10.0)
    force_sd: float = quantity(
        'm/s2', 'noise of the accelerometer per reading, likewise', default=0.05, above=0.0,
        maximum=10.0)


@dataclass(frozen=True)
class EmulatedRobotSettings(Checked):
    """Parameters of the node ``emulated_robot``."""

    hardware: str = _file('hardware', 'gimball_odrive', 'hardware file',
                          ', whose protocol and baud rate the drive has')
    firmware: str = text('generation that the drive is of, `0.5` or `0.6` for an ODrive; empty '
                         'for the only or oldest one', default='')
    scene: str = _file('scenes', 'doorstep')
    link: str = text('symbolic link to keep pointing to the serial device',
                     default='/tmp/ballbot_motor')
    publish_odom: bool = flag(
        'publish the true odom, 83 times a second, for a bridge whose odom_rate is 0',
        default=False)
    imu_link: str = text(
        'symbolic link to the serial device of an emulated WitMotion sensor, in place of the '
        'topic imu; empty for the topic', default='')
    imu_rate: float = _rate('imu', 250.0, minimum=10.0, maximum=1000.0)
    gyro_sd: float = quantity(
        'rad/s', 'noise of the gyro per reading', default=0.005, minimum=0.0, maximum=10.0)
    gyro_bias: float = quantity(
        'rad/s', 'constant error of the gyro', default=0.005, minimum=-1.0, maximum=1.0)
    force_sd: float = quantity(
        'm/s2', 'noise of the accelerometer per reading', default=0.1, minimum=0.0, maximum=10.0)
