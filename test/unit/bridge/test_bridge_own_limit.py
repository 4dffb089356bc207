# SPDX-License-Identifier: Apache-2.0
"""A drive may keep its own limit if the file or a calibration requires less."""
from dataclasses import replace

import pytest
from refusals import refused
from virtual_robot import SERIAL, VirtualRobot

from ballbot_ros.drives.emulated_device import DriveSettings
from ballbot_ros.errors import ConfigurationError

TORQUE = 4.0 / 45.0  # of the drive, at the motor shaft [N m]


def with_drive_as_shipped(protocol, torque=TORQUE, **limits):
    """Return a robot whose drive is set for the shipped file."""
    return VirtualRobot(protocol, settings=DriveSettings(
        torque_limit=torque, current_limit=torque / DriveSettings.torque_constant), **limits)


@pytest.mark.parametrize('protocol', SERIAL)
def test_a_drive_is_still_accepted_after_its_calibration(protocol):
    robot = with_drive_as_shipped(protocol)
    robot.change(joint=replace(robot.hardware.joint, torque_factor=1.2)).ready()


@pytest.mark.parametrize('protocol', SERIAL)
def test_a_small_torque_limit_needs_no_change_of_the_drive_and_is_never_exceeded(protocol):
    robot = with_drive_as_shipped(protocol, torque_limit=0.3).ready()
    robot.torques.clear()
    robot.run(0.3, torque=2.0)
    assert max(robot.torques) == pytest.approx(
        0.3 / 45.0, rel=0.1 if protocol == 'roboclaw' else 0.02)


def test_a_drive_with_a_higher_limit_than_the_file_is_refused():
    with refused('inconsistent', 'torque limit', ConfigurationError):
        with_drive_as_shipped('odrive 0.5', 1.05 * TORQUE).session.configure()
    with refused('inconsistent', 'torque limit', ConfigurationError):
        with_drive_as_shipped('odrive 0.5', torque_limit=0.3,
                              drive_torque_limit=0.0).session.configure()
