# SPDX-License-Identifier: Apache-2.0
"""Arguments that the launch files share, and the start of nodes of this package."""
from pathlib import Path
from typing import Any, Callable, Dict, Iterable, List, Mapping, Tuple

from ament_index_python.packages import get_package_prefix, PackageNotFoundError
from launch import LaunchContext, LaunchDescription
from launch.actions import (
    DeclareLaunchArgument, ExecuteProcess, GroupAction, LogInfo, OpaqueFunction, Shutdown)
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node, PushRosNamespace, SetParameter
from launch_ros.parameter_descriptions import ParameterValue

from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.config.files import read_config, shipped_folder
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics.model.robot import load_robot
from ballbot_ros.ros.urdf import robot_description

# Name, default, description and, if the values are limited, the choices.
Argument = Tuple[Any, ...]

# Arguments of all launch files.
SHARED: Tuple[Argument, ...] = (
    ('namespace', '', 'Namespace of all nodes and their topics'),
    ('frame_prefix', '', 'Prefix of the name of each frame, such as left/, with several robots'),
    ('params_file', '', 'YAML file with parameters of the nodes; overrides the other arguments'),
    ('log_level', 'info', 'Lowest logged severity', ('debug', 'info', 'warn', 'error', 'fatal')),
    ('robot_state_publisher', 'true',
     'false: the nodes publish robot_description and all frames themselves'),
    ('rviz', 'false', 'true: start RViz with the view of this package'),
    ('view', 'false', 'true: open a page that shows the robot, with ballbot view --live'))

ROBOT = ('robot', '', 'Name of a robot in config/robots, or the path of a YAML file; empty for '
         'that of the scene, or of the hardware file')
SCENE = ('scene', 'doorstep', 'Name of a scene in config/scenes, or the path of a YAML file')

TUNING = ('tuning', 'gentle',
          'Gains: name of a tuning in config/tunings, or the path of a YAML file')
HARDWARE: Tuple[Argument, ...] = (
    ('hardware', 'gimball_odrive',
     'hardware: name of a hardware file in config/hardware, or the path of a YAML file'),
    ('port', '', 'hardware: serial device, URL or CAN interface; empty for that of the file'),
    ('imu_port', '',
     'hardware: serial device of a WitMotion sensor; empty where another node publishes imu'),
    ('imu_axes', 'x y z', 'hardware: axes of the sensor that point forward, left and up'))

# Topics of rviz/ballbot.rviz that are remapped into the namespace.
RVIZ_TOPICS = ('odom', 'robot_description', 'markers')

BOOLEANS = {'true': True, 'false': False}
# Largest rate at which robot_state_publisher publishes the links [Hz].
LINK_RATE = 100.0


