# SPDX-License-Identifier: Apache-2.0
"""Compile all kernels of the loop before the motor is armed."""
from ballbot_ros.control.checked import warm_up as warm_up_laws
from ballbot_ros.estimation import EncoderReading, Fusion, ImuReading
from ballbot_ros.physics.model.robot import Robot


def warm_up(robot: Robot) -> None:
    """
    Run filter and controllers once on synthetic readings.

    The first run after an installation compiles them; within the loop that would exceed the
    watchdog timeout of the drive.
    """
    warm_up_laws(robot)
    fusion = Fusion(robot)
    for number in range(1, 5):
        stamp = 0.002 * number
        fusion.imu(ImuReading(stamp, 0.0, 0.0, robot.gravity))
        fusion.encoder(EncoderReading(stamp, 0.0))
