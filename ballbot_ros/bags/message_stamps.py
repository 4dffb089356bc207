# SPDX-License-Identifier: Apache-2.0
"""When a serialized message is of, without decoding it."""
import struct
from typing import Any, Callable

# CDR: four bytes of encapsulation, then the first field.
OFFSET, LENGTH = 4, 4
_STAMP, _COUNT = struct.Struct('<iI'), struct.Struct('<I')
STAMPED = ('std_msgs/Header', 'builtin_interfaces/Time')
SEQUENCES = ('sequence<geometry_msgs/TransformStamped>', 'sequence<visualization_msgs/Marker>')
# These topics carry wall time, even where the robot uses another clock.
OF_THE_WALL = ('DiagnosticArray', 'Log')

StampOf = Callable[[bytes], int]


def stamp_of(data: bytes, offset: int = OFFSET) -> int:
    """Return the stamp that a serialized message begins with [ns]."""
    seconds, nanoseconds = _STAMP.unpack_from(data, offset)
    return int(seconds) * 10**9 + int(nanoseconds)


def stamp_of_first(data: bytes) -> int:
    """Return the stamp of the first of the messages that a serialized one consists of [ns]."""
    count, = _COUNT.unpack_from(data, OFFSET)
    return stamp_of(data, OFFSET + LENGTH) if count else 0


def no_stamp(data: bytes) -> int:
    """Return 0: it is of when it comes."""
    return 0


def stamp_reader(kind: Any) -> StampOf:
    """
    Return what reads the stamp of messages of a class [ns]; 0 where they have none.

    A stamp is looked for at the beginning: a time or a header there, or a sequence of messages
    that begin with a header, as those of /tf.
    """
    first = next(iter(kind.get_fields_and_field_types().values()), '')
    if kind.__name__ in OF_THE_WALL:
        return no_stamp
    if first in STAMPED:
        return stamp_of
    if first in SEQUENCES:
        return stamp_of_first
    return no_stamp
