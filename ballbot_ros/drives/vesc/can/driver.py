# SPDX-License-Identifier: Apache-2.0
"""VESC on a CAN bus: the driver of its serial protocol, whose messages go in CAN frames."""
from collections import Counter
from dataclasses import dataclass

from ballbot_ros.config.fields import count
from ballbot_ros.drives.can_frames import judge_others, record
from ballbot_ros.drives.contract import Setting, WireBudget
from ballbot_ros.drives.vesc.can import codec
from ballbot_ros.drives.vesc.settings import VescOptions
from ballbot_ros.drives.vesc.uart import codec as serial
from ballbot_ros.drives.vesc.uart.driver import Vesc
from ballbot_ros.errors import DriveError


@dataclass(frozen=True)
class VescCanOptions(VescOptions):
    """The options of a driver of a VESC on a CAN bus."""

    can_id: int = count('id of the VESC on the bus', default=codec.DRIVE_ID, maximum=253)
    host_id: int = count('id of this computer on the bus, which no VESC has',
                         default=codec.HOST_ID, maximum=254)


class VescCan(Vesc):
    """See `Vesc`; a motor current has its own frame, all other messages are those of the UART."""

    options: VescCanOptions
    protocol = 'vesc_can'
    shares_line = 'can_id'
    Options = VescCanOptions
    baud_rates = (500000, 1000000, 250000, 125000, 100000)

    def _begin(self) -> None:
        super()._begin()
        self._messages = serial.FrameParser()
        self._parser = codec.PayloadParser(self.options.host_id, self.options.can_id)

    def read_settings(self, timeout: float = 0.5) -> tuple[Setting, ...]:
        """Read back and check the settings, and that there is no other sender; see `Driver`."""
        settings = super().read_settings(timeout)
        return (*settings, judge_others(self.counts['of_others']))

    def budget(self) -> WireBudget:
        """Return the records of a command, a request and its reply."""
        reply = serial.pack_values(serial.Values(*(0,) * len(serial.FIELDS)))
        return WireBudget(len(self._on_bus(self._torque_message(0.0) + serial.get_values())),
                          len(codec.frame_reply(reply)))

    def _send(self, data: bytes) -> None:
        super()._send(self._on_bus(data))

    def _on_bus(self, data: bytes) -> bytes:
        """Return the records of messages that are framed for a serial line."""
        drive, host = self.options.can_id, self.options.host_id
        return b''.join(
            record(codec.packet(codec.SET_CURRENT, drive, payload[1:]))
            if payload[0] == serial.SET_CURRENT
            else codec.records(payload, drive, host, codec.ANSWER_ME)
            for payload in self._messages.feed(data))

    def _handshake_error(self, before: Counter[str]) -> DriveError:
        assert isinstance(self._parser, codec.PayloadParser)
        return self._no_node(
            before, self._parser.nodes_seen,
            'is the id that of VESC Tool, App Settings, General: VESC ID, is its CAN Mode VESC')
