# SPDX-License-Identifier: Apache-2.0
"""Uses of rclpy beyond its public interface, in each distribution."""
from importlib.metadata import PackageNotFoundError, version

import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rclpy.task import Future
from std_msgs.msg import String
from std_srvs.srv import Trigger

from ballbot_ros.ros import rclpy_compat


def rclpy_version():
    """Return the version of rclpy, from its wheel or its ROS package."""
    for name in ('ros-rclpy', 'rclpy'):
        try:
            return tuple(int(part) for part in version(name).split('.')[:3])
        except PackageNotFoundError:
            pass
    return 0, 0, 0


jazzy = pytest.mark.skipif(not (7, 1, 5) <= rclpy_version() < (8,), reason='not rclpy of Jazzy')
kilted = pytest.mark.skipif(not (9,) <= rclpy_version() < (10,), reason='not rclpy of Kilted')


@pytest.fixture(params=[pytest.param('jazzy', marks=jazzy), pytest.param('kilted', marks=kilted)])
def distribution(request):
    """Return the distribution of the installed rclpy; the others are skipped."""
    return request.param


def test_the_executor_is_event_driven(distribution, context):
    executor = rclpy_compat.new_executor(context)
    assert type(executor).__name__ == 'EventsExecutor'
    executor.shutdown()


def test_the_reason_of_an_error_has_no_source_locations_of_rcl(distribution, make_node):
    node = make_node(Node, 'robot')
    with pytest.raises(Exception) as caught:
        node.resolve_topic_name('bad name')
    assert '.c:' in str(caught.value)
    assert '.c:' not in (reason := rclpy_compat.reason_of(caught.value))
    assert str(caught.value).startswith(reason)


def test_changed_overrides_take_effect(distribution, make_node):
    node = make_node(Node, 'robot', gain=3)
    overrides = rclpy_compat.parameter_overrides(node)
    assert overrides['gain'].value == 3
    overrides['gain'] = type(overrides['gain'])('gain', value=4.0)
    assert node.declare_parameter('gain', 1.0).value == 4.0


def test_the_services_that_set_parameters_are_found(distribution, make_node):
    found = {
        service.srv_name.lstrip('/'): atomically
        for service, atomically in rclpy_compat.parameter_services(make_node(Node, 'robot'))}
    assert found == {'robot/set_parameters': False, 'robot/set_parameters_atomically': True}


@pytest.mark.parametrize('executor_type', [rclpy_compat.new_executor, SingleThreadedExecutor])
def test_a_service_can_answer_later(distribution, executor_type, make_node, context):
    node, pending = make_node(Node, 'robot'), Future()
    rclpy_compat.answer_later(node.create_service(Trigger, 'go', lambda _, response: pending))
    executor = executor_type(context=context)
    executor.add_node(node)
    client = node.create_client(Trigger, 'go')
    assert client.wait_for_service(10.0)
    answer = client.call_async(Trigger.Request())
    for _ in range(10):
        executor.spin_once(timeout_sec=0.02)
    assert not answer.done()
    pending.set_result(Trigger.Response(success=True))
    while not answer.done():
        executor.spin_once(timeout_sec=0.1)
    assert answer.result().success
    executor.shutdown()


def test_messages_are_taken_without_an_executor(distribution, make_node):
    node = make_node(Node, 'robot')
    publisher = node.create_publisher(String, 'words', 10)
    subscription = node.create_subscription(String, 'words', print, 10, raw=True)
    for word in ('one', 'two'):
        publisher.publish(String(data=word))
    taken = []
    for _ in range(10**6):
        taken += rclpy_compat.take_all(subscription)
        if len(taken) == 2:
            break
    assert [deserialize_message(data, String).data for data in taken] == ['one', 'two']


def test_states_and_transitions_of_a_lifecycle_node_are_available(distribution, make_node):
    node = make_node(LifecycleNode, 'robot')
    assert rclpy_compat.state_label(node) == 'unconfigured'
    assert (1, 'configure') in rclpy_compat.available_transitions(node)
    assert rclpy_compat.transition_label(node, 3) == 'activate'
    assert rclpy_compat.transition_label(node, 99) == 'transition 99'
    assert rclpy_compat.change_state_service(node).srv_name.endswith('/change_state')


def test_an_error_of_the_middleware_has_a_type(distribution):
    assert issubclass(rclpy_compat.RCLError, RuntimeError)
