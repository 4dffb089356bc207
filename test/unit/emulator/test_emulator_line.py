# SPDX-License-Identifier: Apache-2.0
"""Bytes take time on the line, and faults affect the given fraction of them."""
import random

import pytest
from refusals import refused

from ballbot_ros.emulator.line import Direction, LineFaults


def line(baud=115200, **faults):
    """Return a line with faults."""
    made = Direction(baud, random.Random(1))
    made.faults = LineFaults(**faults)
    return made


def test_a_byte_takes_ten_bits():
    slow = line(baud=9600)
    slow.put(b'abc', now=1.0)
    assert slow.take(1.0 + 0.99 * 10 / 9600) == b''
    assert slow.take(1.0 + 1.01 * 10 / 9600) == b'a'
    assert slow.take(1.0 + 3.01 * 10 / 9600) == b'bc'


def test_bytes_wait_for_those_before_them():
    slow = line(baud=1000)
    slow.put(b'ab', now=0.0)
    slow.put(b'c', now=0.001)
    assert slow.take(0.0299) == b'ab' and slow.next_at() == pytest.approx(0.03)
    assert slow.take(0.0301) == b'c' and slow.next_at() == float('inf')


def test_a_delay_is_added_to_every_byte():
    late = line(baud=1000, delay=0.5)
    late.put(b'a', now=0.0)
    assert late.take(0.5) == b'' and late.take(0.511) == b'a'


@pytest.mark.parametrize('name, length', [('drop', 9000), ('duplicate', 11000)])
def test_a_tenth_of_the_bytes_is_dropped_or_doubled(name, length):
    bad = line(**{name: 0.1})
    bad.put(bytes(10_000), now=0.0)
    assert len(bad.take(10.0)) == pytest.approx(length, abs=150)


def test_a_corrupted_byte_is_always_another_one():
    bad = line(corrupt=0.1)
    bad.put(bytes(10_000), now=0.0)
    arrived = bad.take(10.0)
    assert len(arrived) == 10_000
    assert sum(byte != 0 for byte in arrived) == pytest.approx(1000, abs=150)


def test_garbage_arrives_unrequested_at_its_rate():
    bad = line(garbage=5000.0)
    bad.take(0.0)
    assert sum(len(bad.take(0.01 * tick)) for tick in range(1, 101)) == pytest.approx(
        5000, abs=100)


def test_garbage_takes_its_time_and_the_delay_like_other_bytes():
    bad = line(baud=1000, garbage=1e6, delay=0.5)
    bad.put(b'a', now=0.0)
    assert bad.take(0.1) == b''
    assert bad.take(0.505) == b''
    arrived = bad.take(0.7)
    assert arrived.startswith(b'a') and 5 < len(arrived) <= 20


def test_garbage_leaves_room_for_other_bytes():
    bad = line(baud=1000, garbage=1e6)
    for tick in range(1, 101):
        bad.take(0.01 * tick)
    bad.put(b'a', now=1.0)
    assert bad.take(1.011).endswith(b'a')


def test_another_baud_rate_turns_text_into_no_text():
    bad = line()
    bad.garbled = True
    bad.put(b'f 0 *86\n', now=0.0)
    arrived = bad.take(1.0)
    assert len(arrived) == 8 and all(byte >= 0x80 for byte in arrived)


def test_impossible_trouble_is_refused():
    with refused('out_of_range', 'drop'):
        LineFaults(drop=1.5)
