# SPDX-License-Identifier: Apache-2.0
"""VESC on a CAN bus: the driver of its serial protocol, with messages in CAN frames."""
from collections import Counter
from dataclasses import dataclass

from ballbot_ros.config.fields import count
from ballbot_ros.drives.can_frames import judge_others, record
from ballbot_ros.drives.contract import Setting
from ballbot_ros.drives.vesc.can import codec
from ballbot_ros.drives.vesc.settings import VescOptions
from ballbot_ros.drives.vesc.uart import codec as serial
from ballbot_ros.drives.vesc.uart.driver import Vesc
from ballbot_ros.errors import DriveError


@dataclass(frozen=True)
class VescCanOptions(VescOptions):
    """The options of a driver of a VESC on a CAN bus."""

    can_id: int = count('id of the VESC on the bus', default=codec.DRIVE_ID, maximum=253)
    host_id: int = count('id of this computer on the bus; no VESC may have it',
                         default=codec.HOST_ID, maximum=254)


class VescCan(Vesc):
    """See `Vesc`; a motor current has its own frame, all other messages are those of the UART."""

    options: VescCanOptions
    protocol = 'vesc_can'
    shares_line = 'can_id'
    separator = b''
    Options = VescCanOptions
    baud_rates = (500000, 1000000, 250000, 125000, 100000)
    _frame_reply = staticmethod(codec.frame_reply)

    def _begin(self) -> None:
        super()._begin()
        self._parser = codec.PayloadParser(self.options.host_id, self.options.can_id)

    def read_settings(self, timeout: float = 0.5) -> tuple[Setting, ...]:
        settings = super().read_settings(timeout)
        return (*settings, judge_others(self.counts['of_others']))

    def _packet(self, payload: bytes) -> bytes:
        drive, host = self.options.can_id, self.options.host_id
        if payload[0] == serial.SET_CURRENT:
            return record(codec.packet(codec.SET_CURRENT, drive, payload[1:]))
        return codec.records(payload, drive, host, codec.ANSWER_ME)

    def _handshake_error(self, before: Counter[str]) -> DriveError:
        assert isinstance(self._parser, codec.PayloadParser)
        return self._no_node(
            before, self._parser.nodes_seen,
            'is the id that in VESC Tool, App Settings, General: VESC ID, is its CAN Mode VESC')
