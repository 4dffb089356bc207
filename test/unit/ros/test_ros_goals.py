# SPDX-License-Identifier: Apache-2.0
"""The actions over real topics: a client, the decision, and the simulator in lockstep."""
from action_msgs.msg import GoalStatus
from nav_msgs.msg import Odometry
import pytest
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from ballbot_ros.action import CrossStep, DriveTo
from ballbot_ros.msg import StepDecision
from ballbot_ros.nodes.controller.node import Controller
from ballbot_ros.nodes.obstacle_decision.node import ObstacleDecision
from ballbot_ros.nodes.simulator.node import Simulator
from ballbot_ros.ros import endpoints, qos
from ballbot_ros.ros.rclpy_compat import new_executor


class Graph:
    """Simulator, controller and decision in lockstep at maximum speed, and a client."""

    def __init__(self, spinner, make_node, scene, planner):
        """Start the nodes; the ball rests until the first goal."""
        self.node = make_node(Client)
        self.simulator = make_node(
            Simulator, scene=scene, lockstep=True, real_time_factor=0.0, lockstep_timeout=60.0)
        self.decision = make_node(ObstacleDecision, planner=planner, wait_for_goal=True)
        controller = make_node(Controller, lockstep_set_point_period=0.02)
        spinner.add(self.node, self.simulator, self.decision, controller)
        self.wait = spinner.until
        self.wait(lambda: self.node.odometry is not None)
        self.wait(lambda: self.decision._decider.planned is not None)

    def done(self, future):
        self.wait(future.done)
        return future.result()

    def send(self, kind, **fields):
        """Send a goal, return its handle, and record its feedback."""
        client = self.node.clients_of[kind]
        self.wait(client.server_is_ready)
        self.node.feedback.clear()
        return self.done(client.send_goal_async(
            kind.Goal(**fields), lambda message: self.node.feedback.append(message.feedback)))

    def result(self, handle):
        """Return status and result of a goal when it has ended."""
        answer = self.done(handle.get_result_async())
        return answer.status, answer.result

    @property
    def speed(self):
        """Return the speed of the ball from odometry [m/s]."""
        return self.node.odometry.twist.twist.linear.x


class Client(Node):
    """A client that sends goals."""

    def __init__(self, **kwargs):
        """Subscribe to odometry."""
        super().__init__('client', **kwargs)
        self.odometry, self.feedback = None, []
        self.clients_of = {kind: ActionClient(self, kind, f'obstacle_decision/{name}')
                           for kind, name in ((DriveTo, 'drive_to'), (CrossStep, 'cross_step'))}
        self.e_stop = self.create_publisher(Bool, 'e_stop', qos.LATCHED)
        self.create_subscription(Odometry, 'odom', self._on_odometry, qos.LATEST)

    def _on_odometry(self, message):
        self.odometry = message


@pytest.fixture
def start(spinner, make_node):
    """Return a function that starts the graph."""
    return lambda scene='doorstep', planner='cubic': Graph(spinner, make_node, scene, planner)


@pytest.fixture
def two_steps(tmp_path):
    """Return a scene with a step of 12 mm, then one of 80 mm."""
    scene = tmp_path / 'two_steps.yaml'
    scene.write_text('robot: gimball\nterrain:\n  - flat: {length: 1.0}\n'
                     '  - step: {height: 0.012}\n  - flat: {length: 1.5}\n'
                     '  - step: {height: 0.080}\n  - flat: {length: 1.0}\n'
                     'initial: {x: 0.0}\nduration: 10.0\n')
    return str(scene)


@pytest.mark.slow
def test_a_step_is_crossed_and_the_next_one_of_80_mm_refused(start, two_steps):
    graph = start(two_steps)
    status, result = graph.result(graph.send(CrossStep))
    assert (status, result.outcome) == (GoalStatus.STATUS_SUCCEEDED, result.OUTCOME_CROSSED)
    assert result.height == pytest.approx(0.012, abs=1e-3) and result.position > 1.0
    assert abs(graph.speed) < 0.05
    phases = [one.phase for one in graph.node.feedback]
    assert phases[0] == CrossStep.Feedback.PHASE_APPROACHING
    assert phases[-1] == CrossStep.Feedback.PHASE_STOPPING
    status, result = graph.result(graph.send(CrossStep))
    assert (status, result.outcome) == (GoalStatus.STATUS_ABORTED, result.OUTCOME_REFUSED)
    assert '80 mm' in result.message and result.position < 2.5
    assert result.decision in (StepDecision.DECISION_STOP, StepDecision.DECISION_GO_ROUND)


