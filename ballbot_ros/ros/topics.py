# SPDX-License-Identifier: Apache-2.0
"""The topics of the nodes with type and quality of service; importable without ROS."""
import array
from importlib import import_module
from types import MappingProxyType
from typing import Any, Mapping, NamedTuple

from ballbot_ros.errors import ConfigurationError


class Qos(NamedTuple):
    """Quality of service of a publisher or subscription; the history keeps the last messages."""

    depth: int
    reliable: bool = True
    latched: bool = False  # durability: transient local, else volatile

    def __str__(self) -> str:
        return (f'{"reliable" if self.reliable else "best effort"}, '
                f'{"latched, " if self.latched else ""}depth {self.depth}')


# Publishers of measurements and commands: reliable, so that every subscription matches, and deep
# enough for a recorder that is delayed by some seconds.  A node refuses a delayed command.
STATE = Qos(5000)
# Subscriptions of which only the latest message matters.
LATEST = Qos(1)
# Subscriptions to sensors, whose drivers often publish best effort.
SENSOR = Qos(5, reliable=False)
# Inputs that are matched by their stamps, and diagnostics.
SHORT = Qos(20)
LATCHED = Qos(1, latched=True)
# Latched messages of several publishers, as the listener of tf2 requests them.
STATIC = Qos(100, latched=True)
# Decisions: a recorder receives all of them, other late subscriptions the last one.
DECISION = Qos(1000, latched=True)


class Topic(NamedTuple):
    type: str
    offered: Qos  # of its publishers
    requested: Qos  # of the subscriptions of the nodes
    publishers: str  # nodes of this package, for the documentation
    subscribers: str
    meaning: str


# Topics with a slash in front are the same in every namespace.
TOPICS: Mapping[str, Topic] = MappingProxyType({
    '/clock': Topic('rosgraph_msgs/msg/Clock', STATE, SENSOR, 'simulator', 'simulator',
                    'simulated time'),
    '/tf': Topic('tf2_msgs/msg/TFMessage', STATE, STATE, 'simulator, bridge', 'navigator',
                 'transforms between the [frames](#frames), where tf2_msgs is installed'),
    '/tf_static': Topic('tf2_msgs/msg/TFMessage', LATCHED, STATIC, 'simulator, bridge',
                        'navigator', 'transforms that do not change'),
    '/diagnostics': Topic('diagnostic_msgs/msg/DiagnosticArray', SHORT, SHORT,
                          'simulator, controller, obstacle_decision, navigator, bridge, imu', '',
                          'health of each node, once a second and when it changes'),
    'robot_description': Topic('std_msgs/msg/String', LATCHED, LATCHED, 'simulator, bridge', '',
                               'URDF of the robot'),
    'joint_states': Topic('sensor_msgs/msg/JointState', STATE, LATEST, 'simulator, bridge',
                          'controller', 'angle, rate and torque of `shell` and `pendulum`; on a '
                          'floor also of `lean`, `tilt` and `yaw`'),
    'joint_commands': Topic('sensor_msgs/msg/JointState', STATE, LATEST, 'controller',
                            'simulator, bridge', 'torque of `pendulum` and angle of `lean`, '
                            'stamped like the state that they answer'),
    'set_point': Topic('sensor_msgs/msg/JointState', STATE, LATEST,
                       'obstacle_decision, navigator',
                       'controller, simulator, bridge', 'absolute pendulum angle or joint '
                       'rate, and yaw rate of a ball that turns'),
    'cmd_vel': Topic('geometry_msgs/msg/TwistStamped', LATEST, LATEST, 'navigator',
                     'controller, simulator, bridge', 'speed and, on a floor, yaw rate of the '
                     'ball; geometry_msgs/msg/Twist is accepted, too'),
    'e_stop': Topic('std_msgs/msg/Bool', LATCHED, LATCHED, 'bridge',
                    'controller, simulator, obstacle_decision, navigator, bridge', 'true while '
                    'the e-stop is engaged; volatile publishers are received, too'),
    'odom': Topic('nav_msgs/msg/Odometry', STATE, SHORT, 'simulator, bridge',
                  'obstacle_decision, navigator', 'pose and velocity of `base_link`'),
    'imu': Topic('sensor_msgs/msg/Imu', STATE, SENSOR, 'imu, bridge, emulated_robot', 'bridge',
                 'turn rate and specific force of the shell'),
    'ball_state': Topic('ballbot_ros/msg/BallState', STATE, STATE, 'simulator, emulated_robot', '',
                        'true state, energies and contacts'),
    'step_observation': Topic('ballbot_ros/msg/StepObservation', STATE, SHORT,
                              'simulator, emulated_robot', 'obstacle_decision',
                              'distance and height of the next step'),
    'terrain_observation': Topic('ballbot_ros/msg/TerrainObservation', STATE, SHORT,
                                 'simulator, emulated_robot',
                                 'obstacle_decision, navigator', 'observed terrain ahead '
                                 'as a polyline'),
    'step_decision': Topic('ballbot_ros/msg/StepDecision', DECISION, LATCHED,
                           'obstacle_decision', '', 'decision, reason and predicted success'),
    'goal_pose': Topic('geometry_msgs/msg/PoseStamped', LATEST, LATEST, '', 'navigator',
                       'goal of the navigator, for example from RViz'),
    'scan': Topic('sensor_msgs/msg/LaserScan', STATE, SENSOR, 'simulator', 'navigator',
                  'distances to walls over a full circle, at the height of the ball centre'),
    'plan': Topic('nav_msgs/msg/Path', LATCHED, LATCHED, 'navigator', '', 'route to the goal'),
    'motor_status': Topic('ballbot_ros/msg/MotorStatus', STATE, LATEST, 'bridge', '',
                          'state of the drive, its temperatures and its faults'),
    'map': Topic('nav_msgs/msg/OccupancyGrid', LATCHED, LATCHED, 'simulator', '',
                 'walls of a floor'),
    'battery_state': Topic('sensor_msgs/msg/BatteryState', STATE, LATEST, 'bridge', '',
                           'battery of the robot'),
    'markers': Topic('visualization_msgs/msg/MarkerArray', SHORT, SHORT,
                     'simulator, obstacle_decision, navigator', '', 'see [markers]'
                     '(#visualisation)')})


def message_class(kind: str) -> Any:
    """
    Return the class of a message type such as ``'std_msgs/msg/Bool'``.

    Raises `ConfigurationError` with reason ``missing`` if its package is not installed.
    """
    package, _, name = kind.partition('/msg/')
    try:
        return getattr(import_module(f'{package}.msg'), name)
    except (ImportError, AttributeError) as error:
        raise ConfigurationError(
            f'the message type {kind} is not installed: install the package {package}, or '
            'source the workspace that contains it', 'missing', kind) from error


def plain(value: Any) -> Any:
    """Return a message, or a value in one, as dicts, lists and numbers."""
    if hasattr(value, 'get_fields_and_field_types'):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, (bytes, bytearray)):
        return list(value) if len(value) != 1 else value[0]
    if hasattr(value, 'tolist'):  # an array of numpy or of Python
        return value.tolist()
    if isinstance(value, (list, tuple, array.array)):
        return [plain(one) for one in value]
    return value
