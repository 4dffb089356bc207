# SPDX-License-Identifier: Apache-2.0
"""Check that a bag holds all messages that its run has published."""
from pathlib import Path
from typing import List, Mapping, Sequence, Tuple

import yaml

from ballbot_ros.ros.odometry import TFMessage

NANOSECONDS = 10**9


def also_recorded() -> Tuple[str, ...]:
    """Return the topics that tools which open a bag look for, where their types are installed."""
    found = ('/clock', '/diagnostics', 'robot_description', 'markers')
    return found if TFMessage is None else (*found, '/tf', '/tf_static')


def gaps(recorded: Mapping[str, Sequence[int]], rates: Mapping[str, float], end: int
         ) -> List[str]:
    """
    Return a sentence for each topic of which messages are missing.

    Parameters
    ----------
    recorded : mapping of str to sequence of int
        Stamps by topic [ns]; those of messages that were repeated count once.
    rates : mapping of str to float
        How often each of these topics must have been published, from 0 on [Hz].
    end : int
        Stamp up to which it must be complete [ns].

    """
    found = []
    for topic, rate in rates.items():
        wanted = range(0, end + 1, round(NANOSECONDS / rate))
        missing = sorted(set(wanted).difference(recorded.get(topic, ())))
        if missing:
            found.append(f'bag: {topic} lacks {len(missing)} of {len(wanted)} messages, the first '
                         f'of t = {missing[0] / NANOSECONDS:.3f} s')
    return found


def counted(bag: Path) -> int:
    """Return the number of messages from the metadata of a bag."""
    with open(bag / 'metadata.yaml', encoding='utf-8') as file:
        count: int = yaml.safe_load(file)['rosbag2_bagfile_information']['message_count']
    return count


def verdict(bag: Path, recorded: Mapping[str, Sequence[int]], rates: Mapping[str, float],
            end: int) -> Tuple[List[str], int]:
    """Return the gaps in a closed bag, and its number of messages; see `gaps`."""
    found, written = gaps(recorded, rates, end), sum(map(len, recorded.values()))
    count = counted(bag)
    if count != written:
        found.append(f'bag: {written} messages were recorded and {count} are in the file')
    return found, count
