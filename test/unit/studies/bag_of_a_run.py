# SPDX-License-Identifier: Apache-2.0
"""Bags with the topics of the simulator, written without ROS."""
import numpy as np

from ballbot_ros.bags.recorded_run import BALL_STATE, LATERAL_STATE
from ballbot_ros.bags.replay import plant_values
from ballbot_ros.bags.writer import message_types, RosbagsWriter

TYPES = message_types()


class BagOf:
    """Writer of the messages of a simulator, which uses only rosbags."""

    def __init__(self, folder, metadata, namespace=''):
        self.writer = RosbagsWriter(folder, metadata)
        self.writer.open()
        self.namespace, self.topics = namespace, {}

    def write(self, place, kind, stamp, **fields):
        types = TYPES.types
        header = types['std_msgs/msg/Header'](
            types['builtin_interfaces/msg/Time'](stamp // 10**9, stamp % 10**9), '')
        topic = f'{self.namespace}/{place}'
        if topic not in self.topics:
            self.topics[topic] = self.writer.add_topic(topic, kind)
        message = types[kind](header=header, **fields)
        self.writer.write(self.topics[topic], stamp, TYPES.serialize_cdr(message, kind))

    def joints(self, name, stamp, names, position=(), velocity=(), effort=()):
        self.write(name, 'sensor_msgs/msg/JointState', stamp, name=names,
                   **{key: np.array(values, dtype=float) for key, values in (
                       ('position', position), ('velocity', velocity), ('effort', effort))})

    def state(self, plant, ball=True):
        stamp, state = round(plant.time * 1e9), plant.state
        self.joints('joint_states', stamp, ['shell', 'pendulum'],
                    [state.ball_angle, state.joint_angle], [state.ball_rate, state.joint_rate],
                    [0.0, plant.torque])
        if ball and plant.periods % 5 == 0:
            values = plant_values(plant)
            zero = dict.fromkeys((
                'kinetic_energy', 'potential_energy', 'contact_energy', 'dissipated_energy'), 0.0)
            self.write('ball_state', 'ballbot_ros/msg/BallState', stamp, contacts=[],
                       **{name: values[name] for name in (*BALL_STATE, *LATERAL_STATE)},
                       **zero)
        return stamp
