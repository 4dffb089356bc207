# SPDX-License-Identifier: Apache-2.0
"""A demo whose bag has gaps says so, with the topic."""
import pytest
import yaml

from ballbot_ros.bags.writer import gaps, verdict

RATES = {'joint_states': 500.0, 'odom': 100.0}
MS = 10**6


def recorded(end):
    """Return all stamps up to a time [ms]."""
    return {'joint_states': [MS * stamp for stamp in range(0, end + 1, 2)],
            'odom': [MS * stamp for stamp in range(0, end + 1, 10)], 'set_point': []}


def test_what_is_there_is_complete_however_often_it_was_repeated():
    found = recorded(100)
    found['odom'] += [0, 10 * MS]
    assert gaps(found, RATES, 100 * MS) == []
    assert gaps(found, RATES, 100 * MS - 1) == []


@pytest.mark.parametrize('missing', [0, 44, 100])
def test_one_message_that_is_missing_is_reported_with_topic_and_time(missing):
    found = recorded(100)
    found['joint_states'].remove(missing * MS)
    assert gaps(found, RATES, 100 * MS) == [
        f'bag: joint_states lacks 1 of 51 messages, the first of t = {missing / 1e3:.3f} s']


def test_a_topic_that_never_came_lacks_all_of_it():
    found = recorded(100)
    del found['odom']
    sentence, = gaps(found, RATES, 100 * MS)
    assert sentence.startswith('bag: odom lacks 11 of 11 messages')


def test_what_was_recorded_and_is_not_in_the_file_is_reported(tmp_path):
    found = recorded(100)
    lost = 'bag: 62 messages were recorded and 61 are in the file'
    for count, wrong in ((62, []), (61, [lost])):
        (tmp_path / 'metadata.yaml').write_text(yaml.safe_dump(
            {'rosbag2_bagfile_information': {'message_count': count}}))
        assert verdict(tmp_path, found, RATES, 100 * MS) == (wrong, count)
