# SPDX-License-Identifier: Apache-2.0
"""Each failure of a port becomes one kind of error, with a remedy."""
import errno
import os
import pty
import socket
import termios
import threading
import time

import pytest
from refusals import refused
from replay import read_capture, Replay
import serial

from ballbot_ros.drives import capture, transport
from ballbot_ros.drives.capture import Record, Recorder
from ballbot_ros.drives.transport import Descriptor, Link
from ballbot_ros.errors import BallbotError, ConfigurationError, LinkError


@pytest.fixture
def terminal():
    """Return the file descriptor of a pseudo-terminal and the path of its other end."""
    master, slave = pty.openpty()
    path = os.ttyname(slave)
    os.close(slave)
    yield master, path
    try:
        os.close(master)
    except OSError:
        pass  # unplugged by the test


def reason(port, baud=115200):
    """Return reason and text of the refusal to open a port."""
    with pytest.raises(LinkError) as raised:
        Link(port, baud)
    return raised.value.reason, str(raised.value)


def test_written_bytes_return_through_a_loop():
    with Link('loop://', 115200) as link:
        link.write(b'abc')
        assert link.wait(1.0)
        assert link.read() == b'abc'
        assert link.read() == b''
        assert not link.wait(0.001)


def test_a_socket_is_a_port():
    server = socket.create_server(('127.0.0.1', 0))
    echoes = threading.Thread(target=lambda: _echo(server), daemon=True)
    echoes.start()
    with Link(f'socket://127.0.0.1:{server.getsockname()[1]}', 115200) as link:
        link.write(b'abc')
        assert link.wait(5.0) and link.read() == b'abc'
        server.close()
        echoes.join(timeout=5.0)
        with pytest.raises(LinkError):  # the peer has closed
            for _ in range(1000):
                link.wait(0.01)
                link.read()


def _echo(server):
    peer, _ = server.accept()
    peer.sendall(peer.recv(10))
    peer.close()


def test_a_pseudo_terminal_carries_every_byte(terminal):
    master, path = terminal
    with Link(path, 921600) as link:
        everything = bytes(range(256))
        link.write(everything)
        assert os.read(master, 1000) == everything
        os.write(master, everything)
        assert link.wait(1.0) and link.read() == everything


def test_the_four_ways_to_fail_to_open_are_distinguished(terminal, tmp_path):
    _, path = terminal
    reasons = [reason('/dev/ttyNowhere')]
    with Link(path, 115200):
        reasons.append(reason(path))
    file = tmp_path / 'file'
    file.touch()
    reasons.append(reason(str(file)))
    reasons.append(reason('nonsense://x'))
    assert [word for word, _ in reasons] == ['missing', 'busy', 'not_a_port', 'bad_address']
    assert all(name in text for (_, text), name in zip(reasons, (
        '/dev/ttyNowhere', f'sudo fuser -v {path}', str(file), 'nonsense')))


def test_no_permission_names_the_group(monkeypatch):
    def refuse(*_, **__):
        raise serial.SerialException(errno.EACCES, 'Permission denied')
    monkeypatch.setattr(serial, 'serial_for_url', refuse)
    word, text = reason('/dev/ttyUSB0')
    assert word == 'permission' and 'usermod -aG dialout' in text


@pytest.mark.parametrize('number, word', [
    (errno.ENOENT, 'missing'), (errno.EACCES, 'permission'), (errno.EPERM, 'permission'),
    (errno.EAGAIN, 'busy'), (errno.EBUSY, 'busy'), (errno.ENOTTY, 'not_a_port'),
    (errno.EISDIR, 'not_a_port'), (errno.EINVAL, 'not_a_port'), (errno.EIO, 'missing')])
@pytest.mark.parametrize('kind', [serial.SerialException, OSError, termios.error, 'converted'])
def test_errors_of_pyserial_on_opening_are_distinguished_by_number(
        monkeypatch, kind, number, word):
    def refuse(*_, **__):
        if kind != 'converted':
            raise kind(number, 'because')
        try:
            raise termios.error(number, 'because')
        except termios.error:
            raise serial.SerialException('could not configure port')
    monkeypatch.setattr(serial, 'serial_for_url', refuse)
    assert reason('/dev/ttyUSB0')[0] == word


def test_the_number_of_the_error_itself_counts_before_that_of_its_origin(monkeypatch):
    def refuse(*_, **__):
        try:
            raise termios.error(errno.EIO, 'because')
        except termios.error:
            raise serial.SerialException(errno.EBUSY, 'busy')
    monkeypatch.setattr(serial, 'serial_for_url', refuse)
    assert reason('/dev/ttyUSB0')[0] == 'busy'


@pytest.mark.parametrize('error', [serial.SerialException, OSError, termios.error])
def test_each_error_of_pyserial_on_an_open_port_is_a_port_that_is_gone(monkeypatch, error):
    port = serial.serial_for_url('loop://')
    monkeypatch.setattr(serial, 'serial_for_url', lambda *_, **__: port)
    link = Link('loop://', 115200)

    def fail(*_):
        raise error(errno.EIO, 'because')
    monkeypatch.setattr(port, 'read', fail)
    with refused('gone', error=LinkError):
        link.read()
    monkeypatch.setattr(port, 'close', fail)
    link.close()


