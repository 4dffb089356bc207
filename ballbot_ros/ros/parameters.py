# SPDX-License-Identifier: Apache-2.0
"""
ROS parameters from the described fields of a dataclass.

One declaration gives the parameter, its description, its range, the message of its refusal
and the row in docs/nodes.md.  Integers are accepted for floats, and a parameter that nobody
declared is refused instead of ignored.
"""
from dataclasses import fields
from typing import Any, Dict, Iterable, Type, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from ballbot_ros.config.fields import allowed, check_value, Checked, suggestion
from ballbot_ros.errors import ConfigurationError

T = TypeVar('T', bound=Checked)

# Parameters that rclpy itself declares.  Those named qos_overrides are not among them: no
# publisher or subscriber here asks for them, so they would have no effect.
BUILT_IN = ('use_sim_time', 'start_type_description_service')


def describe(metadata: Any) -> ParameterDescriptor:
    """Return the read-only descriptor of a described field."""
    unit = metadata.get('unit', '1')
    text = metadata['doc'] + ('' if unit == '1' else f' [{unit}]')
    # Dynamic typing lets an integer stand for a float; the value is checked by check_value.
    descriptor = ParameterDescriptor(description=text, read_only=True, dynamic_typing=True)
    if metadata['kind'] is float:
        descriptor.additional_constraints = allowed(metadata)
        bottom = max(metadata['minimum'], metadata['above'])
        if bottom > float('-inf') and metadata['maximum'] < float('inf'):
            descriptor.floating_point_range = [FloatingPointRange(
                from_value=float(bottom), to_value=float(metadata['maximum']))]
    elif metadata['kind'] is int:
        descriptor.integer_range = [IntegerRange(
            from_value=int(metadata['minimum']), to_value=int(metadata['maximum']), step=1)]
    elif metadata['kind'] is str and metadata['choices']:
        descriptor.additional_constraints = 'one of ' + ', '.join(metadata['choices'])
    return descriptor


def declare(node: Node, cls: Type[T]) -> T:
    """
    Declare the described fields of `cls` as read-only parameters of a node.

    Parameters
    ----------
    node : Node
    cls : type
        A `Checked` dataclass whose fields all have defaults.

    Returns
    -------
    T
        The settings, checked.

    Raises
    ------
    ConfigurationError
        For a value that is not acceptable, or an override that is no parameter; the message
        names the nearest one that is.

    """
    described = {item.name: item for item in fields(cls) if 'kind' in item.metadata}
    _refuse_unknown_overrides(node, described)
    values: Dict[str, Any] = {}
    for name, item in described.items():
        override = _overrides(node).get(name)
        if override is not None:
            # Checked before rclpy sees it: its own message would name neither value nor range.
            checked = check_value(name, override.value, item.metadata, f'node {node.get_name()}')
            _overrides(node)[name] = Parameter(name, value=checked)
        values[name] = node.declare_parameter(name, item.default, describe(item.metadata)).value
    settings = cls(**values)
    effective = ', '.join(f'{name} {getattr(settings, name)!r}' for name in described)
    node.get_logger().info(f'running with {effective}')
    return settings


def _overrides(node: Node) -> Dict[str, Parameter]:
    """Return what was given by command line and files; rclpy has no public way to ask."""
    found: Dict[str, Parameter] = node._parameter_overrides
    return found


def _refuse_unknown_overrides(node: Node, known: Iterable[str]) -> None:
    names = sorted({*known, *BUILT_IN})
    for name in _overrides(node):
        if name not in names:
            raise ConfigurationError(
                f'{name!r} is not a parameter of node {node.get_name()}'
                + suggestion(name, names))
