# SPDX-License-Identifier: Apache-2.0
"""Profiles of rclpy for the quality of service in the table `topics.TOPICS`."""
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from ballbot_ros.ros import topics
from ballbot_ros.ros.topics import Qos, TOPICS


def profile(wanted: Qos) -> QoSProfile:
    """Return a profile that keeps the last messages."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST, depth=wanted.depth,
        reliability=ReliabilityPolicy.RELIABLE if wanted.reliable
        else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if wanted.latched
        else DurabilityPolicy.VOLATILE)


def of(profile: QoSProfile, depth: int) -> Qos:
    """Return the quality of service of a profile from discovery, which transmits no depth."""
    return Qos(depth, profile.reliability == ReliabilityPolicy.RELIABLE,
               profile.durability == DurabilityPolicy.TRANSIENT_LOCAL)


SENSOR, STATE, LATEST, LATCHED = map(
    profile, (topics.SENSOR, topics.STATE, topics.LATEST, topics.LATCHED))
# Subscriptions of a recorder, deep enough for its delays.
RECORDING_DEPTH = 20000


def recording(topic: str) -> QoSProfile:
    """Return the profile with which all messages of a topic of the table are recorded."""
    return profile(TOPICS[topic].offered._replace(depth=RECORDING_DEPTH))


def watching(topic: str) -> QoSProfile:
    """Return a profile for a viewer, for which no publisher waits: it may miss messages."""
    return LATCHED if TOPICS[topic].requested.latched else SENSOR