def test_a_baud_rate_that_does_not_exist_is_named(terminal):
    word, text = reason(terminal[1], baud=-5)
    assert word == 'bad_baud' and '-5' in text


def test_a_pulled_plug_is_one_kind_of_error_wherever_it_shows(terminal):
    master, path = terminal
    with Link(path, 115200) as link:
        os.close(master)
        for call in (lambda: link.write(b'x' * 10), link.read,
                     lambda: (link.wait(0.01), link.read())):
            with pytest.raises(LinkError) as raised:
                call()
            assert raised.value.reason == 'gone'
            assert isinstance(raised.value, BallbotError)


def test_a_peer_that_does_not_read_cannot_hold_the_loop(terminal):
    _, path = terminal
    with Link(path, 115200) as link:
        with refused('stuck', error=LinkError):
            for _ in range(100):
                link.write(b'x' * 1000)


def test_a_peer_that_reads_slowly_gets_every_byte_in_order(terminal):
    master, path = terminal
    sent, received = bytes(range(256)) * 80, bytearray()

    def drain():
        while len(received) < len(sent):
            time.sleep(0.001)
            received.extend(os.read(master, 1000))
    reader = threading.Thread(target=drain, daemon=True)
    with Link(path, 115200) as link:
        reader.start()
        link.write(sent)  # more than the buffer of the kernel
        reader.join(timeout=5.0)
    assert bytes(received) == sent


def test_a_line_that_takes_a_few_bytes_occasionally_is_stuck_all_the_same(monkeypatch):
    monkeypatch.setattr(transport, 'LONGEST_WRITE', 0.03)
    ours, theirs = socket.socketpair()
    ours.setblocking(False)
    monkeypatch.setattr(os, 'write', lambda _, data: time.sleep(0.01) or 1)
    assert not Descriptor(ours.fileno()).write(b'x' * 1000)
    monkeypatch.undo()
    ours.close()
    theirs.close()


def test_a_device_is_read_and_written_past_pyserial(terminal, monkeypatch):
    master, path = terminal
    with Link(path, 115200) as link:
        for name in ('read', 'write'):
            monkeypatch.setattr(serial.Serial, name, lambda *_: pytest.fail('by pyserial'))
        link.write(b'abc')
        assert os.read(master, 10) == b'abc'
        os.write(master, b'def')
        assert link.wait(1.0) and link.read() == b'def' and link.read() == b''


def test_a_port_that_is_listened_to_uses_pyserial(terminal, tmp_path):
    master, path = terminal
    with Link(f'spy://{path}?file={tmp_path}/received', 115200) as link:
        link.write(b'abc')
        os.write(master, b'def')
        assert link.wait(1.0) and link.read() == b'def'
    received = (tmp_path / 'received').read_text()
    assert 'abc' in received and 'def' in received


def test_a_reply_that_comes_in_pieces_is_returned_once_there_is_enough_of_it(terminal):
    master, path = terminal
    with Link(path, 115200) as link:
        os.write(master, b'1234')
        assert not link.wait(0.02, least=5)
        os.write(master, b'5')
        assert link.wait(1.0, least=5) and link.read() == b'12345' and link.read() == b''
        link.write(b'request')
        os.write(master, b'1234')
        assert not link.wait(0.02, least=5)
        assert link.read() == b'1234'  # fewer bytes are read but not reported
        os.write(master, b'1')
        assert link.wait(1.0) and link.read() == b'1'
        os.close(master)
        with refused('gone', error=LinkError):
            link.wait(0.02, least=5)
            link.read()


def test_the_end_of_a_reply_longer_than_the_shortest_ends_a_wait_too(terminal):
    master, path = terminal
    with Link(path, 115200) as link:
        for _ in range(2):
            link.write(b'request')
            os.write(master, b'1234')
            assert not link.wait(0.02, least=5)
            os.write(master, b'5')
            assert link.wait(1.0, least=5) and link.read() == b'12345'
            os.write(master, b'6')
            assert link.wait(1.0, least=5) and link.read() == b'6'


def test_a_device_that_has_hung_up_is_gone_and_one_that_is_silent_is_not():
    # As with a closed terminal, no bytes are available in either case.
    ours, theirs = socket.socketpair()
    ours.setblocking(False)
    line = Descriptor(ours.fileno())
    assert line.read() == b'' and not line.wait(0.0)
    theirs.send(b'abc')
    assert line.wait(0.0) and line.read() == b'abc' and line.read() == b''
    theirs.close()
    assert line.wait(1.0)
    with pytest.raises(OSError) as raised:
        line.read()
    assert raised.type is OSError and raised.value.errno is None  # no system error
    ours.close()


