# SPDX-License-Identifier: Apache-2.0
"""A log of outcomes keeps all but the last line through a power cut, and refuses what is wrong."""
from dataclasses import replace
import errno
import json
import math
import os
from pathlib import Path

from hypothesis import example, given, settings, strategies as st
import pytest

from ballbot_ros.cli import main
from ballbot_ros.decision import outcome_log
from ballbot_ros.decision.outcome_lines import line_of, outcome_of
from ballbot_ros.decision.outcome_log import lock, OutcomeLog, read_outcomes
from ballbot_ros.decision.outcomes import Outcome
from ballbot_ros.decision.plan import After, Plan, Strategy
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics import load_robot

DIGEST = load_robot('gimball').digest
PLAN = Plan(Strategy.SWING, 0.2, 0.9, 1.1, 1.5, 1.4, After.STOP, 2.0)
OUTCOME = Outcome(
    stamp=10.0, result='over', face=1, position=1.4, height=0.031, height_sd=0.001,
    touch_speed=0.85, touch_angle=0.3, held_angle=0.7, passed_speed=0.4, slope=0.01, distance=1.1,
    probability=0.93, surface='carpet', robot=DIGEST, plan=PLAN)
OUTCOMES = tuple(replace(OUTCOME, stamp=10.0 * number, plan=plan) for number, plan in (
    (1, PLAN), (2, None), (3, Plan(Strategy.CRUISE, speed=0.5))))
LINES = [line_of(item, 'a') for item in OUTCOMES]


def kept(path, outcomes, robot=DIGEST):
    """Append outcomes, wait for the disk, and return the log."""
    log = OutcomeLog(path, robot)
    for outcome in outcomes:
        log.append(outcome)
    log.close()
    return log


def test_what_is_kept_is_read_again(tmp_path):
    path = tmp_path / 'log'
    assert kept(path, OUTCOMES[:2]).problem == ''
    assert kept(path, OUTCOMES[2:]).reading.outcomes == OUTCOMES[:2]
    assert read_outcomes(path, DIGEST).outcomes == OUTCOMES
    for line in path.read_text().splitlines():
        json.loads(line)


def test_a_cut_at_any_byte_costs_the_last_line_at_most(tmp_path):
    path = tmp_path / 'log'
    whole = b''.join(LINES)
    ends = [sum(map(len, LINES[:number])) for number in range(4)]
    for cut in range(len(whole) + 1):
        path.write_bytes(whole[:cut])
        reading = read_outcomes(path, DIGEST)
        complete = sum(end <= cut for end in ends) - 1
        assert reading.refusal == '' and reading.outcomes == OUTCOMES[:complete]
        assert reading.torn == (cut not in ends)


@pytest.mark.parametrize('tail', [b'', b'\0' * 300, b'\0' * 300 + b'\n', LINES[1][:40],
                                  LINES[1][:40] + b'\n', LINES[1][:-1]])
def test_after_a_cut_the_next_outcome_takes_the_place_of_what_was_cut(tmp_path, tail):
    path = tmp_path / 'log'
    path.write_bytes(LINES[0] + tail)
    assert kept(path, OUTCOMES[2:]).problem == ''
    reading = read_outcomes(path, DIGEST)
    assert reading.outcomes == (OUTCOMES[0], OUTCOMES[2]) and not reading.torn


@settings(max_examples=150, deadline=None)
@given(st.integers(0, len(LINES[0]) + len(LINES[1]) - 2), st.integers(1, 255))
@example(LINES[0].index(b' '), ord(' ') ^ ord('\t'))  # the same content to a reader of JSON
def test_a_line_in_the_middle_that_changed_is_refused(place, change):
    content = bytearray(b''.join(LINES))
    content[place] ^= change
    path = Path(os.environ.get('TMPDIR', '/tmp')) / f'ballbot_log_{os.getpid()}'
    try:
        path.write_bytes(content)
        reading = read_outcomes(path, DIGEST)
        assert reading.outcomes == () and 'line' in reading.refusal
    finally:
        path.unlink()


