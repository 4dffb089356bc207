# SPDX-License-Identifier: Apache-2.0
"""How many control periods per second a serial line carries."""
from typing import NamedTuple

# A byte on the wire: one start bit, eight of data, one stop bit.
BITS_PER_BYTE = 10


class WireBudget(NamedTuple):
    """
    What one control period puts on the line.

    Attributes
    ----------
    bytes_out, bytes_in : int
        To and from the drive, the longest there can be.
    turnaround : float
        Time from the last byte of a request to the first of its reply [s].

    """

    bytes_out: int
    bytes_in: int
    turnaround: float = 0.0

    def duration(self, baud: float) -> float:
        """
        Return how long one exchange takes [s]: out, turnaround and in, one after the other.

        A line is duplex, so the next request could overlap the last reply; a loop that counts
        on this gets its measurements one period late.
        """
        return (self.bytes_out + self.bytes_in) * BITS_PER_BYTE / baud + self.turnaround

    def highest_rate(self, baud: float) -> float:
        """Return the highest rate at which each period sees the reply to its request [Hz]."""
        return 1.0 / self.duration(baud)

    def least_baud(self, rate: float) -> float:
        """Return the lowest baud rate for a loop rate [Hz]; infinite where none is enough."""
        left = 1.0 / rate - self.turnaround
        return (self.bytes_out + self.bytes_in) * BITS_PER_BYTE / left if left > 0.0 \
            else float('inf')
