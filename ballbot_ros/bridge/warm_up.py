# SPDX-License-Identifier: Apache-2.0
"""Everything compiled that the loop calls, before there is a motor that could wait for it."""
import logging
import time

from ballbot_ros.control.checked import warm_up as warm_up_laws
from ballbot_ros.estimation import Fusion, ImuReading
from ballbot_ros.physics.model.robot import Robot

LOG = logging.getLogger(__name__)

# Machine code that is kept from an earlier run is read within less [s].
SHORT = 0.5


def warm_up(robot: Robot) -> float:
    """
    Run filter and laws once on made-up readings, and return how long that took [s].

    The first time after an installation they are compiled meanwhile; within the loop the drive
    would wait for a command longer than its watchdog allows.
    """
    begin = time.monotonic()
    warm_up_laws(robot)
    fusion = Fusion(robot)
    for number in range(1, 5):
        stamp = 0.002 * number
        fusion.imu(ImuReading(stamp, 0.0, 0.0, robot.gravity))
        fusion.encoder(stamp, 0.0, 0.0)
    spent = time.monotonic() - begin
    if spent > SHORT:
        LOG.info('filter and laws were compiled, in %.1f s; the next start has them', spent)
    return spent
