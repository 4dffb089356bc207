# SPDX-License-Identifier: Apache-2.0
"""Only one sender at a time has command authority."""
from ballbot_ros.control import Authority
from ballbot_ros.errors import MessageError


def refused(authority, sender, now):
    """Return whether a message is refused."""
    try:
        authority.check(sender, now)
    except MessageError as error:
        assert error.reason == 'other_sender'
        return True
    return False


def test_only_the_first_sender_has_authority():
    authority = Authority(0.1)
    for number in range(100):
        now = 0.01 * number
        assert not refused(authority, 'controller', now)
        assert refused(authority, 'teleop', now + 0.005)
    assert authority.holder == 'controller'


def test_authority_passes_on_only_after_a_timeout_of_its_holder():
    authority = Authority(0.1)
    authority.check('controller', 1.0)
    assert refused(authority, 'teleop', 1.05) and refused(authority, 'teleop', 1.0999)
    assert not refused(authority, 'teleop', 1.1001)
    assert refused(authority, 'controller', 1.15)


def test_a_contest_is_reported_for_one_second():
    authority = Authority(0.1)
    authority.check('controller', 1.0)
    assert not authority.contested(1.0) and authority.contest == ''
    assert refused(authority, 'teleop', 1.05)
    assert authority.contested(2.0) and not authority.contested(2.1)
    assert authority.contest == 'teleop commands, but controller has authority'


def test_a_backward_clock_jump_gives_authority_to_the_next_sender():
    authority = Authority(0.1)
    authority.check('controller', 1000.0)
    assert not refused(authority, 'teleop', 1.0)


def test_an_unnamed_sender_commands_only_without_a_holder_and_gets_no_authority():
    authority = Authority(0.1)
    assert not refused(authority, '', 1.0) and authority.holder is None
    authority.check('controller', 1.0)
    assert refused(authority, '', 1.05) and not refused(authority, '', 1.2)
    assert not refused(authority, 'teleop', 1.2)
