# SPDX-License-Identifier: Apache-2.0
"""A CAN bus as a line: records of frames over python-can, and errors with their remedy."""
import errno
import threading
import time

import can
from drive_bench import Bench
from hypothesis import given, strategies as st
import pytest
from refusals import refused
from replay import read_capture
from waiting import wait_until

from ballbot_ros.drives import open_driver
from ballbot_ros.drives.can_frames import CanFrame, parse_record, record, RECORD_SIZE, RecordParser
from ballbot_ros.drives.can_transport import BUS_OFF, CanLink
from ballbot_ros.drives.capture import Recorder
from ballbot_ros.drives.emulated_device import DriveSettings
from ballbot_ros.drives.vesc.can import codec as vesc_can
from ballbot_ros.drives.vesc.can.emulated import VescCanDevice
from ballbot_ros.emulator.terminal import BIT_RATES, parse_frame, SlcanAdapter, text_of
from ballbot_ros.errors import DriveError, LinkError

RATE = 1000000
IDENTIFIERS = st.one_of(st.tuples(st.integers(0, 0x7FF), st.just(False)),
                        st.tuples(st.integers(0, 0x1FFFFFFF), st.just(True)))
CONTENTS = st.one_of(st.tuples(st.binary(max_size=8), st.just(False)),
                     st.just((b'', True)))
FRAMES = st.tuples(IDENTIFIERS, CONTENTS).map(
    lambda parts: CanFrame(parts[0][0], parts[1][0], parts[0][1], parts[1][1]))


@given(FRAMES)
def test_a_record_is_its_frame_and_begins_as_that_of_socketcan(frame):
    raw = record(frame)
    assert len(raw) == RECORD_SIZE and parse_record(raw) == frame
    flags = (frame.extended << 31) | (frame.remote << 30)
    assert int.from_bytes(raw[:4], 'little') == frame.identifier | flags
    assert raw[4] == len(frame.data) and raw[8:] == frame.data.ljust(8, b'\0')


@given(FRAMES, st.integers(0, RECORD_SIZE - 1), st.integers(1, 255))
def test_a_record_with_a_changed_byte_is_none(frame, place, change):
    raw = bytearray(record(frame))
    raw[place] ^= change
    assert parse_record(bytes(raw)) is None


@given(st.lists(FRAMES, min_size=1, max_size=5), st.binary(max_size=40), st.integers(1, 20))
def test_the_parser_finds_records_after_any_noise_however_they_are_cut(frames, noise, size):
    stream = noise + b''.join(map(record, frames))
    parser, found = RecordParser(), []
    for start in range(0, len(stream), size):
        found += parser.feed(stream[start:start + size])
    assert found[-len(frames):] == frames
    assert parser.counts['skipped'] >= len(noise) - RECORD_SIZE * (len(found) - len(frames))


@pytest.mark.parametrize('frame', [
    CanFrame(0x800), CanFrame(-1), CanFrame(0x20000000, extended=True), CanFrame(1, b'123456789'),
    CanFrame(1, b'1', remote=True)])
def test_a_malformed_frame_has_no_record(frame):
    with pytest.raises(ValueError):
        record(frame)


@given(FRAMES)
def test_the_text_of_slcan_is_that_of_the_frame(frame):
    text = text_of(frame)
    assert text.endswith(b'\r') and parse_frame(text[:-1]) == frame


@given(st.binary(max_size=30))
def test_no_other_text_is_a_frame_of_slcan(text):
    frame = parse_frame(text)
    assert frame is None or text_of(frame)[:-1].upper() == text.upper() or frame.remote


@pytest.fixture
def pair():
    """Yield a link on a virtual bus and a bus of python-can at its other end."""
    with CanLink('virtual:pair', RATE) as link, can.Bus('pair', interface='virtual') as other:
        yield link, other


