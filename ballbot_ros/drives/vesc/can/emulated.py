# SPDX-License-Identifier: Apache-2.0
"""Emulated VESC on a CAN bus, after comm/comm_can.c of vedderb/bldc; else as on a serial line."""
from ballbot_ros.drives.can_frames import CanFrame, record, RecordParser
from ballbot_ros.drives.vesc.can import codec
from ballbot_ros.drives.vesc.uart import codec as serial
from ballbot_ros.drives.vesc.uart.emulated import VescDevice

HW_TYPE_VESC = 0


class VescCanDevice(VescDevice):
    """See `Device`; its id is `codec.DRIVE_ID`, that of a second axis the next one."""

    protocol = 'vesc_can'

    def _boot(self) -> None:
        super()._boot()
        self._id = codec.DRIVE_ID + self.settings.axis
        self._records, self._assembly = RecordParser(), codec.Assembly()

    def _receive(self, data: bytes, now: float) -> bytes:
        return b''.join(self._take(frame, now) for frame in self._records.feed(data))

    def _take(self, frame: CanFrame, now: float) -> bytes:
        """Execute a frame and return the records of the answer; see `decode_msg`."""
        kind, to = frame.identifier >> 8, frame.identifier & 0xFF
        if not frame.extended or to not in (self._id, codec.BROADCAST_ID):
            return b''
        data = frame.data
        if kind == codec.SET_CURRENT and len(data) >= 4:
            self._execute(bytes((serial.SET_CURRENT,)) + data[:4], now)
        elif kind == codec.PING and data:
            return record(codec.packet(
                codec.PONG, data[0], bytes((self._id, HW_TYPE_VESC))))
        else:
            payload = self._assembly.take(kind, data)
            if payload is not None and data[1] in (codec.ANSWER_ME, 3):
                purpose = codec.ANSWER if data[1] == codec.ANSWER_ME else codec.ANSWER_ME
                reply = self._execute(payload, now)
                return codec.records(reply, data[0], self._id, purpose) if reply else b''
        return b''
