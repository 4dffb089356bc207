# SPDX-License-Identifier: Apache-2.0
"""
Every access to a part of rclpy that is private, experimental or differs between distributions.

A test for each distribution checks each of them.
"""
import re
from typing import Any, Dict, Iterator, List, Optional, Tuple

from rclpy._rclpy_pybind11 import RCLError
from rclpy.action import ActionServer
from rclpy.action.server import ServerGoalHandle
from rclpy.context import Context
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.task import Future

try:
    from rclpy.experimental import EventsExecutor
except ImportError:  # before rclpy 7.1.5
    EventsExecutor = SingleThreadedExecutor

__all__ = ['RCLError', 'RcutilsLogger', 'answer_later', 'available_transitions',
           'change_state_service', 'new_executor', 'parameter_overrides', 'parameter_services',
           'reason_of', 'send_result', 'state_label', 'take_all', 'transition_label']


def new_executor(context: Optional[Context] = None) -> Executor:
    """
    Return the fastest single-threaded executor of this rclpy.

    The older executors prepare every service, timer and subscription of a node again before each
    wait; at 500 Hz that takes more processor time than all callbacks.  The event-driven executor
    does not.
    """
    return EventsExecutor(context=context)


def reason_of(error: Exception) -> str:
    """Return the message of an error in one line, without the source locations of rcl."""
    return re.sub(r', at \S+\.c:\d+', '', ' '.join(str(error).split()))


def parameter_overrides(node: Node) -> Dict[str, Parameter]:
    """Return the parameters of command line and files; changes of this dict take effect."""
    found: Dict[str, Parameter] = node._parameter_overrides
    return found


def parameter_services(node: Node) -> Iterator[Tuple[Service, bool]]:
    """Yield the services that set parameters of a node, and whether they do so atomically."""
    for service in node.services:
        name = service.srv_name.rpartition('/')[2]
        if name in ('set_parameters', 'set_parameters_atomically'):
            yield service, name.endswith('atomically')


def answer_later(service: Service) -> None:
    """
    Let the callback of a service return a future of the response, to answer later.

    A coroutine would work with only one of the executors of rclpy.
    """
    send = service.send_response

    def send_response(response: Any, header: Any) -> None:
        if isinstance(response, Future):
            response.add_done_callback(lambda done: send(done.result(), header))
        else:
            send(response, header)
    service.send_response = send_response


def send_result(server: ActionServer, handle: ServerGoalHandle, result: Any) -> None:
    """
    Send the result of a goal that has its final status.

    rclpy leaves this to the executor, which no longer spins when a node ends.
    """
    future = server._result_futures[bytes(handle.goal_id.uuid)]
    future._set_executor(None)  # which would send the result later
    future.set_result(server.action_type.Impl.GetResultService.Response(
        status=handle.status, result=result))


def take_all(subscription: Subscription) -> Iterator[bytes]:
    """Yield the serialized messages that have arrived, without an executor."""
    handle, kind = subscription.handle, subscription.msg_type
    with handle:
        while (taken := handle.take_message(kind, True)) is not None:
            yield taken[0]


def change_state_service(node: Any) -> Service:
    """Return the service ``change_state`` of a lifecycle node; its callback can be replaced."""
    found: Service = node._service_change_state
    return found


def state_label(node: Any) -> str:
    """Return the name of the state of a lifecycle node."""
    label: str = node._state_machine.current_state[1]
    return label


def available_transitions(node: Any) -> List[Tuple[int, str]]:
    """Return number and name of each transition that a lifecycle node can make now."""
    return [(number, label) for number, label, *_ in node._state_machine.available_transitions]


def transition_label(node: Any, number: int) -> str:
    """Return the name of a transition of a lifecycle node."""
    for known, label, *_ in node._state_machine.transition_graph:
        if known == number:
            return str(label)
    return f'transition {number}'
