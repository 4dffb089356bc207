# SPDX-License-Identifier: Apache-2.0
"""
ROS parameters from the described fields of a dataclass, and their changes at run time.

One declaration gives the parameter, its description, its range, its error message and the row in
docs/nodes.md.  Integers are accepted for floats, and undeclared parameters are refused instead of
ignored.

An unknown name given to this node is an error.  In a section for many nodes (``/**:``) it may be
meant for another node.  rclpy merges all sections, so the section of a name is looked up in the
files themselves.

Settings are immutable values.  A change creates new settings, which the node checks as a whole and
then applies, in rclpy's pre-set, on-set and post-set callbacks: all values of a
request, or none.  A check may take long (the stability of the laws takes a tenth of a second or
more), so for a request by service it runs in a separate thread, and the callbacks use its
result between two periods.
"""
from pathlib import Path
import sys
import threading
from typing import (
    Any, Callable, Generic, Iterable, Iterator, Mapping, NamedTuple, Optional, Sequence, Type)

from rcl_interfaces.msg import (
    FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult)
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future
import yaml

from ballbot_ros.config.fields import allowed, check_value, suggestion, why_fixed
from ballbot_ros.errors import BallbotError, ConfigurationError
from ballbot_ros.ros.rclpy_compat import answer_later, parameter_overrides, parameter_services
from ballbot_ros.ros.settings import Described, S

# Applies settings, in the thread of the executor; must not fail.
Commit = Callable[[], None]
Prepare = Callable[[S], Commit]
# Period at which a request that waits for the executor checks that it still exists [s].
EXECUTOR_CHECK_PERIOD = 0.2
# Parameters that rclpy itself declares.  Those named qos_overrides are not among them: no
# publisher or subscriber here uses them, so they would have no effect.
BUILT_IN = ('use_sim_time', 'start_type_description_service')


def describe(metadata: Mapping[str, Any]) -> ParameterDescriptor:
    """Return the descriptor of a described field."""
    unit, why = metadata.get('unit', '1'), why_fixed(metadata)
    text = metadata['doc'] + ('' if unit == '1' else f' [{unit}]')
    text += f'. Cannot change while the node runs: {why}' if why else (
        '. Can change while the node runs')
    descriptor = ParameterDescriptor(description=text, read_only=bool(why))
    if metadata['kind'] is float:
        descriptor.additional_constraints = allowed(metadata)
        descriptor.floating_point_range = [FloatingPointRange(
            from_value=float(max(metadata['minimum'], metadata['above'])),
            to_value=float(metadata['maximum']))]
    elif metadata['kind'] is int:
        descriptor.integer_range = [IntegerRange(
            from_value=int(metadata['minimum']), to_value=int(metadata['maximum']), step=1)]
    elif metadata['kind'] is str and metadata['choices']:
        descriptor.additional_constraints = 'one of ' + ', '.join(metadata['choices'])
    return descriptor


def refuse_sim_time(node: Node, explanation: str) -> bool:
    """Refuse to set the parameter use_sim_time at run time, and return whether it is set."""
    def check(parameters: list[Parameter]) -> SetParametersResult:
        enabled = any(one.name == 'use_sim_time' and one.value for one in parameters)
        return SetParametersResult(successful=not enabled, reason=explanation if enabled else '')
    node.add_on_set_parameters_callback(check)
    return bool(node.get_parameter('use_sim_time').value)


def declare(node: Node, cls: Type[S], prepare: Prepare[S] = lambda _: lambda: None) -> S:
    """
    Declare the parameters of a node, and permit changes at run time where possible.

    `prepare` takes settings requested while the node runs; it raises `BallbotError` if they are
    invalid, or returns a function that applies them, see `Changes`.  A node without parameters
    that can change needs none.  Returns the checked settings; raises `ConfigurationError` for an
    invalid value, or for an override that is not a parameter, with the most similar name.
    """
    described = cls.described()
    refuse_unknown_overrides(node, described)
    given = {}
    for name, parameter in parameter_overrides(node).items():
        if name in described:
            # Checked before rclpy does so: its message would name neither value nor range.
            given[name] = check_value(name, parameter.value, described[name].metadata,
                                      f'node {node.get_name()}')
            parameter_overrides(node)[name] = Parameter(name, value=given[name])
    settings = cls().changed(given)
    for name, item in described.items():
        node.declare_parameter(name, item.value(settings), describe(item.metadata))
    node.get_logger().info('running with ' + (', '.join(
        f'{name} {one.value!r}' for name, one in parameter_overrides(node).items()
        if name in described or name in BUILT_IN) or 'default parameters'))
    Changes(node, settings, prepare)
    return settings


