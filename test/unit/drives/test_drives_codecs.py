# SPDX-License-Identifier: Apache-2.0
"""Golden frames of the makers, and no data without a valid checksum is used."""
import re

from hypothesis import given, strategies as st
import pytest

from ballbot_ros.drives import codec_of
from ballbot_ros.drives.contract import bit_names
from ballbot_ros.drives.odrive.ascii import codec as odrive
from ballbot_ros.drives.roboclaw import codec as roboclaw
from ballbot_ros.drives.vesc.uart import codec as vesc

VALUES = vesc.Values(35.2, 30.1, -3.45, 1.25, -4210.0, 23.9, -123456, 0, 271.123456, 0)
ANSWERS = [roboclaw.Reply(16, (-123456, 1)), roboclaw.Reply(30, (-4321, 1))]
GROUP = (16, 30)


def parser_of(protocol):
    """Return a new parser; that of a RoboClaw expects encoder and speed, also after a status."""
    if protocol != 'roboclaw':
        return codec_of(protocol).parser()
    parser = roboclaw.ReplyParser(0x80)
    parser.groups = (GROUP, (roboclaw.GET_STATUS, *GROUP))
    return parser


def feed(protocol, data):
    """Return the messages of a new parser for these bytes."""
    return parser_of(protocol).feed(data)


# A reply of the drive, and its content.
REPLIES = {
    'odrive': (odrive.frame_reply('-12.345678 9.876543'), ['-12.345678 9.876543']),
    'vesc': (vesc.frame(vesc.pack_values(VALUES)), [vesc.pack_values(VALUES)]),
    'roboclaw': (roboclaw.frame_reply(ANSWERS), [ANSWERS]),
}
each_protocol = pytest.mark.parametrize('protocol', sorted(REPLIES))


# Golden frames

def test_odrive_checksum_is_that_of_the_documented_example():
    # docs/ascii-protocol.rst: "Example of a valid checksum: r vbus_voltage *93"
    assert odrive.read('vbus_voltage') == b'r vbus_voltage *93\n'


def test_odrive_commands_have_the_documented_form():
    assert odrive.torque(0, 12.5).startswith(b'c 0 0.001250000e4 *')
    assert odrive.feedback(1).startswith(b'f 1 *')
    assert odrive.feed_watchdog(0).startswith(b'u 0 *')
    assert odrive.write('axis0.requested_state', 8).startswith(b'w axis0.requested_state 8 *')


@pytest.mark.parametrize('packet, golden', [
    # From PyVESC 1.0.5: encode(SetCurrent(1500)), encode(SetCurrent(-2345)),
    # encode_request(GetValues); and the shortest possible packet, from comm/packet.c.
    (vesc.frame(vesc.set_current(1.5)), '020506000005dc388103'),
    (vesc.frame(vesc.set_current(-2.345)), '020506fffff6d74bb803'),
    (vesc.frame(bytes((vesc.GET_VALUES,))), '020104408403'),
    (vesc.frame(bytes((vesc.FW_VERSION,))), '020100000003'),
])
def test_vesc_packets_are_those_of_an_independent_implementation(packet, golden):
    assert packet.hex() == golden


@pytest.mark.parametrize('packet, golden', [
    # From basicmicro 2.0.10 with its port replaced: DutyM1(0x80, 16384), DutyM1(0x80, -32767),
    # DutyM2(0x81, 1), SetTimeout(0x80, 0.1), ReadEncM1(0x80).
    (roboclaw.set_duty(0x80, 0, 16384 / 32767), '802040005632'),
    (roboclaw.set_duty(0x80, 0, -1.0), '802080015047'),
    (roboclaw.set_duty(0x81, 1, 1 / 32767), '812100010a5b'),
    (roboclaw.command(0x80, 14, b'\x01'), '800e010874'),
    (roboclaw.ask(0x80, 16), '8010'),
])
def test_roboclaw_packets_are_those_of_an_independent_implementation(packet, golden):
    assert packet.hex() == golden


