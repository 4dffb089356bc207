# SPDX-License-Identifier: Apache-2.0
"""
Parameters that change while a node runs: all that a request asks for, or nothing.

Settings are immutable values.  A change makes other settings, has them checked as a whole by the
node, and only then hands them over; what the node keeps meanwhile are the old ones.  Checks may
take long (the stability of the laws takes a tenth of a second), so for a request by service they
are made in a thread of their own: between two periods the node is only handed the result.
"""
from contextlib import contextmanager
import sys
import threading
from typing import Any, Callable, Dict, Generic, Iterator, List, NamedTuple, Optional, Sequence

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future
import yaml

from ballbot_ros.config.fields import check_value, READ_AT_START, suggestion, why_fixed
from ballbot_ros.errors import BallbotError, ConfigurationError
from ballbot_ros.ros.endpoints import answer_later
from ballbot_ros.ros.setting_fields import Described, S

# Puts settings in force, in the thread of the executor; must not fail.
Commit = Callable[[], None]
Prepare = Callable[[S], Commit]
# How long a request may wait for the executor before it looks whether there still is one [s].
PATIENCE = 0.2
# Longest time that a check keeps other threads from running [s].
SWITCH = 5e-4


class Change(NamedTuple):
    """What a request comes to."""

    parameters: List[Parameter]  # that change, or are not those of this package
    settings: Any
    commit: Commit
    said: str  # what changes, for people


