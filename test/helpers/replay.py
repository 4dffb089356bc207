# SPDX-License-Identifier: Apache-2.0
"""Read a capture (ballbot_ros/drives/capture.py), and play it back in place of a line."""
from collections import deque

from ballbot_ros.drives.capture import HEADER, part_before, Record
from ballbot_ros.errors import ConfigurationError, LinkError


def read_capture(path):
    """
    Read a capture, preceded by the earlier part if there is one.

    An incomplete last line, left by a process that ended, is ignored.

    Raises
    ------
    ConfigurationError
        If traffic is invalid; the message names file and line.

    """
    before = part_before(path)
    return [*(_read(before) if before.exists() else ()), *_read(path)]


def _read(path):
    """Return the records of one file."""
    try:
        lines = path.read_text(encoding='ascii').splitlines(keepends=True)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f'{path}: cannot be read: {error}',
                                 'unreadable', str(path)) from error
    if not lines or lines[0].rstrip('\n') != HEADER:
        raise ConfigurationError(f'{path}: is not a capture, the first line must be {HEADER!r}',
                                 'wrong_kind', str(path))
    records = []
    for number, line in enumerate(lines[1:], start=2):
        if not line.endswith('\n'):
            break
        try:
            stamp, direction, *data = line.split()
            if direction not in ('>', '<'):
                raise ValueError(f'direction {direction!r}')
            records.append(Record(float(stamp), direction, bytes.fromhex(''.join(data))))
        except ValueError as error:
            raise ConfigurationError(
                f'{path}:{number}: is not "time > hex" or "time < hex": {error}',
                'unreadable', str(path)) from error
    return records


class Replay:
    """
    A capture in place of a `Link`; each read returns the next data from the drive.

    Attributes
    ----------
    written : list of bytes
        The written data.

    """

    def __init__(self, records):
        self.written = []
        self.port, self.baud = 'replay', 0
        self._pieces = deque(
            record.data for record in records if record.direction == '<')

    @property
    def finished(self):
        """Return whether all records were read."""
        return not self._pieces

    def write(self, data):
        """Keep the data in `written`."""
        self.written.append(data)

    def read(self):
        """
        Return the next data from the drive.

        Raises
        ------
        LinkError
            After the last data, as for an unplugged line.

        """
        if self.finished:
            raise LinkError('the capture ends here', 'gone', 'port')
        return self._pieces.popleft()

    def wait(self, seconds, least=1):
        """Return whether there are more data."""
        return not self.finished

    def close(self):
        """Do nothing."""
