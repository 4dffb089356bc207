# SPDX-License-Identifier: Apache-2.0
"""Start the bridge to a real motor, with the control laws on board, and an IMU."""
from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.ros.launching import describe, HARDWARE, ROBOT, TUNING

ARGUMENTS = (
    ROBOT, *HARDWARE, TUNING,
    ('control', 'onboard',
     'Where the laws run: onboard in the bridge, direct in a separate node controller'),
)


def start(given):
    """Return the nodes, without use_sim_time: real motors run in real time."""
    nodes, hardware = given.motor(given['control']), load_hardware(given['hardware'])
    if given['control'] == 'direct':
        nodes.append(given.node('controller', {
            'robot': given.robot(real=True), 'tuning': given['tuning'],
            'rate': hardware.connection.loop_rate, 'delay': 1}))
    return [*nodes, *given.viewers(hardware.robot, simulated=False)]


def generate_launch_description():
    """Declare the arguments and start the nodes."""
    return describe(ARGUMENTS, start)
