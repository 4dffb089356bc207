# SPDX-License-Identifier: Apache-2.0
"""The black box keeps the last minutes in bounded memory, and writes them after a fault."""
import math
import sys
import threading
import time

import pytest
from virtual_robot import VirtualRobot

from ballbot_ros.black_box import ring as black_box
from ballbot_ros.black_box.file import BlackBoxFiles, header, MOST_FILES, write_file
from ballbot_ros.black_box.reader import read_black_box
from ballbot_ros.black_box.ring import BlackBox, EVENT, FAULT, NOTE
from ballbot_ros.bridge.loop import Loop
from ballbot_ros.bridge.motor_state import MotorState
from ballbot_ros.bridge.session import Session
from ballbot_ros.control import Mode, SetPoint
from ballbot_ros.drives.capture import ShownToAll
from ballbot_ros.drives.contract import Telemetry
from ballbot_ros.errors import ConfigurationError, MessageError, RefusedError
from ballbot_ros.estimation import ImuReading
from ballbot_ros.physics import load_robot


class WitnessedRobot(VirtualRobot):
    """A virtual robot with a black box."""

    def start(self):
        self.box = BlackBox(self.clock)
        self.session = Session(self.hardware, load_robot('gimball'), self.connect, self.clock,
                               self.box)

    def write(self, data):
        self.box.record('>', data)
        super().write(data)

    def read(self):
        data = super().read()
        if data:
            self.box.record('<', data)
        return data


def kept(box, folder, reason='test'):
    """Write a box to a file and read it."""
    return read_black_box(write_file(folder, box.snapshot(), header(
        box, box.clock(), reason, {'hardware': 'virtual'})))


def told(box, folder):
    """Return the texts of all events."""
    return [event.text for event in kept(box, folder).events]


def test_what_is_written_is_read_back(tmp_path):
    now = [5.0]
    box = BlackBox(lambda: now[0])
    box.command(0.25, 4.5)
    box.set_point(SetPoint(Mode.SPEED, 1e300, 4.5))  # beyond four bytes
    box.imu(ImuReading(4.75, 0.5, -1.25, 9.75))
    box.record('>', b'v 0 0 0.5\n')
    now[0] = 6.0
    box.record('<', bytes(range(256)) * 80)  # longer than a record may be
    box.tell('größer', NOTE)
    box.refused('command', MessageError('stale', 'too old'))
    found = kept(box, tmp_path)
    assert not found.damage
    command, imu = found.tables['command'], found.tables['imu']
    assert command['value'].tolist() == [0.25, math.inf]
    assert (command['what'].tolist(), command['stamp'].tolist()) == ([0, 4], [4.5, 4.5])
    assert [float(imu[name][0]) for name in ('time', 'turn_rate', 'forward', 'upward')] == [
        4.75, 0.5, -1.25, 9.75]
    assert found.traffic[0] == (5.0, '>', b'v 0 0 0.5\n')
    assert b''.join(item.data for item in found.traffic[1:]) == bytes(range(256)) * 80
    assert [tuple(event) for event in found.events] == [
        (6.0, NOTE, 'größer'), (6.0, EVENT, 'command refused: too old')]
    assert found.span == (4.75, 6.0)
    assert found.units['imu']['forward'] == 'm/s2'


@pytest.mark.parametrize('protocol', ['odrive', 'vesc', 'roboclaw'])
def test_a_session_leaves_its_periods_commands_readings_and_traffic(protocol, tmp_path):
    robot = WitnessedRobot(protocol).ready()
    begin = robot.now
    robot.run(0.5, 0.2)
    found = kept(robot.box, tmp_path)
    period = found.tables['period']
    last = period['time'] > begin
    assert 200 < last.sum() < 600  # 500 Hz, with or without one more where nothing was measured
    estimate = robot.session.fusion.estimate.readings
    known = {name: column[~(column != column)][-1] for name, column in period.items()}
    assert known['pendulum_angle'] == pytest.approx(estimate.pendulum_angle, rel=1e-6)
    assert known['joint_angle'] == estimate.joint_angle
    assert known['ball_rate'] == pytest.approx(estimate.ball_rate, rel=1e-6)
    assert known['joint_rate'] == pytest.approx(estimate.joint_rate, rel=1e-6)
    assert known['asked'] == known['torque'] == pytest.approx(0.2)
    assert found.tables['command']['value'][-1] == pytest.approx(0.2)
    assert len(found.tables['imu']['time']) > 200
    assert found.tables['drive']['bus_voltage'][-1] == pytest.approx(24.0, abs=0.1)
    assert {item.direction for item in found.traffic} == {'<', '>'}
    assert [event.text for event in found.events] == [
        'closed', 'found', 'e-stop released', 'armed', 'commands arrive']


@pytest.mark.parametrize('kind', ['period', 'command', 'imu', 'drive', 'event', 'traffic'])
def test_no_record_is_lost_where_a_block_ends(kind, tmp_path):
    robot = WitnessedRobot()
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
            box.tell(f'this is event {count}')
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
        assert found.tables[kind][name].tolist() == list(map(float, range(number)))