class Changes(Generic[S]):
    """
    Serves requests to set parameters.

    Those of rclpy's services come here instead, because rclpy itself refuses a read-only
    parameter even where it keeps its value, so that the dump of a node could not be loaded; and
    because its refusals name neither the range nor what to do.

    Parameters
    ----------
    node : Node
    settings : Settings
        In force.
    prepare : callable, optional
        See `parameters.declare`.  It may be called from any thread, one at a time.

    """

    def __init__(self, node: Node, settings: S, prepare: Optional[Prepare[S]]):
        """Take the place of the methods and services that set parameters."""
        self._node, self._settings = node, settings
        self._prepare = prepare
        self._described: Dict[str, Described] = settings.described()
        self._by_rclpy = node.set_parameters_atomically
        self._busy = threading.Lock()
        node.set_parameters_atomically = self.set_atomically
        node.set_parameters = lambda given: [self.set_atomically([one]) for one in given]
        for service in node.services:
            if service.srv_name.endswith('/set_parameters'):
                self._take_over(service, False)
            elif service.srv_name.endswith('/set_parameters_atomically'):
                self._take_over(service, True)

    def set_atomically(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        """Change all of these or none, at once, in this thread."""
        if not self._busy.acquire(blocking=False):
            return _refused('another change of parameters is being checked; try again')
        try:
            return self._carry_out(self._plan(parameters))
        except BallbotError as error:
            return _refused(str(error))
        finally:
            self._busy.release()

    # Requests by service

    def _take_over(self, service: Any, atomically: bool) -> None:
        answer_later(service)

        def serve(request: Any, response: Any) -> Future:
            given = [Parameter.from_parameter_msg(one) for one in request.parameters]
            answer = Future()
            threading.Thread(
                target=self._serve, args=(given, atomically, response, answer), daemon=True,
                name='change of parameters').start()
            return answer
        service.callback = serve

    def _serve(self, given: List[Parameter], atomically: bool, response: Any, answer: Future
               ) -> None:
        """Check and change, then answer; runs in a thread of its own."""
        with self._busy, _yielding():
            results = [self._change(batch)
                       for batch in ([given] if atomically else [[one] for one in given])]
        if atomically:
            response.result = results[0]
        else:
            response.results = results
        self._in_executor(lambda: answer.set_result(response))

    def _change(self, parameters: List[Parameter]) -> SetParametersResult:
        try:
            plan = self._plan(parameters)
        except BallbotError as error:
            return _refused(str(error))
        except Exception as error:  # noqa: BLE001 whatever it is, who asks is answered
            return _refused(f'it cannot be checked: {error!r}')
        return self._in_executor(lambda: self._carry_out(plan)) if plan.parameters else (
            SetParametersResult(successful=True))

    def _in_executor(self, act: Callable[[], Any]) -> Any:
        """Return what `act` does between two callbacks of the node."""
        done, results = threading.Event(), []

        def run() -> None:
            results.append(act())
            done.set()
        executor = self._node.executor
        if executor is None:
            return _refused('the node ends')
        executor.create_task(run)
        while not done.wait(PATIENCE):
            if not self._node.context.ok():
                return _refused('the node ends')
        return results[0]

    # What a request comes to

    def _plan(self, parameters: Sequence[Parameter]) -> Change:
        """Return what is to be done; raise `BallbotError` if anything of it is refused."""
        place = f'node {self._node.get_name()}'
        values: Dict[str, Any] = {}
        foreign = []
        for one in parameters:
            item = self._described.get(one.name)
            if item is not None:
                self._note(values, one, item, place)
            elif not self._node.has_parameter(one.name):
                raise ConfigurationError(
                    f'{one.name!r} is not a parameter of {place}'
                    + suggestion(one.name, self._described))
            elif self._node.get_parameter(one.name).value != one.value:
                foreign.append(one)
        wanted = self._settings.changed(values) if values else self._settings
        changed = {name: item.value(wanted) for name, item in self._described.items()
                   if item.value(wanted) != item.value(self._settings)}
        for name in changed:
            why = self._why_fixed(self._described[name])
            if why:
                raise ConfigurationError(_sentence(place, name, why, changed[name]))
        said = ', '.join(f'{name} {self._described[name].value(self._settings)!r} -> {value!r}'
                         for name, value in changed.items())
        commit = self._prepare(wanted) if changed and self._prepare else (lambda: None)
        own = [Parameter(name, value=value) for name, value in changed.items()]
        return Change([*foreign, *own], wanted, commit, said)

    def _note(self, values: Dict[str, Any], one: Parameter, item: Described, place: str) -> None:
        """Take the value that is wanted, unless it is the one in force."""
        now = item.value(self._settings)
        if same(now, one.value):
            return
        why = self._why_fixed(item)
        if why:
            raise ConfigurationError(_sentence(place, one.name, why, one.value))
        values[one.name] = check_value(
            one.name, _number(one.value, item.metadata['kind']), item.metadata, place)

    def _why_fixed(self, item: Described) -> str:
        return why_fixed(item.metadata) if self._prepare else READ_AT_START

    def _carry_out(self, plan: Change) -> SetParametersResult:
        """Let rclpy keep and tell the values, then put them in force."""
        if not plan.parameters:
            return SetParametersResult(successful=True)
        result = self._by_rclpy(plan.parameters)
        if result.successful and plan.said:
            self._settings = plan.settings
            plan.commit()
            self._node.get_logger().info(f'changed: {plan.said}')
        return result


@contextmanager
def _yielding() -> Iterator[None]:
    """Let no other thread wait long for this one, which computes."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(min(before, SWITCH))
    try:
        yield
    finally:
        sys.setswitchinterval(before)


def same(now: Any, wanted: Any) -> bool:
    """
    Return whether a value is the one in force, as ros2cli writes and reads it.

    It sends the text ``0.5`` of a file as the number 0.5, and the number 1e-05 as text.
    """
    if isinstance(now, str) and not isinstance(wanted, str):
        try:
            return bool(yaml.safe_load(now) == wanted)
        except yaml.YAMLError:
            return False
    return bool(_number(wanted, type(now)) == now) and (
        isinstance(now, bool) == isinstance(wanted, bool))


def _number(value: Any, kind: type) -> Any:
    """Return the number that a text stands for where one is wanted: YAML 1.1 leaves 1e-5 text."""
    if kind in (float, int) and isinstance(value, str):
        try:
            return float(value)
        except ValueError:
            return value
    return value


def _sentence(place: str, name: str, why: str, value: Any) -> str:
    text = str(value).lower() if isinstance(value, bool) else value
    return (f'{place}: {name} cannot change while the node runs: {why}; start it again with '
            f'-p {name}:={text}')


def _refused(reason: str) -> SetParametersResult:
    return SetParametersResult(successful=False, reason=reason)