def test_a_goal_is_checked_against_the_present_highest_speed(start):
    graph = start('flat')
    for highest, accepted in ((0.8, False), (1.5, True)):
        assert graph.decision.set_parameters_atomically(
            [Parameter('highest_speed', value=highest)]).successful
        assert graph.send(DriveTo, target=1.0, relative=True,
                          speed_limit=1.0 if highest < 1.0 else 1.4).accepted == accepted


def test_a_canceled_goal_ends_at_rest(start):
    graph = start('flat')
    handle = graph.send(DriveTo, target=5.0, relative=True, speed_limit=0.3)
    graph.wait(lambda: graph.speed > 0.2)
    graph.done(handle.cancel_goal_async())
    status, result = graph.result(handle)
    assert (status, result.outcome) == (GoalStatus.STATUS_CANCELED, result.OUTCOME_CANCELED)
    assert abs(graph.speed) < 0.05 and 0.0 < result.position < 4.0
    assert result.remaining == pytest.approx(5.0 - result.position, abs=0.02)


def test_a_goal_is_lost_without_odometry(start, monkeypatch):
    graph = start('flat')
    monkeypatch.setattr(endpoints, 'ODOMETRY_TIMEOUT', 1)
    handle = graph.send(DriveTo, target=5.0, relative=True)
    pause = graph.node.create_client(Trigger, 'simulator/pause')
    graph.wait(pause.service_is_ready)
    graph.done(pause.call_async(Trigger.Request()))
    status, result = graph.result(handle)
    assert (status, result.outcome) == (GoalStatus.STATUS_ABORTED, result.OUTCOME_LOST)


def test_the_result_of_a_goal_is_sent_although_its_node_ends(start, make_node, context):
    graph = start('flat')
    client, executor = make_node(Node, 'other_client'), new_executor(context)
    executor.add_node(client)
    action = ActionClient(client, DriveTo, 'obstacle_decision/drive_to')
    graph.wait(action.server_is_ready)
    sent = action.send_goal_async(DriveTo.Goal(target=5.0, relative=True))
    graph.wait(sent.done, lambda: executor.spin_once(timeout_sec=0.0))
    answer = sent.result().get_result_async()
    graph.wait(lambda: graph.speed > 0.2)  # meanwhile the request for the result arrives
    graph.decision.make_safe()
    executor.spin_until_future_complete(answer, timeout_sec=10.0)
    executor.shutdown()
    assert answer.done()
    result = answer.result().result
    assert result.outcome == result.OUTCOME_LOST and 'ended' in result.message


def test_an_e_stop_aborts_a_goal_and_new_goals_are_refused_until_resume(start):
    graph = start('flat')
    handle = graph.send(DriveTo, target=5.0, relative=True)
    graph.wait(lambda: graph.speed > 0.1)
    graph.node.e_stop.publish(Bool(data=True))
    status, result = graph.result(handle)
    assert (status, result.outcome) == (GoalStatus.STATUS_ABORTED, result.OUTCOME_E_STOP)
    assert 'e-stop' in result.message
    assert not graph.send(DriveTo, target=1.0, relative=True).accepted
    graph.node.e_stop.publish(Bool(data=False))
    resume = graph.node.create_client(Trigger, 'obstacle_decision/resume')
    graph.wait(resume.service_is_ready)
    graph.wait(lambda: graph.done(resume.call_async(Trigger.Request())).success)
    assert graph.send(DriveTo, target=1.0, relative=True).accepted


@pytest.mark.slow
def test_the_rollout_planner_crosses_the_step_of_31_mm_for_a_goal(start):
    graph = start('doorstep', planner='rollout')
    status, result = graph.result(graph.send(CrossStep))
    assert (status, result.outcome) == (GoalStatus.STATUS_SUCCEEDED, result.OUTCOME_CROSSED)
    assert result.height == pytest.approx(0.031, abs=1e-3) and result.position > 0.726
    assert any(one.probability > 0.5 for one in graph.node.feedback)