def test_memory_is_bounded_however_long_it_runs(monkeypatch):
    monkeypatch.setattr(black_box, 'MOST_BLOCKS', 16)
    box = BlackBox()
    for _ in range(40_000):
        box.record('<', bytes(100))
    blocks = box.snapshot()
    assert len(blocks) <= 16
    assert 14 * black_box.BLOCK < sum(map(len, blocks)) <= 16 * black_box.BLOCK
    assert sum(sys.getsizeof(block.obj) for block in blocks) < 16 * (black_box.BLOCK + 100)
    # The bound of the real one, which is stated in docs/hardware_bridge.md.
    assert black_box.BLOCK * 1024 == 64 * 2**20


def test_what_is_older_than_ten_minutes_goes():
    now = [0.0]
    box = BlackBox(lambda: now[0])
    for second in range(2000):
        now[0] = float(second)
        for _ in range(10):
            box.record('<', bytes(1000))
    kind = black_box.STRUCTS[black_box.FROM_DRIVE]
    first = kind.unpack_from(box.snapshot()[0])[1]
    assert 0.0 <= 2000.0 - black_box.SPAN - first < 10.0  # a block is 6.5 s here


def test_threads_do_not_spoil_each_others_records(tmp_path):
    box = BlackBox()

    def write(number):
        for count in range(3000):
            box.record('>', bytes([number]) * ((1 + count % 50)))
            box.tell(str(number))
    threads = [threading.Thread(target=write, args=(number,)) for number in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    found = kept(box, tmp_path)
    assert not found.damage
    assert len(found.events) == len(found.traffic) == 9000
    assert all(len(set(item.data)) <= 1 for item in found.traffic)


def test_a_person_who_engages_the_e_stop_is_no_fault(tmp_path):
    robot = WitnessedRobot().ready()
    robot.run(0.1, 0.2)
    robot.session.engage('asked for by service')
    robot.run(0.1)
    assert not robot.box.faulted.is_set()
    assert 'e-stop: asked for by service' in told(robot.box, tmp_path)


@pytest.mark.parametrize('rearm', [False, True])
def test_a_drive_that_is_lost_is_one(rearm, tmp_path):
    robot = WitnessedRobot(rearm=rearm).ready()
    robot.run(0.1, 0.2)
    robot.plugged = False
    robot.run(0.1)
    assert robot.box.faulted.is_set()
    when, why = robot.box.take_fault()
    assert 'drive lost: the line was lost: the cable is out' == why
    assert robot.now - 0.11 < when < robot.now
    assert robot.box.take_fault() is None and not robot.box.faulted.is_set()


def test_a_drive_that_is_lost_without_power_is_one_too():
    robot = WitnessedRobot()
    robot.session.configure()
    robot.run(0.1)
    robot.plugged = False
    robot.run(0.1)
    assert robot.box.take_fault()[1].startswith('drive lost')


def test_a_runaway_is_one():
    robot = WitnessedRobot().ready()
    robot.session.supervisor.trigger('runaway: the joint turns at 99 rad/s')
    robot.run(0.1)
    assert robot.box.take_fault()[1] == 'e-stop: runaway: the joint turns at 99 rad/s'


def test_a_loop_that_fails_is_one():
    robot = WitnessedRobot().ready()

    def fail(report):
        raise ZeroDivisionError('planted')
    loop = Loop(robot.session, 500.0, fail)
    loop._thread.join(5.0)
    assert "the loop ended: ZeroDivisionError('planted')" in robot.box.take_fault()[1]


def test_a_release_that_is_refused_is_told(tmp_path):
    robot = WitnessedRobot().ready()
    robot.run(0.1, 0.2)
    robot.session.engage('x')
    with pytest.raises(RefusedError):
        robot.session.release()
    assert any(text.startswith('the e-stop stays engaged: ')
               for text in told(robot.box, tmp_path))


def test_a_refusal_that_comes_500_times_a_second_is_counted(tmp_path):
    now = [0.0]
    box = BlackBox(lambda: now[0])
    for number in range(500):
        now[0] = number / 500.0
        box.refused('command', MessageError('stale', f'{number} too old'))
    texts = told(box, tmp_path)
    assert len(texts) == 10
    assert texts[1].startswith('command refused: 50 too old (49 more')


def test_files_are_written_after_a_fault_by_a_thread_of_their_own(tmp_path):
    box = BlackBox()
    files = BlackBoxFiles(box, tmp_path / 'new', {'hardware': 'mine'}, 0.2, 0.05)
    box.tell('the drive exploded', FAULT)
    box.tell('and then this')
    assert not list(tmp_path.glob('new/*'))  # what follows is waited for
    deadline = time.monotonic() + 10.0
    while not files.written and time.monotonic() < deadline:
        time.sleep(0.01)
    path, = (tmp_path / 'new').glob('ballbot-*.blackbox')
    found = read_black_box(path)
    assert found.head['reason'] == 'the drive exploded' and not found.damage
    assert found.head['about'] == {'hardware': 'mine'}
    assert [event.text for event in found.events] == ['the drive exploded', 'and then this']
    assert abs(found.wall_clock(found.fault_time).timestamp() - time.time()) < 10.0
    box.tell('again', FAULT)
    files.close()  # does not wait for the pause between two files
    files.close()
    assert files.written == 2
    assert sorted(tmp_path.glob('new/*')) == sorted(tmp_path.glob('new/ballbot-*.blackbox'))


def test_the_same_fault_again_and_again_fills_no_disk(tmp_path):
    box = BlackBox()
    files = BlackBoxFiles(box, tmp_path, {}, apart=0.02, aftermath=0.0)
    end = time.monotonic() + 1.0
    while time.monotonic() < end:
        box.tell('cannot arm', FAULT)
        time.sleep(0.01)
    assert 2 <= files.written <= 6  # after 0.02, 0.04, 0.08, 0.16, ... s
    files.close()


def test_the_number_of_files_is_bounded_and_the_newest_stay(tmp_path):
    box = BlackBox()
    (tmp_path / 'mine.txt').write_text('stays')
    names = [write_file(tmp_path, [], header(box, 0.0, '', {})) for _ in range(MOST_FILES + 3)]
    assert sorted(tmp_path.glob('*.blackbox')) == names[3:]
    assert (tmp_path / 'mine.txt').exists()


def test_a_folder_that_cannot_be_written_is_told_and_stops_nothing(tmp_path, caplog):
    (tmp_path / 'file').write_text('')
    box = BlackBox()
    files = BlackBoxFiles(box, tmp_path / 'file', {}, aftermath=0.0)
    box.tell('fault', FAULT)
    files.close()
    assert 'cannot be written' in caplog.text and files.failure


def test_a_file_that_was_cut_off_anywhere_gives_what_is_left(tmp_path):
    box = BlackBox()
    for number in range(3):
        for _ in range(1000):
            box.tell(f'event {number}')
        box.snapshot()
    path = write_file(tmp_path, box.snapshot(), header(box, 0.0, 'why', {}))
    whole = path.read_bytes()
    cut = tmp_path / 'cut'
    seen = set()
    for size in range(0, len(whole), 97):
        cut.write_bytes(whole[:size])
        try:
            found = read_black_box(cut)
        except ConfigurationError as error:
            assert 'header' in str(error) or 'no file of a black box' in str(error)
        else:
            assert 'cut off' in found.damage[0]
            seen.add(len(found.events))
    assert seen >= {0, 1000, 2000}


def test_a_byte_that_is_wrong_costs_one_block_at_most(tmp_path):
    box = BlackBox()
    for number in range(3):
        for count in range(1000):
            box.tell(f'event {number} {count * 7919 % 1009}')
        box.snapshot()
    path = write_file(tmp_path, box.snapshot(), header(box, 0.0, 'why', {}))
    whole = path.read_bytes()
    spoilt, refused = tmp_path / 'spoilt', 0
    for at in range(0, len(whole), 211):
        spoilt.write_bytes(whole[:at] + bytes([whole[at] ^ 0x55]) + whole[at + 1:])
        try:
            found = read_black_box(spoilt)
        except ConfigurationError:
            refused += 1
        else:
            assert found.damage and len(found.events) in (0, 1000, 2000, 3000)
    assert refused < 20  # those of the header


@pytest.mark.parametrize('content, complaint', [
    (b'', 'no file of a black box'), (b'ballbot black box 2\n', 'another version'),
    (b'ballbot black box 1\n', 'header')])
def test_another_file_is_refused(tmp_path, content, complaint):
    (tmp_path / 'file').write_bytes(content)
    with pytest.raises(ConfigurationError, match=complaint):
        read_black_box(tmp_path / 'file')
    with pytest.raises(ConfigurationError, match='cannot be read'):
        read_black_box(tmp_path / 'missing')


def test_traffic_is_shown_to_all_who_look():
    boxes = [BlackBox(), BlackBox()]
    ShownToAll(*boxes).record('>', b'abc')
    assert all(bytes(box.snapshot()[0]).endswith(b'abc') for box in boxes)


def test_it_costs_next_to_nothing_per_period():
    robot = WitnessedRobot().ready()
    robot.run(0.1, 0.2)
    session, box = robot.session, BlackBox()
    estimate, telemetry = session.fusion.estimate, session.line.driver.telemetry
    begin, number = time.thread_time(), 5000
    for count in range(number):
        box.period(0.002 * count, estimate, session.supervisor, telemetry,
                   session.control.power.state)
        box.record('>', b'v 0 0 0.123456\nf 0\n')
        box.record('<', b'12.345678 0.123456\n')
        box.command(0.2, 1.0)
    cost = (time.thread_time() - begin) / number
    assert cost < 40e-6  # 4.4 us in bench/black_box.py