def test_a_host_that_is_held_up_while_it_writes_does_not_blame_the_line(terminal, monkeypatch):
    write = os.write
    with Link(terminal[1], 115200) as link:
        monkeypatch.setattr(os, 'write', lambda *given: time.sleep(0.1) or write(*given))
        link.write(b'abc')
        monkeypatch.undo()
        assert os.read(terminal[0], 10) == b'abc'


def test_a_link_drops_the_bytes_that_it_has_not_sent_before_it_is_closed(terminal, monkeypatch):
    open_then = []
    monkeypatch.setattr(serial.Serial, 'reset_output_buffer',
                        lambda port: open_then.append(port.is_open))
    Link(terminal[1], 115200).close()
    assert open_then == [True]


def test_a_closed_link_says_so(terminal):
    link = Link(terminal[1], 115200)
    link.close()
    link.close()
    with refused('closed', 'port', LinkError):
        link.write(b'x')


def test_traffic_is_recorded_and_played_back(tmp_path):
    recorder = Recorder(tmp_path / 'traffic.txt')
    with Link('loop://', 115200, recorder) as link:
        link.write(b'request')
        link.wait(1.0)
        assert link.read() == b'request'
    recorder.close()
    records = read_capture(tmp_path / 'traffic.txt')
    assert [(record.direction, record.data) for record in records] == [
        ('>', b'request'), ('<', b'request')]
    assert 0.0 <= records[0].time <= records[1].time
    replay = Replay(records)
    replay.write(b'other')
    assert replay.wait(1.0) and replay.read() == b'request' and replay.finished
    with pytest.raises(LinkError):
        replay.read()


def test_a_capture_gives_back_what_came_from_the_drive_and_keeps_what_is_written():
    replay = Replay([Record(0.0, '>', b'ask'), Record(0.1, '<', b'reply'), Record(0.2, '>', b'x')])
    replay.write(b'four')
    assert replay.read() == b'reply' and replay.finished
    assert replay.written == [b'four']


def test_a_full_disk_ends_the_recording_with_one_warning_and_not_the_link(caplog):
    recorder = Recorder('/dev/full')
    with Link('loop://', 115200, recorder) as link:
        for _ in range(2000):  # more than the buffer of the file
            link.write(b'abcdefgh')
            link.read()
    assert 'No space' in recorder.failure
    recorder.close()
    assert [record.levelname for record in caplog.records] == ['WARNING']


def test_a_disk_that_is_full_at_the_end_of_a_recording_is_noted():
    recorder = Recorder('/dev/full')
    recorder.record('>', b'abc')  # stays in the buffer of the file
    assert recorder.failure is None
    recorder.close()
    assert 'No space' in recorder.failure


@pytest.mark.parametrize('text, reason, line', [
    ('', 'wrong_kind', ''), ('something else\n', 'wrong_kind', ''),
    ('# ballbot traffic 1\n0.1 ? 00\n', 'unreadable', ':2'),
    ('# ballbot traffic 1\n0.1 < 0g\n', 'unreadable', ':2')])
def test_a_file_that_is_not_a_capture_is_refused(tmp_path, text, reason, line):
    path = tmp_path / 'traffic.txt'
    path.write_text(text)
    with refused(reason, str(path), ConfigurationError) as caught:
        read_capture(path)
    assert f'{path}{line}: ' in str(caught.value)


def test_a_capture_that_was_cut_off_is_read_as_far_as_it_goes(tmp_path):
    (tmp_path / 'traffic.txt').write_text('# ballbot traffic 1\n0.1 < 00ff\n0.2 < 0')
    assert [record.data for record in read_capture(tmp_path / 'traffic.txt')] == [b'\x00\xff']


def test_a_capture_is_bounded_and_both_its_parts_are_read(tmp_path, monkeypatch):
    monkeypatch.setattr(capture, 'MOST_BYTES', 1000)
    path = tmp_path / 'traffic.txt'
    (tmp_path / 'traffic.txt.1').write_text('of an older capture')
    recorder = Recorder(path)
    for number in range(200):
        recorder.record('>', bytes([number]) * 10)
        assert sum(part.stat().st_size for part in tmp_path.iterdir()) <= 2000
    recorder.close()
    records = read_capture(path)
    numbers = [record.data[0] for record in records]
    assert numbers == list(range(numbers[0], 200)) and 25 < len(numbers) < 60
    assert [record.time for record in records] == sorted(record.time for record in records)
    Recorder(path).close()  # a new capture replaces the files
    assert read_capture(path) == []


def test_a_disk_that_is_full_when_a_capture_goes_on_ends_it(tmp_path, monkeypatch):
    monkeypatch.setattr(capture, 'MOST_BYTES', 100)
    path = tmp_path / 'traffic.txt'
    recorder = Recorder(path)
    (tmp_path / 'traffic.txt.1').mkdir()  # no file can be moved there
    for _ in range(10):
        recorder.record('>', bytes(20))
    assert recorder.failure
    recorder.close()
