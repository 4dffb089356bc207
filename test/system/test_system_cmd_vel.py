# SPDX-License-Identifier: Apache-2.0
"""Speeds on cmd_vel on a slope: tracked, stopped, and reported if the slope is too steep."""
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
import pytest

from ballbot_ros.ros import diagnostics

SECOND = 500  # control periods


def scene(folder, slope):
    """Return the file of a scene: a ball at rest in the middle of a slope [degrees]."""
    path = folder / 'slope.yaml'
    path.write_text(f'robot: gimball\nduration: 1.0\ninitial: {{x: 20.0}}\nterrain:\n'
                    f'  - slope: {{length: 40.0, angle_deg: {slope}}}\n')
    return path


@pytest.fixture
def on_slope(graph, tmp_path):
    """Return a function that starts simulator and controller on a slope; time is stepped."""
    def start(slope):
        moved = graph.subscribe('odom', Odometry)
        graph.start('controller', set_point_timeout=0.0)
        graph.start('simulator', scene=scene(tmp_path, slope), lockstep=True, start_paused=True,
                    real_time_factor=0.0)
        graph.wait_until_connected(moved)
        return moved
    return start


def command_speed(graph, speed, seconds, moved):
    """Command a speed, advance time, and return the speeds since the command [m/s]."""
    twist = TwistStamped()
    twist.twist.linear.x = speed
    graph.publish_until(
        lambda: graph.values('controller').get('set_value') == f'{speed:.4f}'
        and graph.values('controller')['mode'] == 'speed',
        'the controller accepts the speed', 'cmd_vel', twist)
    before = len(moved)
    graph.step(round(seconds * SECOND))
    graph.wait(lambda: len(moved) >= before + round(seconds * 100), 'odometry arrives')
    return [message.twist.twist.linear.x for message in moved[before:]]


def test_a_speed_settles_within_3_s_on_a_slope_and_0_stops_the_ball(graph, on_slope):
    moved = on_slope(-2.0)
    command_speed(graph, 0.0, 1.0, moved)  # the controller estimates the slope
    speeds = command_speed(graph, 0.3, 3.0, moved)
    assert max(speeds) < 0.315 and min(speeds[-50:]) > 0.285
    speeds = command_speed(graph, 0.0, 2.5, moved)
    # On a slope the contact of a ball at rest creeps, by less than this.
    assert min(speeds) > -0.005 and max(speeds[-50:]) < 0.005
    # Without steps, the controller would report missing joint states.
    graph.wait(lambda: graph.step(2) and getattr(
        graph.statuses.get('controller'), 'message', '') == 'running', 'no problem is reported')


def test_a_slope_that_is_too_steep_is_reported(graph, on_slope):
    moved = on_slope(7.0)
    command_speed(graph, 0.0, 2.5, moved)
    graph.wait_for_log('controller', 'resistance of a slope of')
    # Without steps, the controller would report missing joint states.
    graph.wait(lambda: graph.step(2) and 'resistance exceeds' in getattr(
        graph.statuses.get('controller'), 'message', ''), 'the controller reports it')
    assert graph.statuses['controller'].level == diagnostics.WARN