def test_frames_go_both_ways_as_python_can_has_them(pair):
    link, other = pair
    link.write(record(CanFrame(0x2A, b'ab')) + record(CanFrame(0x1ABCDEF0, b'', True))
               + record(CanFrame(7, remote=True)))
    sent = [other.recv(0.1) for _ in range(3)]
    assert [(each.arbitration_id, bytes(each.data), each.is_extended_id, each.is_remote_frame)
            for each in sent] == [(0x2A, b'ab', False, False), (0x1ABCDEF0, b'', True, False),
                                  (7, b'', False, True)]
    assert not link.wait(0.0) and link.read() == b''
    for message in (can.Message(arbitration_id=9, data=b'12345678', is_extended_id=False),
                    can.Message(arbitration_id=9, is_remote_frame=True, dlc=8)):
        other.send(message)
    assert link.wait(0.1)
    assert RecordParser().feed(link.read()) == [
        CanFrame(9, b'12345678'), CanFrame(9, b'', True, True)]


def test_waiting_ends_when_a_frame_comes_and_not_before(pair):
    link, other = pair
    begin = time.monotonic()
    threading.Timer(0.05, other.send, [can.Message(arbitration_id=1)]).start()
    assert link.wait(5.0) and 0.04 < time.monotonic() - begin < 2.0


def test_frames_from_before_opening_and_of_can_fd_are_not_read(pair):
    link, other = pair
    other.send(can.Message(arbitration_id=1, data=bytes(64), is_fd=True))
    other.send(can.Message(arbitration_id=1, is_error_frame=True))
    assert link.read() == b''


def test_a_controller_that_left_the_bus_is_a_line_that_is_gone(pair):
    link, other = pair
    other.send(can.Message(arbitration_id=BUS_OFF, is_error_frame=True, dlc=8))
    with refused('gone', 'port', LinkError) as caught:
        link.read()
    assert f'ip link set pair up type can bitrate {RATE}' in str(caught.value)


def test_traffic_is_recorded_as_records(pair, tmp_path):
    recorder = Recorder(tmp_path / 'bus.txt')
    with CanLink('virtual:pair', RATE, recorder) as link:
        link.write(record(CanFrame(3, b'x')))
        pair[1].send(can.Message(arbitration_id=4, data=b'y', is_extended_id=False))
        link.read()
    recorder.close()
    assert [(item.direction, RecordParser().feed(item.data)[0].data)
            for item in read_capture(tmp_path / 'bus.txt')] == [('>', b'x'), ('<', b'y')]


@pytest.mark.parametrize('port, reason', [
    ('/dev/ttyNOWHERE', 'missing'), ('/', 'not_a_port'), ('socketcand:', 'bad_address'),
    ('nosuch:1', 'bad_address')])
def test_a_bus_that_does_not_open_has_a_reason_and_names_the_port(port, reason):
    with refused(reason, 'port', LinkError) as caught:
        CanLink(port, RATE)
    assert port in str(caught.value)


@pytest.mark.parametrize('number, reason, command', [
    (errno.ENODEV, 'missing', 'ip link'), (errno.EAFNOSUPPORT, 'missing', 'modprobe can'),
    (errno.ENETDOWN, 'gone', 'ip link set can0 up type can bitrate 1000000')])
def test_the_kernel_s_refusals_come_with_the_command_that_remedies_them(
        monkeypatch, number, reason, command):
    def refuse(**_):
        raise OSError(number, 'planted')
    monkeypatch.setattr(can, 'Bus', refuse)
    with refused(reason, 'port', LinkError) as caught:
        CanLink('can0', RATE)
    assert command in str(caught.value)


@pytest.mark.parametrize('error, reason, named', [
    (can.CanOperationError('no buffer', errno.ENOBUFS), 'stuck', str(RATE)),
    (can.CanOperationError('Transmit timed out'), 'stuck', str(RATE)),
    (OSError(errno.ENETDOWN, 'planted'), 'gone', 'ip link set pair up'),
    (OSError(errno.EIO, 'planted'), 'gone', 'planted')])
