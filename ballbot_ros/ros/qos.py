# SPDX-License-Identifier: Apache-2.0
"""Quality of service by meaning; every publisher and subscriber picks one of these."""
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy


def _profile(depth: int, durability: DurabilityPolicy = DurabilityPolicy.VOLATILE
             ) -> QoSProfile:
    return QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=depth, durability=durability,
                      reliability=ReliabilityPolicy.RELIABLE)


# Measurements: reliable, so that every subscriber matches, and deep enough for a recorder that
# is held up for a moment.
STATE = _profile(5000)

# For a recorder, which must miss nothing while it is held up: some seconds of everything.
RECORD = _profile(20000)

# Only the newest reading, set-point or command matters: a queue of old ones would be followed
# one by one after a hiccup.
NEWEST = _profile(1)

# The same for those who send them: a recorder that is held up asks for what it has missed, and
# subscribers keep only the newest all the same.  What comes late is refused by its stamp.
COMMAND = _profile(2000)

# Readings of a sensor, taken from whoever offers them: drivers publish best effort, too.
SENSOR = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=5,
                    reliability=ReliabilityPolicy.BEST_EFFORT)

# Observations and odometry as an input: a few, because two topics are matched by stamp.
SHORT = _profile(20)

# For those who come late: the last one.
LATCHED = _profile(1, DurabilityPolicy.TRANSIENT_LOCAL)

# The same for who sends decisions: a recorder wants all, others keep the last one.
DECISION = _profile(1000, DurabilityPolicy.TRANSIENT_LOCAL)

# The same for a recorder, which wants all decisions.
RECORD_LATCHED = _profile(20000, DurabilityPolicy.TRANSIENT_LOCAL)

# /clock: rclpy subscribes best effort and keeps one; a recorder asks for all.
CLOCK = _profile(5000)