def forged(**changes):
    """Return a line with other values and the checksum that goes with them."""
    from ballbot_ros.decision.outcome_lines import _checksum
    content = json.loads(LINES[1])
    content.update(changes)
    content['checksum'] = _checksum(content)
    return json.dumps(content).encode() + b'\n'


@pytest.mark.parametrize('changes, words', [
    ({'touch_speed': math.nan}, 'touch_speed'),
    ({'touch_speed': 40.0}, 'at most 10 m/s'),
    ({'height': 1e9}, 'at most 10 m'),
    ({'height_sd': -1.0}, 'height_sd'),
    ({'probability': 1.5}, 'probability'),
    ({'result': 'flew'}, 'one of over, stuck, fell'),
    ({'stamp': 'now'}, 'stamp must be a number'),
    ({'robot': '0123456789abcdef'}, 'of another robot'),
    ({'format': 2}, 'format 2'),
    ({'colour': 'red'}, 'colour'),
    ({'run': 3}, 'names no run'),
    ({'plan': {'strategy': 'cruise'}}, 'its plan must have'),
    ({'plan': [1]}, 'its plan must have'),
])
def test_a_poisoned_or_foreign_line_is_refused_and_nothing_is_added(tmp_path, changes, words):
    path = tmp_path / 'log'
    content = LINES[0] + forged(**changes) + LINES[2]
    path.write_bytes(content)
    log = kept(path, OUTCOMES)
    assert log.reading.outcomes == ()
    assert words in log.problem and 'line 2' in log.problem
    assert path.read_bytes() == content


def test_more_outcomes_than_a_robot_can_have_are_refused(tmp_path):
    path = tmp_path / 'log'
    path.write_bytes(b''.join(line_of(replace(OUTCOME, stamp=1.0 + 1e-4 * number), 'a')
                              for number in range(3000)))
    assert 'line 4' in read_outcomes(path).refusal
    # The same moment of other runs is none: a simulation repeats itself.
    path.write_bytes(b''.join(line_of(OUTCOME, f'{number}') for number in range(100)))
    assert len(read_outcomes(path).outcomes) == 100


def test_a_node_that_has_gone_mad_cannot_fill_the_log(tmp_path):
    path = tmp_path / 'log'
    log = kept(path, [replace(OUTCOME, stamp=1.0 + 1e-3 * number) for number in range(40)])
    assert 'no robot has so many' in log.problem
    assert len(read_outcomes(path, DIGEST).outcomes) == 3


def test_a_log_stays_short_and_keeps_the_newest(tmp_path, monkeypatch):
    monkeypatch.setattr(outcome_log, 'LONGEST', 12 * len(LINES[0]))
    monkeypatch.setattr(outcome_log, 'KEPT', 5)
    path = tmp_path / 'log'
    many = [replace(OUTCOME, stamp=10.0 * number) for number in range(60)]
    assert kept(path, many).problem == ''
    outcomes = read_outcomes(path, DIGEST).outcomes
    assert 5 <= len(outcomes) <= 12
    assert outcomes == tuple(many[-len(outcomes):])
    assert not list(tmp_path.glob('*.new'))


def test_a_file_that_is_no_log_is_not_read_to_its_end(tmp_path, monkeypatch):
    monkeypatch.setattr(outcome_log, 'LONGEST', 1000)
    path = tmp_path / 'log'
    path.write_bytes(LINES[0] * 10)
    assert 'longer than any log' in read_outcomes(path).refusal


def test_a_disk_that_takes_nothing_is_told_and_later_tried_again(tmp_path, monkeypatch):
    path = tmp_path / 'log'
    write, left = os.pwrite, [1]

    def half(file, content, place):
        if left:
            left.pop()
            return write(file, content[:20], place)
        return write(file, content, place)
    monkeypatch.setattr(os, 'pwrite', half)
    log = OutcomeLog(path, DIGEST)
    log.append(OUTCOMES[0])
    while not log.problem:
        pass
    assert os.strerror(errno.ENOSPC) in log.problem
    assert path.read_bytes() == b''
    log.append(OUTCOMES[1])
    log.close()
    assert log.problem == ''
    assert read_outcomes(path, DIGEST).outcomes == (OUTCOMES[1],)


