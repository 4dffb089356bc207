# SPDX-License-Identifier: Apache-2.0
"""A demo reports gaps in its bag with their topic."""
import pytest
import yaml

from ballbot_ros.demo import demo

RATES = {'joint_states': 500.0, 'odom': 100.0}
MS = 10**6


@pytest.fixture
def recorded():
    """Return all stamps up to 100 ms."""
    return {'joint_states': [MS * stamp for stamp in range(0, 101, 2)],
            'odom': [MS * stamp for stamp in range(0, 101, 10)]}


def gaps(folder, recorded, lost=0):
    """Return the gaps in a bag that holds all recorded messages, less the lost ones."""
    count = sum(map(len, recorded.values())) - lost
    (folder / 'metadata.yaml').write_text(yaml.safe_dump(
        {'rosbag2_bagfile_information': {'message_count': count}}))
    found, number = demo.gaps(folder, recorded, RATES, 100 * MS)
    assert number == count
    return found


def test_repeated_messages_are_not_a_gap(recorded, tmp_path):
    recorded['odom'] += [0, 10 * MS]
    assert gaps(tmp_path, recorded) == []


@pytest.mark.parametrize('missing', [0, 44, 100])
def test_a_missing_message_is_reported_with_topic_and_time(missing, recorded, tmp_path):
    recorded['joint_states'].remove(missing * MS)
    found, = gaps(tmp_path, recorded)
    assert 'joint_states' in found and f't = {missing / 1e3:.3f} s' in found


def test_all_messages_of_a_missing_topic_are_reported(recorded, tmp_path):
    del recorded['odom']
    found, = gaps(tmp_path, recorded)
    assert 'odom' in found and '11 of 11' in found


def test_a_message_that_is_not_in_the_file_is_reported(recorded, tmp_path):
    found, = gaps(tmp_path, recorded, lost=1)
    assert '62' in found and '61' in found
