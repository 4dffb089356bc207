# SPDX-License-Identifier: Apache-2.0
"""The black box keeps the last minutes in bounded memory, and dumps them after a fault."""
import sys
import threading
import time

from mcap.reader import make_reader
from mcap.writer import MCAP0_MAGIC
from mcap_ros2.decoder import DecoderFactory
import numpy as np
import pytest
from refusals import refused
from virtual_robot import VirtualRobot
from waiting import wait_until

from ballbot_ros.black_box import dump, ring
from ballbot_ros.black_box.dump import BlackBoxFiles, MOST_FILES, write_file
from ballbot_ros.black_box.read import date, find_black_box, read_black_box
from ballbot_ros.black_box.ring import BlackBox
from ballbot_ros.bridge.loop import Loop
from ballbot_ros.bridge.motor_state import MotorState
from ballbot_ros.bridge.observer import Level
from ballbot_ros.bridge.supervisor import EStop, StopReason
from ballbot_ros.control import Mode, SetPoint
from ballbot_ros.drives.capture import ShownToAll
from ballbot_ros.drives.contract import Telemetry
from ballbot_ros.errors import ConfigurationError, MessageError, RefusedError
from ballbot_ros.estimation import ImuReading


class RecordedRobot(VirtualRobot):
    """A virtual robot with a black box."""

    def start(self):
        self.observer = self.box = BlackBox(self.clock)
        super().start()

    def to_drive(self, data):
        self.box.record('>', data)
        return data

    def read(self):
        data = super().read()
        if data:
            self.box.record('<', data)
        return data


def kept(box, folder, reason='test'):
    """Write a box to a file and read it."""
    return read_black_box(write_file(folder, box, box.clock(), reason, {'hardware': 'virtual'}))


def texts(box, folder):
    """Return the texts of all events."""
    return [event.text for event in kept(box, folder).events]


def test_messages_are_read_back_as_written(tmp_path):
    now = [5.0]
    box = BlackBox(lambda: now[0])
    box.command(0.25, 4.5)
    box.set_point(SetPoint(Mode.SPEED, 1e300, 4.5))
    box.imu(ImuReading(4.75, 0.5, -1.25, 9.75))
    box.record('>', b'v 0 0 0.5\n')
    now[0] = 6.0
    box.record('<', bytes(range(256)) * 80)  # longer than the limit of a record
    box.event('größer', Level.LOG)
    box.refused('command', MessageError('too old', 'stale', 'stamp'))
    found = kept(box, tmp_path)
    assert not found.damage
    command, imu = found.tables['command'], found.tables['imu']
    assert command['value'].tolist() == [0.25, 1e300]
    assert (command['kind'].tolist(), command['stamp'].tolist()) == ([0, 4], [4.5, 4.5])
    assert [float(imu[name][0]) for name in ('turn_rate', 'forward', 'upward')] == [
        0.5, -1.25, 9.75]
    assert found.traffic[0][1:] == ('>', b'v 0 0 0.5\n')
    assert b''.join(item.data for item in found.traffic[1:]) == bytes(range(256)) * 80
    assert [tuple(event[1:]) for event in found.events] == [
        (Level.LOG, 'größer'), (Level.EVENT, 'command refused: too old')]
    begin, end = found.span
    assert end - begin == pytest.approx(1.25, abs=1e-6)
    assert date(end).timestamp() == pytest.approx(time.time(), abs=10.0)


