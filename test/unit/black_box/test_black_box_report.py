# SPDX-License-Identifier: Apache-2.0
"""Text, tables, capture and figure of a black-box file."""
from dataclasses import replace

import numpy as np
import pytest
from replay import read_capture, Replay

from ballbot_ros.black_box.dump import write_file
from ballbot_ros.black_box.read import RecordedEvent
from ballbot_ros.black_box.report import _printable, merge_repeated, summary, write_tables
from ballbot_ros.black_box.ring import BlackBox
from ballbot_ros.bridge.observer import Level
from ballbot_ros.cli import main
from ballbot_ros.drives import open_driver
from ballbot_ros.drives.odrive.ascii.driver import ODrive
from ballbot_ros.figures.black_box import around_fault, chosen, MOST_LINES
from ballbot_ros.paper import pulled_plug


@pytest.fixture(scope='module')
def recording():
    """Return the recording of an unplugged drive."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pulled_plug, 'UNPLUG_TIME', 1.7)
        patch.setattr(pulled_plug, 'END_TIME', 2.2)
        return pulled_plug.pulled_plug()


@pytest.fixture
def file(tmp_path):
    """Return a nearly empty black-box file."""
    box = BlackBox()
    box.event('a fault')
    return write_file(tmp_path / 'box', box, box.clock(), 'why', {})


def test_the_second_before_the_fault_is_summarized(recording):
    text = summary(recording)
    for expected in ('drive lost: the line was lost: the cable is out', 'pendulum angle',
                     'torque requested  -0.5 to', 'longest 2.0 ms', '2.0 ms before: torque',
                     'at the detection of the fault', '+0.000 s  FAULT', '24 to 24 V'):
        assert expected in text
    assert 'Damaged' not in text and 'nan' not in text
    assert 'Damaged: a block' in summary(replace(recording, damage=('a block',)))


def test_a_torque_after_the_fault_is_reported(recording):
    period = dict(recording.tables['period'])
    later = period['time'] > recording.fault_time
    period['torque'] = np.where(
        later & (period['time'] < recording.fault_time + 0.0501), 0.3, 0.0)
    tables = {**recording.tables, 'period': period}
    assert 'torque at zero    52.0 ms after it' in summary(replace(recording, tables=tables))
    period['torque'] = np.where(later, 0.3, 0.0)
    assert 'not within the recorded time' in summary(replace(recording, tables=tables))


def test_tables_have_times_relative_to_the_fault(recording, tmp_path):
    write_tables(recording, tmp_path)
    lines = (tmp_path / 'period.csv').read_text().splitlines()
    titles = lines[0].split(',')
    assert titles[0] == 'time [s]' and 'torque [N m]' in titles and titles[-4:] == [
        'state []', 'e_stop []', 'timed_out []', 'commanded []']
    rows = [line.split(',') for line in lines[1:]]
    before = [row for row in rows if float(row[0]) < -0.5 and row[-4] == 'ARMED']
    assert before and all(row[-3:] == ['0.0', '0.0', '1.0'] for row in before[10:])
    assert rows[-1][-4:-2] == ['DISCONNECTED', '1.0']
    assert len(rows) == len(recording.tables['period']['time'])
    assert 'FAULT' not in (tmp_path / 'events.csv').read_text()
    assert ',2,"drive lost: the line was lost: the cable is out"' in (
        tmp_path / 'events.csv').read_text()


def test_a_driver_can_replay_the_capture_of_the_traffic(recording, tmp_path):
    write_tables(recording, tmp_path)
    records = read_capture(tmp_path / 'traffic.txt')
    assert len(records) == len(recording.traffic) and records[0].time == 0.0
    replay = Replay(records)
    driver = open_driver('odrive', replay, ODrive.Options(torque_limit=0.1), lambda: 0.0)
    while not replay.finished:
        driver.poll()
    assert driver.counts['replies'] > 500


def test_the_figure_has_a_panel_for_each_quantity_and_a_line_for_each_fault(recording):
    figure = around_fault(recording, 1.0)
    assert [axes.get_ylabel().split(' [')[0] for axes in figure.axes] == [
        'angle', 'rate', 'torque', 'supply', 'heat', 'gap']
    texts = [text.get_text() for text in figure.texts]
    assert any('+0.000 s   drive lost: the line was lost' in text for text in texts)
    assert figure.axes[0].get_xlim()[0] == pytest.approx(-1.0)


def test_many_events_leave_space_for_the_faults():
    events = [RecordedEvent(float(number), Level.LOG, str(number)) for number in range(100)]
    events[50] = RecordedEvent(50.0, Level.EVENT, 'this')
    kept = chosen(events)
    assert len(kept) == MOST_LINES and events[50] in kept
    assert kept == sorted(kept, key=lambda event: event.time)


def test_a_line_of_the_log_that_repeats_an_event_is_omitted():
    first = RecordedEvent(1.0, Level.EVENT, 'drive lost: the cable is out')
    repeated = RecordedEvent(1.01, Level.LOG, 'the cable is out')
    later = RecordedEvent(2.0, Level.LOG, 'the cable')
    assert merge_repeated([first, repeated, later]) == [first, later]


def test_a_repeated_event_is_reported_once_with_its_count():
    often = [RecordedEvent(0.3 * number, Level.FAULT, 'cannot arm') for number in range(8)]
    between = [RecordedEvent(0.3 * number + 0.1, Level.EVENT, 'stopped') for number in range(8)]
    late = RecordedEvent(9.0, Level.FAULT, 'cannot arm')
    merged = merge_repeated(sorted([*often, *between, late], key=lambda event: event.time))
    assert [event.text for event in merged] == [
        'cannot arm (8 times in 2.1 s)', 'stopped (8 times in 2.1 s)', 'cannot arm']


def test_bytes_of_text_are_shown_as_text():
    assert _printable(b'c 0 0.1\nf 0\n') == repr('c 0 0.1\nf 0\n')
    assert _printable(bytes((2, 1, 4, 0x40, 0x84, 3))) == '02 01 04 40 84 03'


def test_replay_prints_a_report_and_writes_files(file, tmp_path, capsys):
    assert main(['replay', str(file.parent), '--out', str(tmp_path / 'out'),
                 '--format', 'png']) == 0
    out = capsys.readouterr().out
    assert 'a fault' in out and 'motion' in out and 'Written to' in out
    assert sorted(path.name for path in (tmp_path / 'out').iterdir()) == [
        'black_box.png', 'command.csv', 'drive.csv', 'events.csv', 'imu.csv', 'period.csv',
        'traffic.txt']


def test_replay_of_a_damaged_file_prints_the_readable_part_and_fails(file, capsys):
    file.write_bytes(file.read_bytes()[:-20])
    assert main(['replay', str(file)]) == 1
    assert 'Damaged: the file is damaged or truncated' in capsys.readouterr().out


@pytest.mark.parametrize('words, complaint', [
    (['{folder}/empty'], 'contains neither a black-box file nor a bag'),
    (['{folder}/missing'], 'cannot be read'), (['{folder}/text'], 'is not a file of a black box'),
    (['{file}', '--before', '0'], '--before must be more than 0')])
def test_replay_refuses_in_one_line(words, complaint, file, tmp_path, capsys):
    (tmp_path / 'empty').mkdir()
    (tmp_path / 'text').write_text('hello')
    assert main(['replay', *(word.format(folder=tmp_path, file=file) for word in words)]) == 2
    error = capsys.readouterr().err
    assert complaint in error and error.count('\n') == 1