def test_a_folder_that_is_not_there_is_told(tmp_path):
    log = kept(tmp_path / 'no' / 'log', OUTCOMES[:1])
    assert 'No such file' in log.problem
    assert 'cannot be read' in OutcomeLog(tmp_path, DIGEST).problem


def test_two_nodes_do_not_write_to_one_log(tmp_path):
    path = tmp_path / 'log'
    with open(path, 'wb') as other:
        lock(other.fileno())
        assert 'another process' in kept(path, OUTCOMES).problem
    assert path.read_bytes() == b''
    late = OutcomeLog(path, DIGEST)
    kept(path, OUTCOMES[:1])
    late.append(OUTCOMES[1])
    late.close()
    assert 'somebody else' in late.problem
    assert read_outcomes(path, DIGEST).outcomes == OUTCOMES[:1]


numbers = st.floats(-1.0, 1.0) | st.just(math.inf) | st.just(-math.inf)


@settings(max_examples=100, deadline=None)
@given(st.builds(Plan, st.sampled_from(list(Strategy)), *[numbers] * 5,
                 st.sampled_from(list(After)), numbers), st.text(max_size=20))
def test_any_plan_goes_there_and_back(plan, surface):
    outcome = replace(OUTCOME, plan=plan, surface=surface)
    assert outcome_of(line_of(outcome, 'x')[:-1]) == (outcome, 'x')
    assert line_of(outcome, 'x').count(b'\n') == 1


def test_the_command_lists_exports_and_resets(tmp_path, capsys):
    path = tmp_path / 'log'
    kept(path, OUTCOMES)
    assert main(['outcomes', 'list', str(path)]) == 0
    said = capsys.readouterr().out
    assert '3 outcomes, 3 of them over' in said
    assert said.splitlines()[1].split() == [
        '10.00', 's', 'over', '31.0', 'mm', '0.85', 'm/s', '0.40', 'm/s', '0.93', 'swing']
    assert main(['outcomes', 'export', str(path)]) == 0
    first = capsys.readouterr().out.splitlines()
    assert len(first) == 4 and first[0].startswith('stamp,result,face')
    assert main(['outcomes', 'export', str(path), '--out', str(tmp_path / 'o.json')]) == 0
    exported = json.loads((tmp_path / 'o.json').read_text())
    assert exported[0]['touch_speed'] == 0.85 and exported[0]['plan.strategy'] == 'swing'
    assert exported[2]['plan.stop_position'] == 'inf'
    content = path.read_bytes()
    for number in (1, 2):
        assert main(['outcomes', 'reset', str(path)]) == 0
        assert not path.exists()
        assert (tmp_path / f'log.{number}').read_bytes() == content
        path.write_bytes(content)


@pytest.mark.parametrize('words, refusal', [
    (['list'], 'needs a FILE'), (['list', 'nowhere'], 'does not exist'),
    (['export', '{log}', '--out', 'x.txt'], 'must end in .csv or .json'),
    (['learned', '{log}', '--robot', 'shellball'], 'of another robot'),
    (['list', '{bad}'], 'line 1: it is damaged'),
    (['show-learning', '--robots', '0'], 'at least 1')])
def test_the_command_refuses(tmp_path, capsys, words, refusal):
    (tmp_path / 'log').write_bytes(b''.join(LINES))
    (tmp_path / 'bad').write_bytes(b'{}\n' + LINES[0])
    places = {'{log}': str(tmp_path / 'log'), '{bad}': str(tmp_path / 'bad')}
    assert main(['outcomes', *(places.get(word, word) for word in words)]) == 2
    assert refusal in capsys.readouterr().err


def test_a_log_that_a_node_writes_to_is_not_reset(tmp_path, capsys):
    path = tmp_path / 'log'
    path.write_bytes(b''.join(LINES))
    with open(path, 'rb') as other:
        lock(other.fileno())
        assert main(['outcomes', 'reset', str(path)]) == 2
    assert 'stop obstacle_decision first' in capsys.readouterr().err and path.exists()


def test_a_number_that_is_none_makes_no_outcome():
    with pytest.raises(ConfigurationError, match='touch_speed'):
        replace(OUTCOME, touch_speed=math.nan)
