# SPDX-License-Identifier: Apache-2.0
"""Opening, loss and reconnection of a line, and the handshake with the drive."""
from types import SimpleNamespace

import pytest
from refusals import refused
from replay import read_capture

from ballbot_ros.bridge.drive_line import (
    connectors, DriveLine, HANDSHAKE, handshake, LONGEST_HANDSHAKE, RETRY)
from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.drives.contract import Identity, Setting
from ballbot_ros.emulator.emulator import Emulator
from ballbot_ros.errors import ConfigurationError, DriveError, LinkError
from ballbot_ros.physics import load_scene

WATCHDOG = 0.3
GOOD = Setting('watchdog', '0.1 s', 'at most 0.1 s', True)
BAD = Setting('watchdog', 'off', 'at most 0.1 s', False, 'turn it on')


class Drive:
    """A drive that answers with `error` or `settings` and records its requests."""

    def __init__(self, error=None, settings=(GOOD,)):
        self.error, self.settings, self.asked, self.timeout = error, settings, [], []
        self.line = SimpleNamespace(close=lambda: self.asked.append('close'))

    def identify(self, timeout):
        """Answer or raise."""
        self.asked.append('identify')
        self.timeout.append(timeout)
        if self.error is not None:
            raise self.error
        return Identity('test', 'board', '1.0')

    def stop(self, timeout):
        """Stop."""
        self.asked.append('stop')

    def read_settings(self, timeout):
        """Return the settings."""
        return self.settings


class Bench:
    """A line with a simulated clock and the drives that it finds in turn."""

    def __init__(self, *drives):
        self.now, self.drives, self.found = 50.0, list(drives), []
        self.line = DriveLine(self.connect, lambda: self.now, WATCHDOG)

    def connect(self):
        """Return the next drive."""
        drive = self.drives.pop(0) if len(self.drives) > 1 else self.drives[0]
        self.found.append(drive)
        if isinstance(drive, Exception):
            raise drive
        return drive

    def look(self, pause=WATCHDOG + RETRY):
        """Try to reconnect after a pause."""
        self.now += pause
        return self.line.reconnect()


SILENT = DriveError('no answer comes', 'silent', 'drive')


def test_a_drive_is_stopped_before_it_is_taken_over():
    drive = Drive()
    assert handshake(lambda: drive, 0.5)[0] is drive
    assert drive.asked == ['identify', 'stop'] and drive.timeout == [0.5]


def test_all_unsafe_settings_are_named_in_the_refusal_and_the_line_is_closed():
    drive = Drive(settings=(GOOD, BAD, BAD._replace(name='limit', remedy='')))
    with refused('inconsistent', 'watchdog', ConfigurationError) as caught:
        handshake(lambda: drive, 0.5)
    for named in ('watchdog', BAD.remedy, 'limit'):
        assert named in str(caught.value)
    assert drive.asked[-1] == 'close'


def test_an_open_line_has_a_drive_and_a_closed_one_has_none():
    bench = Bench(Drive())
    identity, settings = bench.line.open(0.5)
    assert bench.line.driver and bench.line.identity == identity and settings == (GOOD,)
    assert bench.line.trouble == '' and bench.line.reconnects == 0
    bench.line.close()
    assert bench.line.driver is None and bench.found[0].asked[-1] == 'close'
    bench.line.close()
    assert bench.found[0].asked.count('close') == 1


def test_a_line_that_cannot_be_opened_reports_the_reason_until_it_opens():
    bench = Bench(LinkError('no such port', 'missing', 'port'), Drive())
    with pytest.raises(LinkError):
        bench.line.open(0.5)
    assert bench.line.driver is None and bench.line.trouble == 'no such port'
    bench.line.open(0.5)
    assert bench.line.trouble == ''


def test_opening_closes_the_previous_connection():
    bench = Bench(Drive(), Drive())
    bench.line.open(0.5)
    bench.line.open(0.5)
    assert bench.found[0].asked[-1] == 'close' and bench.line.driver is bench.found[1]


def test_nothing_is_sent_for_longer_than_the_watchdog_after_a_loss_and_each_failed_handshake():
    bench = Bench(Drive(), Drive(SILENT), Drive())
    bench.line.open(0.5)
    bench.line.disconnect(SILENT)
    assert bench.line.driver is None and bench.line.trouble == 'no answer comes'
    assert bench.look(WATCHDOG + 0.01) is False and len(bench.found) == 1
    assert bench.look(RETRY) is False and len(bench.found) == 2
    assert bench.look(WATCHDOG + 0.01) is False and len(bench.found) == 2
    assert bench.look(RETRY) is True and bench.line.driver is bench.found[2]
    assert bench.line.reconnects == 1 and bench.line.trouble == ''


def test_the_handshake_timeout_grows_with_failures_up_to_a_second_and_is_reset_on_success():
    bench = Bench(*[Drive(SILENT)] * 6, Drive(), Drive(SILENT))
    for _ in range(6):
        assert not bench.look()
    assert bench.found[0].timeout == [0.25, 0.5, 0.75, 1.0, 1.0, 1.0]
    assert (HANDSHAKE, LONGEST_HANDSHAKE) == (0.25, 1.0)
    assert bench.look() and bench.found[-1].timeout == [1.0]
    bench.line.disconnect(SILENT)
    bench.look()
    assert bench.found[-1].timeout == [0.25]


def test_the_reason_for_a_missing_drive_is_logged_once_and_again_when_it_changes(caplog):
    caplog.set_level('INFO')
    gone = LinkError('no such port', 'missing', 'port')
    bench = Bench(Drive(), gone, gone, Drive(SILENT), gone, Drive())
    bench.line.open(0.5)
    bench.line.disconnect(SILENT)
    for _ in range(4):
        bench.look()
    assert [text for text in caplog.messages if 'no such port' in text] == [
        text for text in caplog.messages if 'looking' in text][::2]
    assert sum('looking' in text for text in caplog.messages) == 3
    assert not any('reconnected' in text for text in caplog.messages)
    assert bench.look() and 'reconnected' in caplog.messages[-1]
    assert any('lost' in text and 'no answer comes' in text for text in caplog.messages)


def test_the_traffic_of_all_lines_is_kept_in_one_capture(tmp_path):
    path = tmp_path / 'traffic'
    with Emulator('odrive', load_scene('flat'), baud=921600) as emulator:
        connect, = connectors([load_hardware('gimball_odrive').at(emulator.path)], str(path))
        for _ in range(2):
            driver = connect()
            assert driver.identify(20.0).protocol == 'odrive' and driver.line.baud == 921600
            driver.line.close()
        del driver, connect  # completes the file
    asked = [record.data for record in read_capture(path) if record.direction == '>']
    assert asked.count(asked[0]) == 2
    assert any(record.direction == '<' for record in read_capture(path))