def test_a_bus_that_takes_no_frame_says_why(pair, monkeypatch, error, reason, named):
    link, _ = pair

    def refuse(*_):
        raise error
    monkeypatch.setattr(link._opened._bus, 'send', refuse)
    with refused(reason, 'port', LinkError) as caught:
        link.write(record(CanFrame(1)))
    assert named in str(caught.value)


def test_a_closed_bus_is_closed_for_every_use_and_can_be_closed_twice():
    link = CanLink('virtual:closed', RATE)
    link.close()
    link.close()
    for use in (link.read, lambda: link.write(record(CanFrame(1))), lambda: link.wait(0.0)):
        with refused('closed', 'port', LinkError):
            use()


@given(st.binary(min_size=1, max_size=512))
def test_a_message_of_any_length_arrives_in_frames_of_eight_bytes_at_most(payload):
    parser = vesc_can.PayloadParser()
    assert parser.feed(vesc_can.frame_reply(payload)) == [payload]
    assert parser.counts == {'refused': 0, 'skipped': 0, 'of_others': 0}


@given(st.binary(min_size=7, max_size=512), st.data())
def test_a_message_without_one_of_its_frames_is_none(payload, data):
    frames = list(vesc_can.frames(payload, vesc_can.HOST_ID, vesc_can.DRIVE_ID, vesc_can.ANSWER))
    del frames[data.draw(st.integers(0, len(frames) - 1))]
    parser = vesc_can.PayloadParser()
    assert parser.feed(b''.join(map(record, frames))) == []
    whole = vesc_can.frame_reply(payload)
    assert parser.feed(whole) == [payload]  # and the next message is found


def test_messages_of_other_drives_and_to_others_are_not_taken_for_answers():
    parser = vesc_can.PayloadParser(own=254, sender=3)
    for to, sender, found in ((254, 3, 1), (254, 4, 0), (7, 3, 0)):
        raw = vesc_can.records(bytes(20), to, sender, vesc_can.ANSWER)
        assert len(parser.feed(raw)) == found
    parser.feed(record(vesc_can.packet(vesc_can.STATUS[0], 23, bytes(8))))
    assert parser.nodes_seen == {23}


def test_the_frames_of_a_message_are_those_that_the_firmware_makes():
    # comm_can_send_buffer of bldc: sevens with an offset of one byte, sixes with one of two.
    long = list(vesc_can.frames(bytes(range(256)) + bytes(9), 9, 254, 0))
    assert [frame.identifier for frame in long] == [0x509] * 37 + [0x609] + [0x709]
    assert long[36].data[0] == 252 and long[37].data == bytes((1, 3)) + bytes(6)
    assert long[38].data[:4] == bytes((254, 0, 1, 9))
    short, = vesc_can.frames(b'\x00', 9, 254, 0)
    assert short == CanFrame(0x809, bytes((254, 0, 0)), extended=True)


def test_a_torque_has_the_frame_that_the_maker_has_for_a_current():
    bench = Bench('vesc_can', can_id=0)
    bench.driver.arm()
    sent = bench.sent()
    bench.driver.send_torque(-0.025, ask=False)
    assert RecordParser().feed(sent[0]) == [
        CanFrame(0x100, (-1000).to_bytes(4, 'big', signed=True), extended=True)]


def test_a_vesc_of_another_id_is_not_taken_for_ours_and_is_named():
    bench = Bench('vesc_can', can_id=7)
    status = record(vesc_can.packet(vesc_can.STATUS[0], 0, bytes(8)))
    bench.waiting.append((0.01, status))
    with refused('silent', 'can_id', DriveError):
        bench.driver.identify(0.2)


def test_a_vesc_answers_a_ping_with_its_name():
    device = VescCanDevice(DriveSettings())
    ping = record(vesc_can.packet(vesc_can.PING, 0, bytes((254,))))
    assert RecordParser().feed(device.receive(ping, 0.0)) == [
        CanFrame(0x12FE, b'\0\0', extended=True)]


