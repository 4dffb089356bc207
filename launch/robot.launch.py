# SPDX-License-Identifier: Apache-2.0
"""Start a simulated or real robot with its laws on board, and the obstacle decision."""
from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.ros.launching import describe, HARDWARE, ROBOT, SCENE, TUNING

ARGUMENTS = (
    ('target', 'sim', 'sim for the simulator, hardware for the bridge to a real motor',
     ('sim', 'hardware')),
    ROBOT, TUNING,
    ('decision', 'true', 'Start obstacle_decision, which drives; false to drive by cmd_vel'),
    SCENE,
    ('terrain_rate', '50.0', 'sim: rate of terrain_observation [Hz]; 0 for none'),
    ('start_paused', 'false', 'sim: true to wait for the service simulator/resume'),
    ('publish_clock', 'true', 'sim: false to follow the /clock of another simulator'),
    *HARDWARE,
)


def start(given):
    """Return the nodes; only a simulated robot uses simulated time."""
    simulated = given['target'] == 'sim'
    nodes = simulation(given) if simulated else given.motor('onboard')
    real = None if simulated else load_hardware(given['hardware'])
    if given.flag('decision'):
        # The bridge refuses set-points beyond its angle limit.
        limits = {} if real is None else {'largest_swing': real.limits.angle_limit}
        nodes.append(given.node('obstacle_decision', {
            'use_sim_time': simulated, 'robot': given.robot(real=not simulated),
            'control_tuning': given['tuning'],
            'terrain_frame': given['frame_prefix'] + 'base_link', **limits}))
    robot = given.robot(False) if real is None else real.robot
    return [*nodes, *given.viewers(robot, simulated)]


def simulation(given):
    """Return the simulator, with the laws inside."""
    return [given.node('simulator', {
        'use_sim_time': False, 'control': 'onboard', 'robot': given['robot'],
        'tuning': given['tuning'], 'scene': given['scene'],
        'terrain_rate': given.number('terrain_rate'),
        'start_paused': given.flag('start_paused'),
        'publish_clock': given.flag('publish_clock'), **given.frames()})]


def generate_launch_description():
    """Declare the arguments and start the nodes."""
    return describe(ARGUMENTS, start)