def test_the_file_is_mcap_with_ros_messages(tmp_path):
    box = BlackBox()
    box.imu(ImuReading(box.clock(), 0.5, -1.25, 9.75))
    box.event('größer')
    path = write_file(tmp_path, box, box.clock(), 'why', {'hardware': 'mine'})
    with open(path, 'rb') as stream:
        found = {message.channel.topic: message.decoded_message for message in make_reader(
            stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages()}
    assert found['/black_box/imu'].upward == 9.75
    assert found['/black_box/event'].text == 'größer'
    assert found['/black_box/event'].level == Level.EVENT
    assert find_black_box(tmp_path) == path


@pytest.mark.parametrize('protocol', ['odrive', 'vesc', 'roboclaw'])
def test_a_session_records_its_periods_commands_readings_and_traffic(protocol, tmp_path):
    robot = RecordedRobot(protocol).ready()
    begin = robot.now
    robot.run(0.5, 0.2)
    found = kept(robot.box, tmp_path)
    period = found.tables['period']
    last = period['time'] > begin
    assert 200 < last.sum() < 600  # 500 Hz, with or without periods without a measurement
    estimate = robot.session.fusion.estimate.readings
    known = {name: column[~np.isnan(column)][-1] for name, column in period.items()}
    assert known['pendulum_angle'] == pytest.approx(estimate.pendulum_angle, rel=1e-6)
    assert known['joint_angle'] == estimate.joint_angle
    assert known['ball_rate'] == pytest.approx(estimate.ball_rate, rel=1e-6)
    assert known['joint_rate'] == pytest.approx(estimate.joint_rate, rel=1e-6)
    assert known['requested'] == known['torque'] == pytest.approx(0.2)
    assert found.tables['command']['value'][-1] == pytest.approx(0.2)
    assert len(found.tables['imu']['time']) > 200
    assert found.tables['drive']['bus_voltage'][-1] == pytest.approx(24.0, abs=0.1)
    assert {item.direction for item in found.traffic} == {'<', '>'}
    assert [event.text for event in found.events] == [
        'closed', 'found', 'e-stop released', 'armed', 'commands arrive']


@pytest.mark.parametrize('kind', ['period', 'command', 'imu', 'drive', 'event', 'traffic'])
def test_no_record_is_lost_at_the_end_of_a_block(kind, tmp_path):
    robot = RecordedRobot()
    box, supervisor = BlackBox(), robot.session.supervisor
    number = 4000 if kind != 'drive' else 7000
    for count in range(number):
        time_ = float(count)
        if kind in ('period', 'drive'):
            box.period(time_, None, supervisor, Telemetry(bus_voltage=time_),
                       MotorState.DISARMED)
        elif kind == 'command':
            box.command(time_, 0.0)
        elif kind == 'imu':
            box.imu(ImuReading(time_, 0.0, 0.0, 0.0))
        elif kind == 'event':
            box.event(f'this is event {count}')
        else:
            box.record('<', b'some bytes of number %i' % count)
    found = kept(box, tmp_path)
    assert len(box.snapshot()) > 1 and not found.damage
    if kind == 'event':
        assert [event.text for event in found.events] == [
            f'this is event {count}' for count in range(number)]
    elif kind == 'traffic':
        assert len(found.traffic) == number
    else:
        name = {'drive': 'bus_voltage', 'command': 'value'}.get(kind, 'time')
        column = found.tables[kind][name]
        assert (column - column[0]).tolist() == pytest.approx(list(range(number)))


def test_memory_is_bounded_for_any_duration(monkeypatch):
    monkeypatch.setattr(ring, 'MOST_BLOCKS', 16)
    box = BlackBox()
    for _ in range(40_000):
        box.record('<', bytes(100))
    blocks = box.snapshot()
    assert len(blocks) <= 16
    assert 14 * ring.BLOCK < sum(map(len, blocks)) <= 16 * ring.BLOCK
    assert sum(sys.getsizeof(block.obj) for block in blocks) < 16 * (ring.BLOCK + 100)


def test_the_bound_of_the_memory_matches_the_documents():
    assert ring.BLOCK * ring.MOST_BLOCKS == 96 * 2**20


def test_messages_older_than_ten_minutes_are_dropped():
    now = [0.0]
    box = BlackBox(lambda: now[0])
    for second in range(2000):
        now[0] = float(second)
        for _ in range(10):
            box.record('<', bytes(1000))
    first = 1e-9 * ring.MESSAGE.unpack_from(box.snapshot()[0])[4] - box.clock_offset
    assert 0.0 <= 2000.0 - ring.SPAN - first < 10.0  # a block is 6.5 s here


def test_threads_do_not_corrupt_the_records_of_each_other(tmp_path):
    box = BlackBox()

    def write(number):
        for count in range(3000):
            box.record('>', bytes([number]) * ((1 + count % 50)))
            box.event(str(number))
    threads = [threading.Thread(target=write, args=(number,)) for number in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    found = kept(box, tmp_path)
    assert not found.damage
    assert len(found.events) == len(found.traffic) == 9000
    assert all(len(set(item.data)) <= 1 for item in found.traffic)


def test_a_manual_e_stop_is_not_a_fault(tmp_path):
    robot = RecordedRobot().ready()
    robot.run(0.1, 0.2)
    robot.session.engage('asked for by service')
    robot.run(0.1)
    assert not robot.box.faulted.is_set()
    assert 'e-stop: asked for by service' in texts(robot.box, tmp_path)


@pytest.mark.parametrize('rearm', [False, True])
def test_the_loss_of_a_drive_is_a_fault(rearm, tmp_path):
    robot = RecordedRobot(rearm=rearm).ready()
    robot.run(0.1, 0.2)
    robot.plugged = False
    robot.run(0.1)
    assert robot.box.faulted.is_set()
    when, why = robot.box.take_fault()
    assert 'drive lost: the line was lost: the cable is out' == why
    assert robot.now - 0.11 < when < robot.now
    assert robot.box.take_fault() is None and not robot.box.faulted.is_set()


def test_the_loss_of_a_drive_without_power_is_a_fault():
    robot = RecordedRobot()
    robot.session.configure()
    robot.run(0.1)
    robot.plugged = False
    robot.run(0.1)
    assert robot.box.take_fault()[1].startswith('drive lost')


def test_a_runaway_is_a_fault():
    robot = RecordedRobot().ready()
    robot.session.supervisor.trigger(
        EStop(StopReason.RUNAWAY, 'runaway: the joint rotates at 99 rad/s'))
    robot.run(0.1)
    assert robot.box.take_fault()[1] == 'e-stop: runaway: the joint rotates at 99 rad/s'


def test_an_error_in_the_loop_is_a_fault():
    robot = RecordedRobot().ready()

    def fail(report):
        raise ZeroDivisionError('planted')
    loop = Loop(robot.session, 500.0, fail)
    loop._thread.join(5.0)
    assert "the loop ended: ZeroDivisionError('planted')" in robot.box.take_fault()[1]


def test_a_refused_release_is_recorded(tmp_path):
    robot = RecordedRobot().ready()
    robot.run(0.1, 0.2)
    robot.session.engage('x')
    with pytest.raises(RefusedError):
        robot.session.release()
    assert any(text.startswith('the e-stop remains engaged: ')
               for text in texts(robot.box, tmp_path))


def test_refusals_at_500_hz_are_counted(tmp_path):
    now = [0.0]
    box = BlackBox(lambda: now[0])
    for number in range(500):
        now[0] = number / 500.0
        box.refused('command', MessageError(f'{number} too old', 'stale', 'stamp'))
    found = texts(box, tmp_path)
    assert len(found) == 10
    assert found[1].startswith('command refused: 50 too old (49 more')


def test_a_separate_thread_writes_files_after_a_fault(tmp_path, monkeypatch):
    monkeypatch.setattr(dump, 'SHORTEST_PAUSE', 0.2)
    monkeypatch.setattr(dump, 'TIME_AFTER_FAULT', 0.05)
    box = BlackBox()
    files = BlackBoxFiles(box, tmp_path / 'new', {'hardware': 'mine'})
    box.event('the drive exploded', Level.FAULT)
    box.event('and then this')
    assert not list(tmp_path.glob('new/*'))  # the thread waits for the events that follow
    wait_until(lambda: files.written)
    path, = (tmp_path / 'new').glob('ballbot-*.mcap')
    found = read_black_box(path)
    assert found.reason == 'the drive exploded' and not found.damage
    assert found.about == {'hardware': 'mine'}
    assert [event.text for event in found.events] == ['the drive exploded', 'and then this']
    assert abs(found.fault_time - time.time()) < 10.0
    box.event('again', Level.FAULT)
    files.close()  # without waiting for the pause between two files
    files.close()
    assert files.written == 2
    assert sorted(tmp_path.glob('new/*')) == sorted(tmp_path.glob('new/ballbot-*.mcap'))


@pytest.mark.slow
def test_a_repeated_fault_does_not_fill_the_disk(tmp_path, monkeypatch):
    monkeypatch.setattr(dump, 'SHORTEST_PAUSE', 0.02)
    monkeypatch.setattr(dump, 'TIME_AFTER_FAULT', 0.0)
    box = BlackBox()
    files = BlackBoxFiles(box, tmp_path, {})
    end = time.monotonic() + 1.0
    while time.monotonic() < end:
        box.event('cannot arm', Level.FAULT)
        time.sleep(0.01)
    assert 2 <= files.written <= 6  # after 0.02, 0.04, 0.08, 0.16, ... s
    files.close()


def test_the_number_of_files_is_bounded_and_the_newest_are_kept(tmp_path):
    box = BlackBox()
    (tmp_path / 'mine.txt').write_text('stays')
    names = [write_file(tmp_path, box, 0.0, '', {}) for _ in range(MOST_FILES + 3)]
    assert sorted(tmp_path.glob('*.mcap')) == names[3:]
    assert (tmp_path / 'mine.txt').exists()


def test_a_file_is_kept_although_the_clock_has_been_set_back(tmp_path):
    later = [tmp_path / f'ballbot-29990101T0000{number:02}.000000Z.mcap'
             for number in range(MOST_FILES)]
    for path in later:
        path.write_bytes(b'')
    path = write_file(tmp_path, BlackBox(), 0.0, '', {})
    assert sorted(tmp_path.glob('*.mcap')) == [path, *later[1:]]


def test_an_unwritable_folder_is_reported_without_an_error(tmp_path, caplog):
    (tmp_path / 'file').write_text('')
    box = BlackBox()
    files = BlackBoxFiles(box, tmp_path / 'file', {})
    box.event('fault', Level.FAULT)
    files.close()
    assert 'cannot be written' in caplog.text and files.failure


@pytest.mark.slow
def test_the_readable_part_of_a_truncated_file_is_returned(tmp_path):
    box = BlackBox()
    for number in range(3):
        for _ in range(300):
            box.event(f'event {number}')
        box.snapshot()
    path = write_file(tmp_path, box, 0.0, 'why', {})
    whole = path.read_bytes()
    cut = tmp_path / 'cut'
    seen = set()
    for size in range(0, len(whole), 97):
        cut.write_bytes(whole[:size])
        try:
            found = read_black_box(cut)
        except ConfigurationError as error:
            assert 'is not a file of a black box' in str(error)
        else:
            assert 'truncated' in found.damage[0]
            seen.add(len(found.events))
    assert seen >= {0, 300, 600}


@pytest.mark.slow
def test_a_corrupted_byte_loses_at_most_one_block(tmp_path):
    box = BlackBox()
    for number in range(3):
        for count in range(300):
            box.event(f'event {number} {count * 7919 % 1009}')
        box.snapshot()
    path = write_file(tmp_path, box, 0.0, 'why', {})
    whole = path.read_bytes()
    spoilt, refused = tmp_path / 'spoilt', 0
    name = whole.index(b'lz4')  # samples, and each byte of the adjacent lengths
    for at in (*range(0, len(whole), 71), *range(name - 48, name + 16)):
        for bits in (0x55, 0xaa):  # one sets the sign of a length
            spoilt.write_bytes(whole[:at] + bytes([whole[at] ^ bits]) + whole[at + 1:])
            try:
                found = read_black_box(spoilt)
            except ConfigurationError:
                refused += 1
            else:
                assert len(found.events) in (0, 300, 600, 900)
                assert found.damage or len(found.events) == 900
    assert refused < 20  # errors in the header


@pytest.mark.parametrize('content', [b'', b'no mcap', MCAP0_MAGIC])
def test_another_file_is_refused(tmp_path, content):
    (tmp_path / 'file').write_bytes(content)
    with refused('unreadable'):
        read_black_box(tmp_path / 'file')
    with refused('unreadable'):
        read_black_box(tmp_path / 'missing')


def test_traffic_is_passed_to_all_observers():
    boxes = [BlackBox(), BlackBox()]
    ShownToAll(*boxes).record('>', b'abc')
    assert all(bytes(box.snapshot()[0]).endswith(b'abc') for box in boxes)
