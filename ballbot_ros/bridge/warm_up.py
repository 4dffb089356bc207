# SPDX-License-Identifier: Apache-2.0
"""Compile all kernels of the loop before the motor is armed."""
import logging
import time

from ballbot_ros.control.checked import warm_up as warm_up_laws
from ballbot_ros.estimation import EncoderReading, Fusion, ImuReading
from ballbot_ros.physics.model.robot import Robot

LOG = logging.getLogger(__name__)

# Loading cached machine code takes less than this [s].
CACHED_LOAD_TIME = 0.5


def warm_up(robot: Robot) -> float:
    """
    Run filter and controllers once on synthetic readings, and return the duration [s].

    The first run after an installation compiles them; within the loop that would exceed the
    watchdog timeout of the drive.
    """
    begin = time.monotonic()
    warm_up_laws(robot)
    fusion = Fusion(robot)
    for number in range(1, 5):
        stamp = 0.002 * number
        fusion.imu(ImuReading(stamp, 0.0, 0.0, robot.gravity))
        fusion.encoder(EncoderReading(stamp, 0.0))
    spent = time.monotonic() - begin
    if spent > CACHED_LOAD_TIME:
        LOG.info('filter and laws were compiled in %.1f s, cached for the next start', spent)
    return spent
