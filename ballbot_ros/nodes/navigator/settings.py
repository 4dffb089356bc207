# SPDX-License-Identifier: Apache-2.0
"""The parameters of the node: name, unit, range, default and meaning."""
from dataclasses import dataclass

from ballbot_ros.config.fields import fixed, flag, text
from ballbot_ros.ros.frames import FRAMES
from ballbot_ros.ros.settings import file_in, Settings

WHY = 'routes and crossings depend on it'


@dataclass(frozen=True)
class NavigatorSettings(Settings):
    """Parameters of the node ``navigator``."""

    floor: str = fixed('the service ~/reload reads it again', text(
        'name or file of the floor', default='apartment'))
    robot: str = fixed(WHY, file_in('robots', 'gimball'))
    curve: str = fixed(WHY, file_in('curves', 'gimball_down', 'height curve'))
    tuning: str = fixed(WHY, file_in('decision_tunings', 'decision_default', 'decision tuning'))
    control_tuning: str = fixed(WHY, file_in(
        'tunings', 'published', doc=': gains of the control laws'))
    learned: str = fixed('it is read at the start', text(
        'file for learned data of the floor, read at the start; empty for none',
        default=''))
    map_frame: str = fixed('poses are expressed in it', text(
        'frame of the floor', default=FRAMES.map))
    odom_frame: str = fixed('poses are expressed in it', text(
        'frame of odom; /tf contains its transform from map_frame', default=FRAMES.odom))
    localized: bool = fixed('it selects the source of the pose', flag(
        'wait for the transform from map_frame to odom_frame; false: the frames coincide',
        default=True))
    autostart: bool = fixed('it applies at the start', flag(
        'configure and activate at the start, without a lifecycle manager', default=True))
