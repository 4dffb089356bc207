# SPDX-License-Identifier: Apache-2.0
"""Reference conversion of robot states to joint state messages."""
from sensor_msgs.msg import JointState

from ballbot_ros.ros.conversions import to_time
from ballbot_ros.ros.frames import JOINTS, SHELL


def joint_state_message(state, torque, has_pendulum, frame='base_link'):
    """Return a message with theta1 of the shell and theta2 of the pendulum joint."""
    message = JointState()
    message.header.stamp, message.header.frame_id = to_time(state.time), frame
    if has_pendulum:
        message.name = list(JOINTS)
        message.position = [state.ball_angle, state.joint_angle]
        message.velocity = [state.ball_rate, state.joint_rate]
        message.effort = [0.0, torque]
    else:
        message.name = [SHELL]
        message.position, message.velocity = [state.ball_angle], [state.ball_rate]
        message.effort = [0.0]
    return message