class Given:
    """The values of the arguments of a launch file."""

    def __init__(self, context: LaunchContext):
        self._context = context

    def __getitem__(self, name: str) -> str:
        return str(LaunchConfiguration(name).perform(self._context))

    def robot(self, real: bool) -> str:
        """Return the requested robot, or else that of the hardware or of the scene."""
        if self['robot']:
            return self['robot']
        if real:
            return load_hardware(self['hardware']).robot
        return str(read_config('scenes', self['scene'])[1].get('robot', ''))

    def number(self, name: str) -> float:
        """Return an argument as a number; raise `ConfigurationError` if it is not one."""
        try:
            return float(self[name])
        except ValueError:
            raise ConfigurationError(
                f'launch argument {name} must be a number, got {self[name]!r}',
                'wrong_type', name) from None

    def flag(self, name: str) -> bool:
        """Return an argument as true or false; raise `ConfigurationError` if it is neither."""
        text = self[name].lower()
        if text not in BOOLEANS:
            raise ConfigurationError(
                f'launch argument {name} must be true or false, got {self[name]!r}',
                'wrong_type', name)
        return BOOLEANS[text]

    def node(self, executable: str, parameters: Mapping[str, Any]) -> Node:
        """Return a node of this package; when it ends, the launch shuts down."""
        return Node(
            package='ballbot_ros', executable=executable, output='screen',
            parameters=[typed(parameters), *self._file()],
            arguments=['--ros-args', '--log-level', self['log_level']],
            on_exit=[Shutdown(reason=f'{executable} has ended')])

    def _file(self) -> List[str]:
        given = self['params_file']
        if given and not Path(given).is_file():
            raise ConfigurationError(
                f'launch argument params_file: there is no file {given!r}',
                'missing', 'params_file')
        return [given] if given else []

    def motor(self, control: str) -> List[Any]:
        """Return the bridge, with its source of torque, and the node imu if its port is given."""
        nodes = [self.node('bridge', {
            'control': control, 'tuning': self['tuning'], 'hardware': self['hardware'],
            'port': self['port'], **self.frames()})]
        if self['imu_port']:
            nodes.append(self.node('imu', {
                'port': self['imu_port'], 'axes': self['imu_axes'],
                'frame_prefix': self['frame_prefix']}))
        return nodes

    def frames(self) -> Dict[str, Any]:
        """Return the parameters of a node that publishes frames, see `viewers`."""
        return {'publish_description': not self.flag('robot_state_publisher'),
                'frame_prefix': self['frame_prefix']}

    def viewers(self, robot: str, simulated: bool) -> List[Any]:
        """
        Return robot_state_publisher and the programs that show the robot, those requested.

        Raises `ConfigurationError` with reason ``not_installed`` if robot_state_publisher is
        requested and missing.
        """
        found: List[Any] = []
        if self.flag('robot_state_publisher'):
            try:
                get_package_prefix('robot_state_publisher')
            except (PackageNotFoundError, OSError):  # OSError: no installation is sourced
                raise ConfigurationError(
                    'launch argument robot_state_publisher: the ROS package is not installed; '
                    'install it (ros-$ROS_DISTRO-robot-state-publisher), or launch with '
                    'robot_state_publisher:=false',
                    'not_installed', 'robot_state_publisher') from None
            found.append(Node(
                package='robot_state_publisher', executable='robot_state_publisher',
                parameters=[typed({
                    'robot_description': robot_description(load_robot(robot)),
                    'frame_prefix': self['frame_prefix'], 'publish_frequency': LINK_RATE})]))
        if self.flag('rviz'):
            view = shipped_folder('rviz') / 'ballbot.rviz'
            found.append(Node(
                package='rviz2', executable='rviz2',
                arguments=['-d', str(view), '-f', f'{self["frame_prefix"]}odom'],
                remappings=[(f'/{topic}', topic) for topic in RVIZ_TOPICS]))
        if self.flag('view'):
            words = ['ballbot', 'view', '--live', '--robot', robot]
            if self['namespace']:
                words += ['--namespace', self['namespace']]
            found.append(ExecuteProcess(cmd=words, output='screen'))
        return [SetParameter(name='use_sim_time', value=simulated), *found]


def typed(parameters: Mapping[str, Any]) -> Dict[str, Any]:
    """Return parameters in which text remains text: a robot may be named 1 or true."""
    return {name: ParameterValue(value, value_type=str) if isinstance(value, str) else value
            for name, value in parameters.items()}


def describe(arguments: Iterable[Argument], start: Callable[[Given], List[Any]]
             ) -> LaunchDescription:
    """
    Return a launch description with these arguments and those of all launch files.

    `start` takes the values of the arguments and returns actions; see `together`.
    """
    return LaunchDescription([
        *(DeclareLaunchArgument(name, default_value=default, description=text,
                                **({'choices': choices[0]} if choices else {}))
          for name, default, text, *choices in (*arguments, *SHARED)),
        LogInfo(msg='The first start compiles for one to two minutes before the robot moves.'),
        together(start)])


def together(start: Callable[[Given], List[Any]]) -> OpaqueFunction:
    """Return an action that runs the actions that `start` returns, in the namespace."""
    def expand(context: LaunchContext) -> List[Any]:
        given = Given(context)
        return [GroupAction([PushRosNamespace(given['namespace']), *start(given)])]
    return OpaqueFunction(function=expand)