def refuse_unknown_overrides(node: Node, known: Iterable[str]) -> None:
    """
    Raise `ConfigurationError` for a name given to this node that is not one of its parameters.

    A name that only a section for many nodes contains is ignored, with a warning.
    """
    names = sorted({*known, *BUILT_IN})
    unknown = [name for name in parameter_overrides(node) if name not in names]
    if not unknown:
        return
    for_many, for_one = _given(sys.argv, node.get_fully_qualified_name())
    ignored = []
    for name in unknown:
        if name in for_one or name not in for_many:
            raise ConfigurationError(
                f'{name!r} is not a parameter of node {node.get_name()}'
                + suggestion(name, names), 'unknown_name', name)
        ignored.append(f'{name!r}{suggestion(name, names, listing=False)}')
    node.get_logger().warning(
        f'not parameters of node {node.get_name()}, and ignored, because a section for many nodes '
        f'contains them: {", ".join(ignored)}')


def _given(arguments: Sequence[str], node: str) -> tuple[set[str], set[str]]:
    """Return the parameter names in arguments and files for many nodes, and for this one."""
    for_many: set[str] = set()
    for_one: set[str] = set()
    for option, value in _options(arguments):
        if option == '--params-file':
            for section, names in _sections(value):
                if '*' in section:
                    for_many |= names
                elif section == node:
                    for_one |= names
        else:  # -p [NODE:]NAME:=VALUE
            target, colon, name = value.partition(':=')[0].rpartition(':')
            (for_many if '*' in target else for_one).add(name)
    return for_many, for_one


