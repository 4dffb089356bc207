# SPDX-License-Identifier: Apache-2.0
"""The parameters of the nodes: name, unit, range, default and meaning of each."""
from dataclasses import dataclass, field, replace
from typing import Any, Tuple

from ballbot_ros.config.fields import count, fixed, flag, live, quantity, text
from ballbot_ros.control import ControlTuning, load_tuning, Supervision
from ballbot_ros.decision import DecisionTuning, load_decision_tuning
from ballbot_ros.decision.planning.planners import PLANNERS
from ballbot_ros.physics.solvers.registry import METHODS
from ballbot_ros.plant import SensorFaults
from ballbot_ros.ros.frames import described, frame, frame_prefix, marked
from ballbot_ros.ros.hardware_settings import BridgeSettings, EmulatedRobotSettings, ImuSettings
from ballbot_ros.ros.setting_fields import file_in, numbers_in, rate_of, Settings

__all__ = ['BridgeSettings', 'ControllerSettings', 'DecisionSettings', 'EmulatedRobotSettings',
           'ImuSettings', 'SimulatorSettings']


def _fault(name: str) -> Any:
    """Declare a fault of both sensors as `SensorFaults` does."""
    declared = SensorFaults.__dataclass_fields__[name]
    return field(default=declared.default, metadata=declared.metadata)


@dataclass(frozen=True)
class SimulatorSettings(Settings):
    """Parameters of the node ``simulator``."""

    scene: str = fixed('the world is built of it', file_in('scenes', 'doorstep'))
    robot: str = fixed('the world is built of it', text(
        'name or file of a robot to put into the scene; empty keeps its own', default=''))
    control_rate: float = fixed('all other rates and the clock are counted in it', quantity(
        'Hz', 'rate of control, and in direct control of joint_states; the motor torque is '
        'constant over a period', default=500.0, minimum=1.0, maximum=10000.0))
    physics_step: float = fixed('the world is built with it', quantity(
        's', 'integration step of a method that has one; a control period is a whole number of '
        'them', default=1e-4, minimum=1e-7, maximum=0.01))
    method: str = fixed('the world is built with it', text(
        'integrator, where no accuracy is asked for', default='rk4', choices=METHODS))
    accuracy: float = fixed('the world is built with it', quantity(
        'm', 'error of position allowed under given torques; chooses the method and is watched on '
        '/diagnostics; 0 to use method and physics_step', default=0.0, minimum=0.0, maximum=0.1))
    real_time_factor: float = live(quantity(
        '1', 'simulated seconds per wall second; 0 for as fast as it goes', default=1.0,
        minimum=0.0, maximum=1000.0))
    lockstep: bool = live(flag(
        'wait for the command that answers each state, so that a run is repeatable to the bit',
        default=False))
    lockstep_patience: float = live(quantity(
        's', 'wall time after which a missing answer is reported', default=2.0, minimum=0.1,
        maximum=3600.0))
    start_paused: bool = fixed('it says how to begin; call ~/pause or ~/resume', flag(
        'wait for the service ~/resume or ~/step', default=False))
    control: str = fixed('topics and laws are made for it', text(
        'where the torque comes from: `direct` from joint_commands; `onboard` from the laws, run '
        'inside the simulator as in a bridge, by set_point and cmd_vel', default='direct',
        choices=('direct', 'onboard')))
    tuning: str = live(file_in('tunings', 'published', doc=': gains of the laws inside'))
    set_point_timeout: float = live(quantity(
        's', 'on board, simulated age of a set-point after which the pendulum is let down; 0 for '
        'never', default=0.5, minimum=0.0, maximum=3600.0))
    joint_state_rate: float = live(rate_of(
        'joint_states on board; in direct control it is control_rate', 100.0))
    command_timeout: float = live(quantity(
        's', 'simulated time after which a command is not followed any more', default=0.1,
        minimum=1e-3, maximum=10.0))
    torque_limit: float = live(quantity(
        'N m', 'largest torque at the pendulum, where the motor could give more; 0 for none but '
        'that of the motor', default=0.0, minimum=0.0, maximum=1e6))
    publish_clock: bool = fixed('who makes the time is said at the start', flag(
        'make the time of the graph and publish it as /clock; false to follow the /clock of '
        'another simulator', default=True))
    clock_rate: float = live(rate_of(
        '/clock in simulated time; 0 for one before all that is published, so that no stamp is '
        'ahead of it', 0.0, minimum=0.0))
    odom_rate: float = live(rate_of('odom', 100.0))
    ball_state_rate: float = live(rate_of('ball_state', 100.0))
    observation_rate: float = live(rate_of('step_observation; 0 for none', 50.0, minimum=0.0))
    observation_reach: float = live(quantity(
        'm', 'how far ahead the step sensor sees', default=3.0, above=0.0, maximum=1000.0))
    observation_distance_sd: float = live(quantity(
        'm', 'standard deviation of the observed distance', default=0.0, minimum=0.0,
        maximum=10.0))
    observation_height_sd: float = live(quantity(
        'm', 'standard deviation of the observed height', default=0.0, minimum=0.0, maximum=1.0))
    terrain_rate: float = live(rate_of('terrain_observation; 0 for none', 0.0, minimum=0.0))
    terrain_reach: float = live(quantity(
        'm', 'how far ahead the terrain sensor sees', default=3.0, above=0.0, maximum=100.0))
    terrain_height_sd: float = live(quantity(
        'm', 'standard deviation of the height of a point of the terrain', default=0.0,
        minimum=0.0, maximum=1.0))
    sensor_told: float = live(_fault('told'))
    sensor_bias: float = live(_fault('bias'))
    sensor_scale: float = live(_fault('scale'))
    sensor_growth: float = live(_fault('growth'))
    sensor_dropout: float = live(_fault('dropout'))
    sensor_latency: float = live(_fault('latency'))
    sensor_holes: float = live(_fault('holes'))
    sensor_offset: float = live(_fault('offset'))
    sensor_tilt: float = live(_fault('tilt'))
    seed: int = live(count('seed of the noise and the losses of the sensors', default=0))
    publish_markers: bool = marked('ground, contacts and forces')
    publish_description: bool = described()
    frame_prefix: str = frame_prefix()
    odom_frame: str = frame('odom')
    footprint_frame: str = frame('footprint')
    base_frame: str = frame('base')
    imu_frame: str = frame('imu')
    gains: ControlTuning = numbers_in('tuning', ControlTuning, load_tuning, 'gains.')


