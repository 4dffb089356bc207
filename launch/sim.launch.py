# SPDX-License-Identifier: Apache-2.0
"""Start the simulator and the controller of a ball robot, which follows set-points."""
from launch_ros.actions import SetParameter

from ballbot_ros.ros.launching import describe, ROBOT, SCENE

ARGUMENTS = (
    ROBOT, SCENE,
    ('floor', '', 'Name of a floor in config/floors, or the path of a YAML file, to drive on in '
     'place of the scene'),
    ('start', '', 'Start pose on the floor: x, y [m], heading [rad]; empty for that of its file'),
    ('lockstep', 'false', 'true: each period waits for its command, so that a run is repeatable'),
    ('terrain_rate', '50.0', 'Rate of terrain_observation [Hz]; 0 for none'),
    ('observation_rate', '0.0', 'Rate of step_observation [Hz]; 0 for none'),
    ('real_time_factor', '1.0', 'Simulated seconds per second; 0 means as fast as possible'),
    ('start_paused', 'false', 'true: wait for the service simulator/resume or simulator/step'),
)


def start(given):
    """Return both nodes and the programs that show the robot."""
    robot = given.robot(real=False)
    return [
        # The simulator publishes /clock, so it must not wait for it.
        given.node('simulator', {
            'use_sim_time': False, 'robot': robot, 'scene': given['scene'],
            'floor': given['floor'], 'start': given['start'],
            'lockstep': given.flag('lockstep'), 'start_paused': given.flag('start_paused'),
            'terrain_rate': given.number('terrain_rate'),
            'observation_rate': given.number('observation_rate'),
            'real_time_factor': given.number('real_time_factor'), **given.frames()}),
        SetParameter(name='use_sim_time', value=True),
        given.node('controller', {'robot': robot}),
        *given.viewers(robot, simulated=True)]


def generate_launch_description():
    """Declare the arguments and start both nodes."""
    return describe(ARGUMENTS, start)
