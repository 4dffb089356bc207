# SPDX-License-Identifier: Apache-2.0
"""Pause, resume, step and reset in each mode of simulated time."""
from nav_msgs.msg import Odometry
import pytest

from ballbot_ros.msg import BallState
from ballbot_ros.ros import diagnostics
from ballbot_ros.ros.conversions import to_seconds

WAYS = {
    'real time': {'real_time_factor': 1.0},
    'as fast as it goes': {'real_time_factor': 0.0},
    'lockstep': {'real_time_factor': 0.0, 'lockstep': True},
    'lockstep in real time': {'real_time_factor': 1.0, 'lockstep': True},
}
# A ball that rolls from the start, so that a reset is visible.
ROLLING = """
robot: gimball
initial: {x: 0.25, speed: 0.5}
duration: 1.0
"""


@pytest.fixture
def rolling(tmp_path):
    """Return the scene file of a rolling ball."""
    path = tmp_path / 'rolling.yaml'
    path.write_text(ROLLING)
    return path


@pytest.mark.parametrize('way', WAYS)
def test_time_is_paused_stepped_reset_and_resumed(graph, rolling, way):
    states = graph.subscribe('ball_state', BallState)
    if 'lockstep' in WAYS[way]:
        graph.start('controller')
    graph.start('simulator', scene=rolling, start_paused=True, ball_state_rate=500.0, **WAYS[way])
    graph.wait_until_connected(states)
    assert {to_seconds(state.header.stamp) for state in states} == {0.0}

    # Exactly that number of periods, also in immediate succession.
    assert [round(500 * graph.step(periods)) for periods in (1, 50, 0, 9)] == [1, 51, 52, 61]
    graph.wait_for_time(states, 61 / 500)
    assert sorted({round(500 * to_seconds(state.header.stamp)) for state in states}) == [
        *range(62)]
    assert states[-1].x == pytest.approx(0.25 + 0.5 * 61 / 500, rel=0.05)

    assert 't = 0.000 s, paused' in graph.trigger('reset')
    graph.wait(lambda: states[-1].x == 0.25, 'the ball is back')
    assert to_seconds(states[-1].header.stamp) == 0.0

    graph.trigger('resume')
    graph.wait_for_time(states, 0.3)
    assert float(graph.trigger('pause').split()[-2]) >= 0.3
    graph.wait_for_health('simulator', diagnostics.OK, 'paused')
    assert graph.end('simulator') == 0


def test_refused_steps_and_resumes_are_explained(graph, rolling):
    graph.start('simulator', scene=rolling, lockstep=True)
    refused = graph.request('step', periods=1)
    assert not refused.success and 'call ~/pause first' in refused.message
    graph.trigger('pause')

    # No node answers the states, so this step lasts until another request ends it.
    unfinished = graph.call_async('step', periods=5)
    graph.wait(lambda: 'not paused' in graph.request('step', periods=1).message,
               'the first step has started')
    graph.trigger('pause')
    graph.wait(unfinished.done, 'the step is ended by the pause')
    assert not unfinished.result().success
    assert unfinished.result().message == 'ended before all periods were run'
    assert graph.end('simulator') == 0


def test_a_failed_run_stops_publishing_reports_why_and_can_be_reset(graph, tmp_path):
    # After this fall onto soft ground, the centre of the ball is below the ground.
    scene = tmp_path / 'fall.yaml'
    scene.write_text('robot: gimball\nrobot_changes: {contact_stiffness: 500.0}\n'
                     'initial: {y: 1.0, velocity_y: -10.0}\nduration: 1.0\n')
    states, odometry = graph.subscribe('ball_state', BallState), graph.subscribe('odom', Odometry)
    graph.start('simulator', scene=scene, start_paused=True)
    graph.wait_until_connected(states)
    failed = graph.request('step', again=False, periods=500)
    assert not failed.success
    graph.wait_for_health('simulator', diagnostics.ERROR, 'under the ground')
    log = graph.log('simulator')
    assert 'simulation stopped at t = 0.' in log and 'raise contact_stiffness' in log
    assert log.count('Nothing is published until ~/reset') == 1

    for service, fields in (('resume', {}), ('step', {'periods': 1})):
        response = graph.request(service, **fields)
        assert not response.success and 'call ~/reset first' in response.message
    states.clear()
    odometry.clear()
    graph.statuses.clear()
    graph.wait_for_health('simulator', diagnostics.ERROR)
    assert not states and not odometry

    graph.trigger('reset')
    graph.wait(lambda: states and states[-1].y == 1.0, 'the ball is back')
    assert graph.step(5) == pytest.approx(0.01)  # time restarts, too
    graph.wait_for_health('simulator', diagnostics.OK)
