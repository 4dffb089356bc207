# SPDX-License-Identifier: Apache-2.0
"""
What is fuzzed: each parser with its driver, each drive in software, and an inertial sensor.

The first byte of an input cuts it up.  Most of an input is fed as it is; a quarter of the pieces,
chosen by their first byte, are given a valid checksum first, so that what lies behind the checksum
is reached, too.  A message that a parser gives must stand in the stream exactly as the other side
would have sent it: everything else is invented.
"""
import math

from ballbot_ros.drives import codec_of, device_class, driver_class, DRIVES
from ballbot_ros.drives.emulated_device import DriveSettings
from ballbot_ros.drives.memory_line import MemoryLine
from ballbot_ros.imus.witmotion import protocol as witmotion
from ballbot_ros.imus.witmotion.emulated import EmulatedWitMotion

# All are imported here, where run.py has them instrumented, and not with the first input.
CODECS = {protocol: codec_of(protocol) for protocol in sorted(DRIVES)}
DRIVERS = {protocol: driver_class(protocol) for protocol in CODECS}
DEVICES = {protocol: device_class(protocol) for protocol in CODECS}
# A line without checksum may set an ODrive's own limits, if it says so in full.
LIMITS = {'odrive': math.inf}


def pieces(protocol, data):
    """Cut an input up, and make some of the pieces valid."""
    size = 1 + (data[0] if data else 0) % 64
    for start in range(1, len(data), size):
        piece = data[start:start + size]
        yield CODECS[protocol].reply_of(piece[1:]) if piece[0] % 4 == 3 else piece


def device_for(protocol, data):
    """Return a device, whose firmware is chosen by the length of an input."""
    found = DEVICES[protocol]
    firmwares = found.firmwares or ('',)
    return found(DriveSettings(firmware=firmwares[len(data) % len(firmwares)]))


def fuzz_host(protocol, data):
    """Feed parser and driver; return the bytes fed and the messages found."""
    codec, found = CODECS[protocol], DRIVERS[protocol]
    line = MemoryLine(device_for(protocol, data), delay=0.001)
    driver = found(line, found.Options(torque_limit=0.1), line.clock)
    driver.identify()
    line.from_drive = lambda _: b''
    parser, stream, messages = codec.parser(), b'', []
    for piece in pieces(protocol, data):
        stream += piece
        messages += parser.feed(piece)
        line.pass_time(0.003)
        driver.ask()
        line.waiting.append((line.now, piece))
        telemetry = driver.poll()
        for value in telemetry:
            assert not isinstance(value, float) or math.isfinite(value), telemetry
    for message in messages:
        assert codec.frame_reply(message) in stream, f'invented: {message!r}'
    return len(stream), len(messages)


def fuzz_drive(protocol, data):
    """Feed a drive in software; its torque stays a number and within its limits."""
    drive = device_for(protocol, data)
    limit = LIMITS.get(protocol, drive.settings.torque_limit + 1e-9)
    size, now = 0, 0.0
    for piece in pieces(protocol, data):
        drive.receive(piece, now)
        drive.tick(now)
        assert abs(drive.torque()) <= limit, drive.torque()
        now += 1e-3
        size += len(piece)
    return size, 0


def fuzz_imu_host(_, data):
    """Feed the parser of an inertial sensor; what it reads stands in the stream."""
    parser, stream, found = witmotion.PacketParser(), b'', []
    size = 1 + (data[0] if data else 0) % 64
    for start in range(1, len(data), size):
        piece = data[start:start + size]
        if piece[0] % 4 == 3:  # a valid packet, to get behind the sum
            body = bytes((witmotion.HEADER, 0x50 + piece[-1] % 4)) + piece[1:].ljust(9, b'\0')[:8]
            piece = body + bytes((sum(body) % 256,))
        stream += piece
        found += parser.feed(piece)
    for reading in found:
        for kind, values, count in (
                (witmotion.FORCE, reading.force, witmotion.FORCE_COUNT),
                (witmotion.TURN_RATE, reading.turn_rate, witmotion.RATE_COUNT)):
            body = witmotion.packet(kind, tuple(round(value / count) for value in values))[:8]
            assert body in stream, f'invented: {reading!r}'
    return len(stream), len(found)


def fuzz_imu_sensor(_, data):
    """Feed an inertial sensor in software; it goes on talking in whole packets."""
    sensor, now, packets = EmulatedWitMotion(), 0.0, 0
    for start in range(0, len(data), 5):
        command = bytes((0xFF, 0xAA)) + data[start:start + 3]
        sensor.receive(command if data[start] % 2 else data[start:start + 5])
        now += 0.1
        sent = sensor.tick(now)
        packets += len(sent) // witmotion.SIZE
        assert len(sent) % witmotion.SIZE == 0 and sensor.baud > 0
    return len(data), packets


TARGETS = {f'{protocol} {side}': (fuzz, protocol) for side, fuzz in (
    ('host', fuzz_host), ('drive', fuzz_drive)) for protocol in CODECS}
TARGETS.update({'witmotion host': (fuzz_imu_host, ''), 'witmotion sensor': (fuzz_imu_sensor, '')})