def _options(arguments: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield the options that give parameters, with their values."""
    inside = False
    for one, following in zip(arguments, [*arguments[1:], '']):
        inside = one == '--ros-args' or (inside and one != '--')
        if inside and one in ('-p', '--param', '--params-file'):
            yield one, following


def _sections(path: str) -> list[tuple[str, set[str]]]:
    """Return the nodes of a parameter file, each with its parameter names."""
    try:
        content = yaml.safe_load(Path(path).read_text(encoding='utf-8'))
    except (OSError, UnicodeDecodeError, yaml.YAMLError):
        return []  # rcl has read it by its own rules
    found: list[tuple[str, set[str]]] = []

    def search(section: str, value: Any) -> None:
        for key, inner in value.items() if isinstance(value, Mapping) else ():
            if key == 'ros__parameters':
                found.append((section, set(_flat(inner))))
            else:
                search(f'{section}/{str(key).strip("/")}', inner)
    search('', content)
    return found


def _flat(value: Any, prefix: str = '') -> Iterator[str]:
    """Yield the names of parameters, with dots for nested mappings."""
    for key, inner in value.items() if isinstance(value, Mapping) else ():
        if isinstance(inner, Mapping):
            yield from _flat(inner, f'{prefix}{key}.')
        else:
            yield f'{prefix}{key}'


class Change(NamedTuple):
    """The effect of a request."""

    refusal: str = ''  # why the request is refused; empty if it is not
    parameters: Sequence[Parameter] = ()  # those that change, including those of a named file
    settings: Any = None
    commit: Commit = lambda: None
    text: str = ''  # the change, for the log


class Changes(Generic[S]):
    """
    Serves requests to set parameters.

    The pre-set callback computes the change: it converts numbers, adds the parameters from a named
    file, and omits unchanged parameters, so that the dump of a node can be loaded although it has
    read-only parameters.  The on-set callback returns a refusal, the post-set callback commits.
    `prepare`, see `declare`, may be called from any thread, one at a time.
    """

    def __init__(self, node: Node, settings: S, prepare: Prepare[S]):
        self._node, self._settings = node, settings
        self._prepare = prepare
        self._described: dict[str, Described] = settings.described()
        self._change = Change()
        self._ahead: Optional[Change] = None  # computed for the next request
        self._busy = threading.Lock()
        node.add_pre_set_parameters_callback(self._pre_set)
        node.add_on_set_parameters_callback(self._on_set)
        node.add_post_set_parameters_callback(self._post_set)
        for service, atomically in parameter_services(node):
            self._serve_in_thread(service, atomically)

    # Callbacks of rclpy

    def _pre_set(self, parameters: list[Parameter]) -> list[Parameter]:
        self._change, self._ahead = self._ahead or self._computed(parameters), None
        # rclpy ignores an empty list; an unchanged value makes it call _on_set.
        return list(self._change.parameters) or [self._node.get_parameter(self._live_name)]

    def _on_set(self, parameters: list[Parameter]) -> SetParametersResult:
        return SetParametersResult(
            successful=not self._change.refusal, reason=self._change.refusal)

    def _post_set(self, parameters: list[Parameter]) -> None:
        change, self._change = self._change, Change()
        if change.text:
            self._settings = change.settings
            change.commit()
            self._node.get_logger().info(f'changed: {change.text}')

    @property
    def _live_name(self) -> str:
        """Return the name of a parameter that is not read-only, and no other node monitors."""
        for name, item in self._described.items():
            if not item.part and item.metadata['kind'] is not str and not why_fixed(item.metadata):
                return name
        return 'use_sim_time'

    # Requests by service

    def _serve_in_thread(self, service: Any, atomically: bool) -> None:
        answer_later(service)

        def serve(request: Any, response: Any) -> Future:
            parameters = [Parameter.from_parameter_msg(one) for one in request.parameters]
            answer = Future()
            threading.Thread(
                target=self._serve, args=(parameters, atomically, response, answer), daemon=True,
                name='change of parameters').start()
            return answer
        service.callback = serve

    def _serve(self, parameters: list[Parameter], atomically: bool, response: Any,
               answer: Future) -> None:
        with self._busy:
            batches = [parameters] if atomically else [[one] for one in parameters]
            results = [self._set(batch) for batch in batches]
        if atomically:
            response.result = results[0]
        else:
            response.results = results
        self._in_executor(lambda: answer.set_result(response))

    def _set(self, parameters: list[Parameter]) -> SetParametersResult:
        if not parameters:
            return SetParametersResult(successful=True)
        change = self._computed(parameters)

        def act() -> SetParametersResult:
            self._ahead = change
            return self._node.set_parameters_atomically(parameters)
        return self._in_executor(act)

    def _in_executor(self, act: Callable[[], Any]) -> Any:
        """Call `act` between two callbacks of the node, and return its result."""
        done, results = threading.Event(), []

        def run() -> None:
            results.append(act())
            done.set()
        executor = self._node.executor
        if executor is not None:
            executor.create_task(run)
            while not done.wait(EXECUTOR_CHECK_PERIOD) and self._node.context.ok():
                pass
        return results[0] if results else SetParametersResult(
            successful=False, reason='the node ends')

    # The effect of a request

    def _computed(self, parameters: Sequence[Parameter]) -> Change:
        try:
            return self._compute(parameters)
        except BallbotError as error:
            return Change(str(error))
        except Exception as error:  # noqa: BLE001 every request gets a reply
            return Change(f'the check failed: {error!r}')

    def _compute(self, parameters: Sequence[Parameter]) -> Change:
        where = f'node {self._node.get_name()}'
        values: dict[str, Any] = {}
        foreign = []
        for one in parameters:
            item = self._described.get(one.name)
            if item is not None:
                self._add_value(values, one, item, where)
            elif not self._node.has_parameter(one.name):
                raise ConfigurationError(
                    f'{one.name!r} is not a parameter of {where}'
                    + suggestion(one.name, self._described), 'unknown_name', one.name)
            elif self._node.get_parameter(one.name).value != one.value:
                foreign.append(one)
        wanted = self._settings.changed(values) if values else self._settings
        changed = {name: item.value(wanted) for name, item in self._described.items()
                   if item.value(wanted) != item.value(self._settings)}
        for name in changed:
            self._refuse_fixed(name, changed[name], where)
        text = ', '.join(f'{name} {self._described[name].value(self._settings)!r} -> {value!r}'
                         for name, value in changed.items())
        commit = self._prepare(wanted) if changed else (lambda: None)
        own = [Parameter(name, value=value) for name, value in changed.items()]
        return Change('', [*foreign, *own], wanted, commit, text)

    def _add_value(self, values: dict[str, Any], one: Parameter, item: Described, where: str
                   ) -> None:
        if not same(item.value(self._settings), one.value):
            self._refuse_fixed(one.name, one.value, where)
            values[one.name] = check_value(
                one.name, _number(one.value, item.metadata['kind']), item.metadata, where)

    def _refuse_fixed(self, name: str, value: Any, where: str) -> None:
        why = why_fixed(self._described[name].metadata)
        if why:
            text = str(value).lower() if isinstance(value, bool) else value
            raise ConfigurationError(
                f'{where}: {name} cannot change while the node runs: {why}; restart it with '
                f'-p {name}:={text}', 'fixed', name)


def same(now: Any, wanted: Any) -> bool:
    """
    Return whether a value equals the present one, given the conversions of ros2cli.

    ros2cli sends the text ``0.5`` of a file as the number 0.5, and the number 1e-05 as text.
    """
    if isinstance(now, str) and not isinstance(wanted, str):
        try:
            return bool(yaml.safe_load(now) == wanted)
        except yaml.YAMLError:
            return False
    return bool(_number(wanted, type(now)) == now) and (
        isinstance(now, bool) == isinstance(wanted, bool))


def _number(value: Any, kind: type) -> Any:
    """Convert text to a number where one is required: YAML 1.1 reads 1e-5 as text."""
    if kind in (float, int) and isinstance(value, str):
        try:
            return float(value)
        except ValueError:
            return value
    return value
