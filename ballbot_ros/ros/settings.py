# SPDX-License-Identifier: Apache-2.0
"""The parameters of the nodes: name, unit, range, default and meaning of each."""
from dataclasses import dataclass

from ballbot_ros.config.fields import Checked, count, flag, quantity, text
from ballbot_ros.decision.planners import PLANNERS
from ballbot_ros.physics.simulation.model import METHODS


@dataclass(frozen=True)
class SimulatorSettings(Checked):
    """Parameters of the node ``simulator``."""

    scene: str = text('name of a scene in config/scenes, or a YAML file', default='doorstep')
    robot: str = text('name or file of a robot to put into the scene; empty keeps its own',
                      default='')
    control_rate: float = quantity(
        'Hz', 'rate of joint_states; the motor torque is constant over a period', default=500.0,
        minimum=1.0, maximum=10000.0)
    physics_step: float = quantity(
        's', 'integration step of a method that has one; a control period is a whole number of '
        'them', default=1e-4,
        minimum=1e-7, maximum=0.01)
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
    command_timeout: float = quantity(
        's', 'simulated time after which a command is not followed any more', default=0.1,
        minimum=1e-3, maximum=10.0)
    torque_limit: float = quantity(
        'N m', 'largest torque at the pendulum; 0 takes that of the motor of the robot',
        default=0.0, minimum=0.0, maximum=1e6)
    clock_rate: float = quantity(
        'Hz', 'rate of /clock in simulated time', default=100.0, minimum=1.0, maximum=250.0)
    odom_rate: float = quantity(
        'Hz', 'rate of odom', default=100.0, minimum=1.0, maximum=10000.0)
    ball_state_rate: float = quantity(
        'Hz', 'rate of ball_state', default=100.0, minimum=1.0, maximum=10000.0)
    observation_rate: float = quantity(
        'Hz', 'rate of step_observation', default=50.0, minimum=0.1, maximum=10000.0)
    observation_reach: float = quantity(
        'm', 'how far ahead the step sensor sees', default=3.0, above=0.0, maximum=1000.0)
    observation_distance_sd: float = quantity(
        'm', 'standard deviation of the observed distance', default=0.0, minimum=0.0,
        maximum=10.0)
    observation_height_sd: float = quantity(
        'm', 'standard deviation of the observed height', default=0.0, minimum=0.0,
        maximum=1.0)
    seed: int = count('of the observation noise', default=0)


@dataclass(frozen=True)
class ControllerSettings(Checked):
    """Parameters of the node ``controller``."""

    robot: str = text('name of a robot in config/robots, or a YAML file', default='gimball')
    tuning: str = text('name of a tuning in config/tunings, or a YAML file',
                       default='published')
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
    lockstep_set_point_period: float = quantity(
        's', 'answer a state only with the set-point of its own period of this length, for runs '
        'that are repeatable to the bit; 0 to take what is there', default=0.0, minimum=0.0,
        maximum=10.0)


@dataclass(frozen=True)
class DecisionSettings(Checked):
    """Parameters of the node ``obstacle_decision``."""

    robot: str = text('name of a robot in config/robots, or a YAML file', default='gimball')
    curve: str = text('name of a height curve in config/curves, or a YAML file',
                      default='gimball_down')
    variant: str = text(
        'of the curve: the best fit, or the one that is nowhere above the simulation',
        default='fit', choices=('fit', 'conservative'))
    tuning: str = text('name of a decision tuning in config/tunings, or a YAML file',
                       default='decision_default')
    planner: str = text('how decisions are made', default='cubic', choices=tuple(PLANNERS))


@dataclass(frozen=True)
class BridgeSettings(Checked):
    """Parameters of the node ``bridge``."""

    hardware: str = text('name of a hardware file in config/hardware, or a YAML file',
                         default='gimball_odrive')
    port: str = text('serial device or URL; empty for that of the hardware file', default='')
    baud: int = count('bits per second; 0 for those of the hardware file', default=0,
                      maximum=20_000_000)
    tuning: str = text('gains that the controller runs with: the loop is checked for them',
                       default='gentle')
    delay: int = count('samples from a joint state to the torque that answers it, for the check',
                       default=1, maximum=10)
    autostart: bool = flag(
        'configure and activate at start, and again until it works; the e-stop is engaged all '
        'the same', default=True)
    capture: str = text('file for the raw traffic of the serial line; empty for none', default='')
    status_rate: float = quantity(
        'Hz', 'rate of motor_status', default=10.0, minimum=0.1, maximum=100.0)


@dataclass(frozen=True)
class EmulatedRobotSettings(Checked):
    """Parameters of the node ``emulated_robot``."""

    hardware: str = text('name of a hardware file in config/hardware, or a YAML file, whose '
                         'protocol and baud rate the drive has', default='gimball_odrive')
    firmware: str = text('generation that the drive is of, `0.5` or `0.6` for an ODrive; empty '
                         'for the only or oldest one', default='')
    scene: str = text('name of a scene in config/scenes, or a YAML file', default='doorstep')
    link: str = text('symbolic link to keep pointing to the serial device',
                     default='/tmp/ballbot_motor')
    imu_rate: float = quantity('Hz', 'rate of imu', default=250.0, minimum=10.0, maximum=1000.0)
    gyro_sd: float = quantity('rad/s', 'noise of the gyro per reading', default=0.005,
                              minimum=0.0, maximum=10.0)
    gyro_bias: float = quantity('rad/s', 'constant error of the gyro', default=0.005,
                                minimum=-1.0, maximum=1.0)
    force_sd: float = quantity('m/s2', 'noise of the accelerometer per reading', default=0.1,
                               minimum=0.0, maximum=10.0)
