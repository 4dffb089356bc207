# SPDX-License-Identifier: Apache-2.0
"""The parameters of the node: name, unit, range, default and meaning."""
from dataclasses import dataclass

from ballbot_ros.config.fields import count, fixed, flag, live, quantity, text
from ballbot_ros.control import ControlTuning, load_tuning
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.floors.floor import load_floor, start_on
from ballbot_ros.physics.model.robot import load_robot
from ballbot_ros.physics.simulation.scene import load_scene
from ballbot_ros.physics.simulation.solver import METHODS, Solver
from ballbot_ros.plant import FloorPlant, Plant, SensorFaults
from ballbot_ros.ros.frames import described, frame, frame_prefix, marked
from ballbot_ros.ros.settings import file_in, numbers_in, numbers_of, rate_of, Settings


@dataclass(frozen=True)
class SimulatorSettings(Settings):
    """Parameters of the node ``simulator``."""

    scene: str = fixed('the simulation is built from it', file_in('scenes', 'doorstep'))
    robot: str = fixed('the simulation is built from it', text(
        'name or file of a robot for the scene; empty for that of the scene, and for gimball on '
        'a floor', default=''))
    floor: str = fixed('the simulation is built from it', text(
        'name of a floor in config/floors, or a YAML file, to drive on in place of the scene; '
        'empty for the scene', default=''))
    start: str = fixed('the simulation is built from it', text(
        'x, y [m] and heading [rad] of the start on the floor, separated by commas; empty for '
        'that in the floor file', default=''))
    control_rate: float = fixed('all other rates and the clock depend on it', quantity(
        'Hz', 'control rate and, in direct control, rate of joint_states; the motor torque is '
        'constant over a period', default=500.0, minimum=1.0, maximum=10000.0))
    physics_step: float = fixed('the simulation is built with it', quantity(
        's', 'integration step of a fixed-step method; a control period is an integer multiple of '
        'it', default=1e-4, minimum=1e-7, maximum=0.01))
    method: str = fixed('the simulation is built with it', text(
        'integrator, if accuracy is 0', default='rk4', choices=METHODS))
    accuracy: float = fixed('the simulation is built with it', quantity(
        'm', 'allowed position error for given torques; selects the method, is reported on '
        '/diagnostics; 0 to use method and physics_step', default=0.0, minimum=0.0, maximum=0.1))
    real_time_factor: float = live(quantity(
        '1', 'simulated seconds per wall second; 0 for maximum speed', default=1.0,
        minimum=0.0, maximum=1000.0))
    lockstep: bool = live(flag(
        'wait for the command that answers each state, so that runs are bit-identical',
        default=False))
    lockstep_timeout: float = live(quantity(
        's', 'wall time after which a missing answer is reported', default=2.0, minimum=0.1,
        maximum=3600.0))
    start_paused: bool = fixed('it applies at the start; call ~/pause or ~/resume', flag(
        'wait for the service ~/resume or ~/step', default=False))
    control: str = fixed('topics and laws are created for it', text(
        'source of the torque: `direct` for joint_commands; `onboard` for the laws inside the '
        'simulator, which follow set_point and cmd_vel, as in a bridge',
        default='direct', choices=('direct', 'onboard')))
    tuning: str = live(file_in('tunings', 'published', doc=': gains of the laws inside'))
    set_point_timeout: float = live(quantity(
        's', 'on board, simulated age of a set-point after which the pendulum is lowered; 0 for '
        'never', default=0.5, minimum=0.0, maximum=3600.0))
    joint_state_rate: float = live(rate_of(
        'joint_states on board; in direct control it is control_rate', 100.0))
    command_timeout: float = live(quantity(
        's', 'simulated age after which a command is dropped', default=0.1,
        minimum=1e-3, maximum=10.0))
    torque_limit: float = live(quantity(
        'N m', 'largest torque at the pendulum, below that of the motor; 0 for '
        'that of the motor', default=0.0, minimum=0.0, maximum=1000.0))
    publish_clock: bool = fixed('the source of the time is fixed at the start', flag(
        'publish the time of the graph as /clock; false to follow the /clock of '
        'another simulator', default=True))
    clock_rate: float = live(rate_of(
        '/clock in simulated time; 0 to publish it before each other message, so that no stamp '
        'is ahead of it', 0.0, minimum=0.0))
    odom_rate: float = live(rate_of('odom', 100.0))
    ball_state_rate: float = live(rate_of('ball_state', 100.0))
    observation_rate: float = live(rate_of(
        'step_observation, which contains the next step but no terrain behind it; 0 for none',
        0.0, minimum=0.0))
    observation_reach: float = live(quantity(
        'm', 'range of the step sensor', default=3.0, above=0.0, maximum=1000.0))
    observation_distance_sd: float = live(quantity(
        'm', 'standard deviation of the observed distance', default=0.0, minimum=0.0,
        maximum=10.0))
    observation_height_sd: float = live(quantity(
        'm', 'standard deviation of the observed height', default=0.0, minimum=0.0, maximum=1.0))
    terrain_rate: float = live(rate_of('terrain_observation; 0 for none', 50.0, minimum=0.0))
    terrain_reach: float = live(quantity(
        'm', 'range of the terrain sensor', default=3.0, above=0.0, maximum=100.0))
    terrain_height_sd: float = live(quantity(
        'm', 'standard deviation of the height of a point of the terrain', default=0.0,
        minimum=0.0, maximum=1.0))
    scan_rate: float = live(rate_of('scan on a floor; 0 for none', 10.0, minimum=0.0))
    scan_reach: float = live(quantity(
        'm', 'range of the scan', default=8.0, above=0.0, maximum=100.0))
    scan_beams: int = live(count('beams of a scan, over a full circle', default=360, minimum=1,
                                 maximum=3600))
    scan_sd: float = live(quantity(
        'm', 'standard deviation of a distance in the scan', default=0.0, minimum=0.0,
        maximum=1.0))
    map_sd: float = live(quantity(
        'm', 'standard deviation of the drifting position error of odom on the map; 0 for '
        'none', default=0.0, minimum=0.0, maximum=10.0))
    map_heading_sd: float = live(quantity(
        'rad', 'standard deviation of the drifting heading error of odom on the map; 0 for '
        'none', default=0.0, minimum=0.0, maximum=3.2))
    sensor: SensorFaults = numbers_of(SensorFaults, 'sensor_')
    seed: int = live(count('seed of the noise and the dropouts of the sensors', default=0))
    publish_markers: bool = marked('ground, contacts and forces')
    publish_description: bool = described()
    frame_prefix: str = frame_prefix()
    map_frame: str = frame('map')
    odom_frame: str = frame('odom')
    footprint_frame: str = frame('footprint')
    base_frame: str = frame('base')
    imu_frame: str = frame('imu')
    gains: ControlTuning = numbers_in('tuning', ControlTuning, load_tuning, 'gains.')


def plant_for(settings: SimulatorSettings) -> Plant:
    """Return the plant at its start; raise `ConfigurationError` if parameters are inconsistent."""
    solver, limit = Solver(settings.method, settings.physics_step), settings.torque_limit or None
    if not settings.floor:
        if settings.start:
            raise ConfigurationError(
                f'start is a pose on a floor, got {settings.start!r} without one; set floor, or '
                'leave start empty', 'inconsistent', 'start')
        scene = load_scene(settings.scene, settings.robot or None, solver)
        return Plant(scene, settings.control_rate, limit, settings.accuracy or None)
    if settings.accuracy:
        raise ConfigurationError(
            f'accuracy must be 0 on a floor, where no second run confirms it, got '
            f'{settings.accuracy:g} m', 'inconsistent', 'accuracy')
    floor = load_floor(settings.floor)
    return FloorPlant(load_robot(settings.robot or 'gimball'), floor,
                      start_on(floor, settings.start), settings.control_rate, limit, solver)