def test_crc_is_xmodem():
    # The check value of CRC-16/XMODEM in the catalogue of CRC algorithms.
    assert vesc.frame(b'123456789')[-3:-1].hex() == '31c3'
    assert roboclaw.command(0x31, 0x32, b'3456789')[-2:].hex() == '31c3'


# Replies

@each_protocol
def test_a_reply_is_understood_however_it_is_cut_up(protocol):
    reply, meaning = REPLIES[protocol]
    assert feed(protocol, reply) == meaning
    parser = parser_of(protocol)
    assert [message for byte in reply for message in parser.feed(bytes((byte,)))] == meaning


@each_protocol
def test_every_single_bit_error_is_refused(protocol):
    reply, _ = REPLIES[protocol]
    for bit in range(8 * len(reply)):
        damaged = bytearray(reply)
        damaged[bit // 8] ^= 1 << bit % 8
        assert feed(protocol, bytes(damaged)) == [], f'bit {bit}'


@each_protocol
def test_a_good_reply_is_found_behind_any_single_bit_error(protocol):
    reply, meaning = REPLIES[protocol]
    for bit in range(8 * len(reply)):
        damaged = bytearray(reply)
        damaged[bit // 8] ^= 1 << bit % 8
        # A corrupted, larger length consumes some of the next replies, then all are found.
        found = feed(protocol, bytes(damaged) + 20 * reply)
        assert found[-1:] == meaning and len(found) >= 10
        assert all(message == meaning[0] for message in found)


@each_protocol
def test_every_lost_byte_costs_that_reply_only(protocol):
    reply, meaning = REPLIES[protocol]
    for place in range(len(reply)):
        found = feed(protocol, reply[:place] + reply[place + 1:] + 10 * reply)
        assert found[-8:] == 8 * meaning
        assert all(message == meaning[0] for message in found)


@each_protocol
@given(noise=st.binary(max_size=300), cuts=st.lists(st.integers(1, 40), max_size=20))
def test_noise_is_not_decoded_and_does_not_hide_what_follows(protocol, noise, cuts):
    reply, meaning = REPLIES[protocol]
    assert feed(protocol, noise) == []
    stream = noise + b'\r\n' + 60 * reply  # noise may consume a line, or the length of a packet
    parser = parser_of(protocol)
    found = []
    for cut in (*cuts, len(stream)):
        piece, stream = stream[:cut], stream[cut:]
        found += parser.feed(piece)
    assert found[-10:] == 10 * meaning


@each_protocol
def test_a_parser_keeps_no_more_than_a_message(protocol):
    parser = parser_of(protocol)
    for value in (0, 2, 3, 42, 255):
        for _ in range(5):
            parser.feed(bytes((value,)) * 1000)
    kept = parser._rest if protocol == 'odrive' else parser._buffer
    assert len(kept) < 1000


@each_protocol
@given(data=st.binary(min_size=1, max_size=80))
def test_a_valid_frame_is_made_of_any_bytes_and_read_back(protocol, data):
    codec = codec_of(protocol)
    printable = b'x' + bytes(0x20 | byte & 0x0F for byte in data if byte & 0x0F != 10)[:40]
    frame = codec.reply_of(printable)
    message, = codec.parser().feed(frame)
    assert codec.frame_reply(message) == frame
    if protocol != 'roboclaw':  # its answers are numbers
        assert message in (printable, printable.decode())
    assert len(codec.parser().feed(codec.reply_of(b'x*\r\n' + printable))) == 1


# Weaknesses of the ODrive protocol

@pytest.mark.parametrize('text', [
    '', '1', '1.0 2.0', '1.000000', '1.000000 2.000000 3.000000', '1.000000  2.000000',
    'nan 0.000000', '1.000000 inf', '1e3 0.000000', '+1.000000 0.000000', '1.000000 2.00000'])
def test_only_exactly_two_numbers_are_feedback(text):
    assert odrive.parse_feedback(text) is None


@pytest.mark.parametrize('text', ['', '-', '1 2', 'nan', '1e5', '0x10', '1.0000000', 'invalid'])
def test_only_a_plain_number_is_a_value(text):
    assert odrive.parse_number(text) is None


def test_a_line_without_checksum_is_not_a_reply():
    parser = odrive.LineParser()
    assert parser.feed(b'1.000000 2.000000\r\nunknown command\r\n') == []
    assert parser.counts == {'unchecked': 2, 'refused': 0}


def test_the_part_of_a_line_after_a_stray_newline_is_not_a_line():
    # Six characters whose exclusive or is 0 are cut off: the checksum of the rest remains valid.
    rest = odrive.frame_reply('1.000000 2.000000')
    assert odrive.checksum(b'1221\n\n') == 0
    assert feed('odrive', b'1221\n\n' + rest) == []


@given(torque=st.floats(-100.0, 100.0))
def test_a_torque_that_is_cut_short_is_next_to_nothing(torque):
    number = odrive.torque(0, torque).split()[2].decode()
    assert float(number) == pytest.approx(torque, abs=5.1e-6)
    for end in range(1, len(number)):
        short = re.match(r'-?[0-9]+\.?[0-9]*', number[:end])  # the part that sscanf reads
        assert short is None or abs(float(short[0])) <= 1.001e-4 * abs(float(number)) + 1e-9


# VESC

@pytest.mark.parametrize('length', [1, 255, 256, 512])
def test_vesc_payloads_of_every_length_come_back(length):
    payload = bytes(number % 251 for number in range(length))
    packet = vesc.frame(payload)
    assert packet[0] == (2 if length <= 255 else 3)
    assert feed('vesc', packet) == [payload]


@pytest.mark.parametrize('length', [0, 513])
def test_vesc_payloads_that_the_firmware_does_not_take_are_refused(length):
    with pytest.raises(ValueError, match=str(length)):
        vesc.frame(bytes(length))


def test_vesc_values_of_another_mask_are_not_taken_for_ours():
    payload = bytearray(vesc.pack_values(VALUES))
    assert vesc.parse_values(bytes(payload)) == pytest.approx(VALUES)
    payload[4] ^= 1
    assert vesc.parse_values(bytes(payload)) is None


# RoboClaw

def test_roboclaw_answers_to_another_question_are_not_taken_for_ours():
    wrong = roboclaw.answer(0x80, 17, -123456, 1) + roboclaw.answer(0x80, 31, -4321, 1)
    assert feed('roboclaw', wrong) == []
    other = roboclaw.answer(0x81, 16, -123456, 1) + roboclaw.answer(0x81, 30, -4321, 1)
    assert feed('roboclaw', other) == []


def test_a_single_roboclaw_answer_is_not_used():
    assert feed('roboclaw', roboclaw.answer(0x80, 16, 5, 0) + bytes(100)) == []


def test_acknowledgements_between_roboclaw_answers_are_passed_over():
    reply, meaning = REPLIES['roboclaw']
    assert feed('roboclaw', b'\xff' + reply + b'\xff' + reply) == 2 * meaning


def test_a_roboclaw_version_is_text():
    parser = roboclaw.ReplyParser(0x80)
    parser.groups = ((21, 90),)
    found = parser.feed(roboclaw.answer(0x80, 21, text='USB Roboclaw 2x30a v4.2.8\n')
                        + roboclaw.answer(0x80, 90, 0))
    assert found == [[roboclaw.Reply(21, (), 'USB Roboclaw 2x30a v4.2.8\n'),
                      roboclaw.Reply(90, (0,))]]


def test_error_bits_have_the_names_of_the_makers():
    assert bit_names(0x10001, roboclaw.STATUS) == ('E_STOP', 'M1_OVER_CURRENT_WARNING')
    assert bit_names(0x80000001, roboclaw.STATUS) == ('E_STOP', '0x80000000')
