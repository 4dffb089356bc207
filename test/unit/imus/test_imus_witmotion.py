# SPDX-License-Identifier: Apache-2.0
"""The example bytes of the maker, and no reading without a valid packet."""
from hypothesis import given, strategies as some
import pytest
from refusals import refused

from ballbot_ros.imus.witmotion.protocol import (
    FORCE, FORCE_COUNT, packet, PacketParser, RATE_COUNT, TURN_RATE, WitMotion)

counts = some.tuples(*[some.integers(-32768, 32767)] * 3)
ANGLES = 0x53


def reading(force=(0, 0, 2048), rate=(100, -200, 300)):
    """Return the packets of a reading."""
    return packet(FORCE, force) + packet(TURN_RATE, rate)


def synchronized_parser():
    """Return a parser synchronized by one packet."""
    parser = PacketParser()
    parser.feed(packet(ANGLES, (0, 0, 0)))
    return parser


def test_a_packet_matches_the_data_sheet():
    # 1 g along z at 25 degrees: 2048 counts, low byte first.
    body = bytes.fromhex('55 51 00 00 00 00 00 08 c4 09')
    assert packet(FORCE, (0, 0, 2048), 2500) == body + bytes((sum(body) % 256,))
    assert packet(TURN_RATE, (-1, 0, 0))[2:4] == b'\xff\xff'


def test_full_scale_is_sixteen_g_and_two_thousand_degrees_per_second():
    found, = synchronized_parser().feed(reading((0, -16384, 2048), (0, 16384, 0)))
    assert found.force == pytest.approx((0.0, -8.0 * 9.80665, 9.80665))
    assert found.turn_rate == pytest.approx((0.0, 17.4532925, 0.0))
    assert not found.saturated


@given(counts, counts)
def test_a_reading_is_decoded_as_sent(force, rate):
    found, = synchronized_parser().feed(reading(force, rate))
    assert found.force == tuple(value * FORCE_COUNT for value in force)
    assert found.turn_rate == tuple(value * RATE_COUNT for value in rate)
    assert found.saturated == (max(map(abs, (*force, *rate))) >= 32767)


@given(some.lists(some.tuples(counts, counts), min_size=1, max_size=8),
       some.lists(some.integers(1, 30), min_size=1))
def test_readings_do_not_depend_on_the_split_of_the_bytes(readings, sizes):
    data, parser, found = b''.join(reading(*item) for item in readings), synchronized_parser(), []
    while data:
        size = sizes[len(data) % len(sizes)]
        found += parser.feed(data[:size])
        data = data[size:]
    assert len(found) == len(readings) == parser.counts['readings']


@given(some.binary(max_size=200), some.lists(some.tuples(counts, counts), max_size=4),
       some.binary(max_size=200))
def test_all_decoded_readings_are_in_the_bytes(noise, readings, more):
    data = noise + b''.join(reading(*item) for item in readings) + more
    parser = PacketParser()
    for found in parser.feed(data):
        force = tuple(round(value / FORCE_COUNT) for value in found.force)
        rate = tuple(round(value / RATE_COUNT) for value in found.turn_rate)
        # A packet also contains a temperature: only the bytes of the counts are compared.
        assert packet(FORCE, force)[:8] in data and packet(TURN_RATE, rate)[:8] in data


@pytest.mark.parametrize('position', range(22))
@pytest.mark.parametrize('bit', (0, 3, 7))
def test_a_flipped_bit_loses_its_reading_only(position, bit):
    good, parser = reading(), synchronized_parser()
    bad = bytearray(good)
    bad[position] ^= 1 << bit
    found = parser.feed(bytes(bad) + 4 * good)
    assert set(found) == set(synchronized_parser().feed(good))
    assert 3 <= len(found) <= 4


def test_the_first_packet_after_noise_is_not_used():
    parser = PacketParser()
    assert not parser.feed(b'\x00' + reading())
    assert len(parser.feed(reading())) == 1
    assert parser.counts['skipped'] == 1 and parser.counts['unpaired'] == 1


def test_unpaired_forces_and_turn_rates_are_counted():
    parser = synchronized_parser()
    assert not parser.feed(packet(TURN_RATE, (1, 2, 3)))
    assert len(parser.feed(packet(FORCE, (1, 2, 3)) + reading())) == 1
    assert parser.counts['unpaired'] == 2


def test_other_packets_within_a_reading_are_ignored():
    data = packet(FORCE, (1, 2, 3)) + packet(ANGLES, (4, 5, 6)) + packet(TURN_RATE, (7, 8, 9))
    assert len(synchronized_parser().feed(data)) == 1


def test_settings_match_the_table_of_the_maker():
    sensor = WitMotion(115200, 200, 98)
    assert sensor.configure(115200) == [bytes.fromhex(text) for text in (
        'ff aa 69 88 b5', 'ff aa 02 06 00', 'ff aa 03 0b 00', 'ff aa 1f 02 00')]
    assert sensor.change_baud()[-1] == bytes.fromhex('ff aa 04 06 00')


@pytest.mark.parametrize('rate, register', [
    (10, 0x06), (20, 0x07), (50, 0x08), (100, 0x09), (200, 0x0B)])
def test_each_rate_has_its_register_value(rate, register):
    assert WitMotion(115200, rate, 98).configure(115200)[2][3] == register


@pytest.mark.parametrize('arguments, reason, field', [
    ((115200, 250, 98), 'not_a_choice', 'rate'), ((115200, 200, 100), 'not_a_choice', 'bandwidth'),
    ((921600, 200, 98), 'not_a_choice', 'baud'), ((38400, 200, 98), 'inconsistent', 'baud')])
def test_unsupported_settings_are_refused(arguments, reason, field):
    with refused(reason, field):
        WitMotion(*arguments)


def test_at_the_baud_rate_of_the_factory_the_lowest_rate_is_configured():
    sensor = WitMotion(115200, 200, 98)
    assert 200 * sensor.reading_bits == 44000 > sensor.factory_baud
    assert sensor.configure(sensor.factory_baud)[2] == bytes.fromhex('ff aa 03 06 00')
