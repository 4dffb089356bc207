# SPDX-License-Identifier: Apache-2.0
"""One sender at a time commands."""
import math

import pytest

from ballbot_ros.control import Authority
from ballbot_ros.errors import ConfigurationError, MessageError


def refused(authority, sender, now):
    """Return whether a message is refused."""
    try:
        authority.check(sender, now)
    except MessageError as error:
        assert error.reason == 'other_sender'
        return True
    return False


def test_the_first_one_commands_and_another_does_not():
    authority = Authority(0.1)
    for number in range(100):
        now = 0.01 * number
        assert not refused(authority, 'controller', now)
        assert refused(authority, 'teleop', now + 0.005)
    assert authority.holder == 'controller'


def test_authority_passes_on_after_a_silence_of_the_one_that_has_it_and_not_of_the_other():
    authority = Authority(0.1)
    authority.check('controller', 1.0)
    assert refused(authority, 'teleop', 1.05) and refused(authority, 'teleop', 1.0999)
    assert not refused(authority, 'teleop', 1.1001)
    assert refused(authority, 'controller', 1.15)


def test_a_contest_is_reported_for_a_while():
    authority = Authority(0.1)
    authority.check('controller', 1.0)
    assert not authority.contested(1.0) and authority.contest == ''
    assert refused(authority, 'teleop', 1.05)
    assert authority.contested(2.0) and not authority.contested(2.1)
    assert authority.contest == 'teleop commands, but controller has authority'


def test_a_clock_that_was_set_back_gives_authority_to_the_next():
    authority = Authority(0.1)
    authority.check('controller', 1000.0)
    assert not refused(authority, 'teleop', 1.0)


def test_an_unknown_one_is_followed_only_where_no_other_commands_and_gets_no_authority():
    authority = Authority(0.1)
    assert not refused(authority, '', 1.0) and authority.holder is None
    authority.check('controller', 1.0)
    assert refused(authority, '', 1.05) and not refused(authority, '', 1.2)
    assert not refused(authority, 'teleop', 1.2)


@pytest.mark.parametrize('timeout', [0.0, -1.0, math.nan, math.inf])
def test_a_timeout_that_is_none_is_refused(timeout):
    with pytest.raises(ConfigurationError):
        Authority(timeout)