@dataclass(frozen=True)
class ControllerSettings(Settings):
    """Parameters of the node ``controller``."""

    robot: str = fixed('the laws are made for it', file_in('robots', 'gimball'))
    tuning: str = live(file_in('tunings', 'published'))
    torque_limit: float = live(quantity(
        'N m', 'largest torque asked for; 0 takes that of the tuning', default=0.0, minimum=0.0,
        maximum=1e6))
    rate: float = live(quantity(
        'Hz', 'rate of joint_states that the loop is checked for, and must then have',
        default=500.0, minimum=1.0, maximum=100000.0))
    delay: int = live(count(
        'samples between a state and the torque that answers it; 0 fits the simulator, which '
        'applies the answer to the very period that the state begins', default=0, maximum=10))
    state_timeout: float = live(quantity(
        's', 'wall time without a joint state after which the torque is set to 0', default=0.1,
        minimum=0.005, maximum=10.0))
    set_point_timeout: float = live(quantity(
        's', 'age of a set-point, on the clock of the joint states, after which the pendulum is '
        'let down; 0 for never', default=0.5, minimum=0.0, maximum=3600.0))
    lockstep_set_point_period: float = live(quantity(
        's', 'answer a state only with the set-point of its own period of this length, for runs '
        'that are repeatable to the bit; 0 to take what is there', default=0.0, minimum=0.0,
        maximum=10.0))
    gains: ControlTuning = numbers_in('tuning', ControlTuning, load_tuning, 'gains.')

    @property
    def loop(self) -> Tuple[ControlTuning, float, int]:
        """Return the gains under the torque limit in force, rate [Hz] and delay [samples]."""
        limit = self.torque_limit
        gains = self.gains if limit == 0.0 else replace(self.gains, torque_limit=limit)
        return gains, self.rate, self.delay

    @property
    def supervision(self) -> Supervision:
        """Return what is expected of those that publish."""
        return Supervision(set_point_timeout=self.set_point_timeout,
                           set_point_period=self.lockstep_set_point_period)


@dataclass(frozen=True)
class DecisionSettings(Settings):
    """Parameters of the node ``obstacle_decision``."""

    robot: str = fixed('what was learned rests on it', file_in('robots', 'gimball'))
    curve: str = live(file_in('curves', 'gimball_down', 'height curve'))
    variant: str = live(text(
        'which cubic of the curve: the best fit, or one that is nowhere above the simulation',
        default='fit', choices=('fit', 'conservative')))
    tuning: str = live(file_in('tunings', 'decision_default', 'decision tuning'))
    control_tuning: str = live(file_in(
        'tunings', 'published', doc=': that of the laws that drive'))
    outcome_log: str = fixed('it is read, and learned from, at the start', text(
        'file that keeps what came of each attempt, and is learned from at the start; empty for '
        'none', default=''))
    terrain_frame: str = fixed('the ground seen so far is in it', text(
        'frame in which terrain_observation must be: level, at the centre of the ball, and not '
        'rolling', default='base_link'))
    planner: str = fixed('what it calls is compiled at the start', text(
        'how decisions are made', default='rollout', choices=tuple(PLANNERS)))
    publish_markers: bool = marked('the step ahead, the height that is allowed and the words')
    wait_for_goal: bool = fixed('a goal, or ~/resume, ends the waiting', flag(
        'stand until there is a goal, or ~/resume is called', default=False))
    margins: DecisionTuning = numbers_in('tuning', DecisionTuning, load_decision_tuning)
