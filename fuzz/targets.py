# SPDX-License-Identifier: Apache-2.0
"""
What is fuzzed: each parser with its driver, and each drive in software.

The first byte of an input cuts it up.  Most of an input is fed as it is; a quarter of the pieces,
chosen by their first byte, are given a valid checksum first, so that what lies behind the checksum
is reached, too.  A message that a parser gives must stand in the stream exactly as the other side
would have sent it: everything else is invented.
"""
import math

from ballbot_ros.drives import driver_class
from ballbot_ros.drives.emulated_device import DriveSettings
from ballbot_ros.drives.odrive import codec as odrive
from ballbot_ros.drives.odrive.firmware import GENERATIONS
from ballbot_ros.drives.roboclaw import codec as roboclaw
from ballbot_ros.drives.vesc import codec as vesc
from ballbot_ros.emulator.emulator import DEVICES


class Memory:
    """A line that gives what it was given."""

    port = 'fuzz'

    def __init__(self):
        self.data = b''

    def write(self, data):
        """Forget."""

    def read(self):
        """Return what there is."""
        data, self.data = self.data, b''
        return data

    def wait(self, seconds):
        """Do not."""
        return False


def sign_odrive(piece):
    """Return a line with its checksum."""
    body = bytes(byte & 0x7F for byte in piece if byte & 0x7F not in b'*\r\n')
    return b'%s*%d\r\n' % (body, odrive.checksum(body))


def sign_vesc(piece):
    """Return a packet."""
    return vesc.frame(piece[:vesc.LONGEST_PAYLOAD]) if piece else b''


def sign_roboclaw(piece):
    """Return the answers to a status, encoder and speed, with the values of a piece."""
    data = piece[:14].ljust(14, b'\0')
    groups = ((roboclaw.GET_STATUS, data[:4]), (16, data[4:9]), (30, data[9:14]))
    return b''.join(roboclaw.answer(0x80, number, *roboclaw.ANSWERS[number].unpack(part))
                    for number, part in groups)


def sent_odrive(text):
    """Return the line that a text came in."""
    return b'%s*%d\r\n' % (text.encode(), odrive.checksum(text.encode()))


def sent_roboclaw(group):
    """Return the bytes that a group of answers came in; text comes with what strip took off."""
    return b''.join(roboclaw.answer(0x80, reply.command, *reply.values) for reply in group)


SIGN = {'odrive': sign_odrive, 'vesc': sign_vesc, 'roboclaw': sign_roboclaw}
SENT = {'odrive': sent_odrive, 'vesc': vesc.frame, 'roboclaw': sent_roboclaw}
PARSERS = {'odrive': odrive.LineParser, 'vesc': vesc.FrameParser,
           'roboclaw': lambda: roboclaw.ReplyParser(0x80)}


def pieces(protocol, data):
    """Cut an input up, and sign some of the pieces."""
    size = 1 + (data[0] if data else 0) % 64
    for start in range(1, len(data), size):
        piece = data[start:start + size]
        yield SIGN[protocol](piece[1:]) if piece[0] % 4 == 3 else piece


def fuzz_host(protocol, data):
    """Feed parser and driver; return the bytes fed and the messages found."""
    parser, memory = PARSERS[protocol](), Memory()
    clock = iter(range(10**9))
    found = driver_class(protocol)
    driver = found(memory, found.Options(torque_limit=0.1), lambda: 1e-3 * next(clock))
    if protocol == 'odrive':  # as after a handshake
        driver._generation = GENERATIONS[len(data) % len(GENERATIONS)]
    if protocol == 'roboclaw':
        parser.groups = ((roboclaw.GET_STATUS, 16, 30), (16, 30), (roboclaw.GET_VERSION, 16, 30))
    stream, messages = b'', []
    for piece in pieces(protocol, data):
        stream += piece
        messages += parser.feed(piece)
        driver.ask()
        memory.data = piece
        telemetry = driver.poll()
        for value in telemetry:
            assert not isinstance(value, float) or math.isfinite(value), telemetry
    for message in messages:
        if protocol != 'roboclaw' or all(reply.values for reply in message):
            assert SENT[protocol](message) in stream, f'invented: {message!r}'
    return len(stream), len(messages)


# A line without checksum may set an ODrive's own limits, if it says so in full.
LIMITS = {'odrive': math.inf, 'vesc': 0.1 + 1e-9, 'roboclaw': 0.1 + 1e-9}


def fuzz_drive(protocol, data):
    """Feed a drive in software; its torque stays a number and within its limits."""
    firmwares = DEVICES[protocol].firmwares or ('',)
    settings = DriveSettings(firmware=firmwares[len(data) % len(firmwares)])
    drive = DEVICES[protocol](settings)
    size, now = 0, 0.0
    for piece in pieces(protocol, data):
        drive.receive(piece, now)
        drive.tick(now)
        assert abs(drive.torque()) <= LIMITS[protocol], drive.torque()
        now += 1e-3
        size += len(piece)
    return size, 0


TARGETS = {f'{protocol} {side}': (fuzz, protocol) for side, fuzz in (
    ('host', fuzz_host), ('drive', fuzz_drive)) for protocol in sorted(SIGN)}
