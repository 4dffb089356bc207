# SPDX-License-Identifier: Apache-2.0
"""Two robots in one graph: separated by namespace and frames, with one clock."""
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock

from ballbot_ros.ros.conversions import to_seconds


def test_two_robots_share_a_clock_and_differ_in_namespace_and_frames(graph):
    moved = {name: graph.subscribe(f'/{name}/odom', Odometry) for name in 'ab'}
    clocks = graph.subscribe('/clock', Clock)
    for name in 'ba':  # the robot that follows the clock starts first, and waits
        graph.processes.start('simulator', {
            'scene': 'flat', 'publish_clock': name == 'a', 'frame_prefix': f'{name}/',
            'control': 'onboard'}, ('--ros-args', '-r', f'__ns:=/{name}'), label=name)
    graph.wait(lambda: all(len(found) > 30 for found in moved.values()), 'both publish')
    assert graph.node.count_publishers('/clock') == 1
    for name, found in moved.items():
        assert {one.header.frame_id for one in found} == {f'{name}/odom'}
    # The second uses the clock of the first, independent of its own start.
    newest = to_seconds(moved['b'][-1].header.stamp)
    graph.wait(lambda: to_seconds(clocks[-1].clock) >= newest, 'the clock is not behind it')
    assert abs(newest - to_seconds(moved['a'][-1].header.stamp)) < 1.0
    assert 'its time jumps' not in graph.log('b')
