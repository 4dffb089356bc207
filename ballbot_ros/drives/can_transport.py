# SPDX-License-Identifier: Apache-2.0
"""
CAN bus through python-can; the only module that opens a bus.

A port is one of

``can0``
    an interface of the Linux kernel (SocketCAN), with the bit rate of ``ip link``,
``/dev/ttyACM0``
    a serial adapter that speaks slcan, such as CANable and Lawicel's CANUSB,
``INTERFACE:CHANNEL``
    any other interface of python-can, such as ``virtual:name`` within a process.

All exceptions of python-can, the kernel and pyserial become `LinkError`, with a reason and a
remedy.  Frames are passed on as records, see can_frames.py; error frames are not.
"""
from contextlib import suppress
import errno
import select
import termios
from typing import Any

from ballbot_ros.drives.can_frames import CanFrame, MOST_DATA, record, RecordParser
from ballbot_ros.drives.transport import (
    errno_of, Link, opening_failure, SEND_TIMEOUT, WRITE_TIMEOUT)
from ballbot_ros.errors import LinkError

# Largest number of messages per read; an acknowledgement of a serial adapter counts, too.
MOST_FRAMES = 256
# CAN_ERR_BUSOFF of linux/can/error.h: the controller has left the bus.
BUS_OFF = 0x40


class CanBus:
    """
    Reads and writes records of frames on a bus of python-can; see `transport.Transfer`.

    The module docstring has the forms of a port; `baud` is the bit rate [bit/s].  Methods raise
    the exceptions of python-can and the layers below it.
    """

    def __init__(self, port: str, baud: int):
        import can
        self._can, self._port, self._baud = can, port, baud
        self._parser = RecordParser()
        self._waiting: Any = None  # a message received by `wait`
        interface, channel, more = _address(port)
        self._bus: Any = can.Bus(channel=channel, interface=interface, bitrate=baud,
                                 ignore_config=True, **more)
        try:
            self._descriptor: Any = self._bus.fileno()
        except (NotImplementedError, OSError):  # virtual: and others have no descriptor
            self._descriptor = None

    def write(self, data: bytes) -> bool:
        if self._descriptor is not None \
                and not select.select([], [self._descriptor], [], SEND_TIMEOUT)[1]:
            raise OSError(errno.ENOBUFS, 'no buffer space')
        for frame in self._parser.feed(data):
            self._bus.send(self._can.Message(
                arbitration_id=frame.identifier, data=frame.data or None,
                is_extended_id=frame.extended, is_remote_frame=frame.remote), WRITE_TIMEOUT)
        return True

    def read(self) -> bytes:
        """Return the records of the frames that have arrived; `LinkError` after a bus off."""
        records = []
        for _ in range(MOST_FRAMES):
            message, self._waiting = self._waiting, None
            try:
                message = message or self._bus.recv(0.0)
            except Exception as error:
                if not isinstance(error, (ValueError, IndexError)) \
                        and not isinstance(error.__cause__, ValueError):
                    raise  # else a serial adapter sent an invalid frame
                self._bus.flush()
                continue
            if message is None:
                # An acknowledgement of an adapter gives None, and messages may follow it.
                if self._descriptor is None or not self._readable(0.0):
                    break
            elif message.is_error_frame:
                if message.arbitration_id & BUS_OFF:
                    raise LinkError(
                        f'{self._port}: the controller has left the bus (bus off): check '
                        'CAN_H and CAN_L, 120 ohm at both ends, and the bit rate; then: '
                        + _up(self._port, self._baud), 'gone', 'port')
            elif not message.is_fd and len(message.data) <= MOST_DATA:
                with suppress(ValueError):
                    records.append(record(CanFrame(
                        message.arbitration_id,
                        b'' if message.is_remote_frame else bytes(message.data),
                        message.is_extended_id, message.is_remote_frame)))
        return b''.join(records)

    def wait(self, seconds: float, least: int = 1) -> bool:
        if self._waiting is not None:
            return True
        if self._descriptor is not None:
            return self._readable(max(0.0, seconds))
        self._waiting = self._bus.recv(max(0.0, seconds))
        return self._waiting is not None

    def close(self) -> None:
        """Close the bus; commands to an adapter that was unplugged are lost."""
        self._bus.shutdown()

    def _readable(self, seconds: float) -> bool:
        return bool(select.select([self._descriptor], [], [], seconds)[0])