def test_malformed_frames_of_a_serial_adapter_are_skipped():
    adapter = SlcanAdapter()
    with CanLink(adapter.path, RATE) as link:
        wait_until(lambda: adapter.read() == b'' and adapter.baud == RATE and adapter._open)
        for text in (b't12\r', b'tXYZ1\r', b'\xff\xfe\r', b'T0000000\r', b'\a'):
            adapter._answer(text)
            assert link.wait(5.0) and link.read() == b''  # and the bytes received with it are lost
        adapter.write(record(CanFrame(0x123, b'ab')))
        assert wait_until(lambda: RecordParser().feed(link.read())) == [CanFrame(0x123, b'ab')]
        link.write(record(CanFrame(0x77, b'x')) + record(CanFrame(5, b'', True, True)))
        data = b''
        while len(data) < 32:
            data += wait_until(adapter.read)
        assert RecordParser().feed(data) == [CanFrame(0x77, b'x'), CanFrame(5, b'', True, True)]
        adapter.unplug()
        with refused('gone', 'port', LinkError):
            for _ in range(3):
                link.write(record(CanFrame(1)))
                link.read()
    with refused('missing', 'port', LinkError):
        CanLink(adapter.path, RATE)


def test_a_serial_adapter_goes_on_after_a_bit_rate_of_thousands_of_digits():
    adapter = SlcanAdapter()
    with open(adapter.path, 'r+b', buffering=0) as host:
        for text in (b'S' + 3000 * b'1', 3000 * b'1' + b'\r', b'S5\r'):
            host.write(text)
            assert adapter.read() == b''
    assert adapter.baud == BIT_RATES[5]


def test_an_adapter_without_that_bit_rate_says_so():
    with refused('bad_baud', 'baud', LinkError) as caught:
        CanLink(SlcanAdapter().path, 1234)
    assert '1234' in str(caught.value)


@pytest.mark.parametrize('kind, frame', [
    ('odrive_can 0.5', CanFrame(0x0E, bytes(4))), ('odrive_can 0.6', CanFrame(0x07, bytes(4))),
    ('odrive_can 0.6', CanFrame(0x09, remote=True)), ('vesc_can', CanFrame(0x100, bytes(4), True)),
    ('vesc_can', CanFrame(0x800, b'\1\0\4', True))])
def test_a_drive_that_another_node_commands_is_refused(kind, frame):
    bench = Bench(kind)
    bench.driver.identify()
    assert bench.settings()['only sender'].acceptable
    bench.waiting.append((bench.now, record(frame)))
    assert bench.refused()['only sender'].remedy


@pytest.mark.parametrize('kind', ['odrive_can 0.5', 'odrive_can 0.6'])
@pytest.mark.parametrize('call', ['identify', 'read_settings', 'ask', 'clear_faults'])
def test_no_question_keeps_a_torque_alive_that_a_predecessor_left(kind, call):
    bench = Bench(kind)
    other = open_driver('odrive_can', bench, bench.driver.options, bench.clock)
    other.arm()
    other.send_torque(0.05)
    assert bench.device.torque() == pytest.approx(0.05)
    try:
        getattr(bench.driver, call)()
    except DriveError:
        assert call == 'clear_faults'  # not under power
    assert bench.device.torque() == 0.0


def test_an_interface_whose_library_is_missing_is_refused(monkeypatch):
    def fails(**_):
        raise NameError("name 'canGetNumberOfChannels' is not defined")
    monkeypatch.setattr(can, 'Bus', fails)
    with refused('missing', 'port', LinkError):
        CanLink('kvaser:0', RATE)


def test_an_interface_of_python_can_without_its_library_is_refused_on_this_machine():
    with refused('missing', error=LinkError):
        CanLink('kvaser:0', RATE)