class CanLink(Link):
    """See `Link`; the bit rate of a kernel interface is set by ``ip link``, not checked here."""

    def _connect(self) -> CanBus:
        return CanBus(self.port, self.baud)

    def _emptied(self) -> CanBus:
        bus: CanBus = self._opened
        bus.read()
        return bus

    def _failure(self, error: Exception, opening: bool) -> LinkError:
        port = self.port
        if isinstance(error, ModuleNotFoundError):
            return LinkError(
                f'{port}: python-can cannot be imported ({error}): pip install python-can',
                'missing', 'port')
        if isinstance(error, (ValueError, TypeError, NotImplementedError)) \
                and 'bitrate' not in str(error).lower():
            return LinkError(
                f'{port!r} is not a CAN port: use can0 for a kernel interface, /dev/ttyACM0 for '
                f'an slcan adapter, or INTERFACE:CHANNEL of python-can: {error}',
                'bad_address', 'port')
        if opening and isinstance(error, (NameError, AttributeError, ImportError)):
            return LinkError(
                f'{port}: the library of this interface is not installed ({error}); install the '
                "driver of the adapter's maker, or use its kernel interface, such as can0",
                'missing', 'port')
        import can
        if not isinstance(error, (can.CanError, OSError, termios.error, ValueError, TypeError,
                                  NotImplementedError)):
            raise error
        number = errno_of(error)
        if opening and number is None and 'bitrate' in str(error).lower():
            return LinkError(f'{port} cannot use {self.baud} bit/s: {error}', 'bad_baud', 'baud')
        if number == errno.ENETDOWN:
            return LinkError(f'{port} is down: {_up(port, self.baud)}', 'gone', 'port')
        if number == errno.EAFNOSUPPORT:
            return LinkError(
                f'{port} cannot be opened, this kernel has no CAN: sudo modprobe can can_raw',
                'missing', 'port')
        if number == errno.ENODEV and '/' not in port or 'nknown interface' in str(error):
            return LinkError(
                f'there is no CAN interface {port}: {error}; "ip link" lists the existing '
                'interfaces, "ballbot doctor" the serial adapters',
                'missing' if number else 'bad_address', 'port')
        if opening:
            return opening_failure(port, error)
        if number in (errno.ENOBUFS, errno.EAGAIN) or 'imed out' in str(error):
            return LinkError(
                f'{port}: no acknowledgement on the bus; is the drive powered, are both ends '
                f'terminated with 120 ohm, do all nodes use {self.baud} bit/s?',
                'stuck', 'port')
        return LinkError(f'{port} is gone: {error}; is it unplugged?', 'gone', 'port')


def _address(port: str) -> tuple[str, str, dict[str, Any]]:
    """Return interface, channel and options of python-can for a port."""
    interface, colon, channel = port.partition(':')
    if not colon:
        interface, channel = ('slcan' if '/' in port else 'socketcan'), port
    if interface == 'slcan':
        # The driver does not wait for replies of an adapter.
        return interface, channel, {'sleep_after_open': 0.0, 'timeout': 0.0}
    return interface, channel, {}


def _up(port: str, baud: int) -> str:
    """Return the commands that restart a kernel interface."""
    name = port.rpartition(':')[2]
    return f'sudo ip link set {name} down; {up_command(name, baud)}'


def up_command(name: str, baud: int) -> str:
    """Return the command that brings a kernel interface up at a bit rate [bit/s]."""
    return f'sudo ip link set {name} up type can bitrate {baud} restart-ms 100'
