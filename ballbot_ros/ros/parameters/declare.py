# SPDX-License-Identifier: Apache-2.0
"""
ROS parameters from the described fields of a dataclass.

One declaration gives the parameter, its description, its range, its error message and the row in
docs/nodes.md.  Integers are accepted for floats, and undeclared parameters are refused instead of
ignored.  For changes at run time see `parameter_changes`.
"""
from typing import Any, Mapping, Optional, Type

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from ballbot_ros.config.fields import allowed, check_value, READ_AT_START, why_fixed
from ballbot_ros.ros.parameters.changes import Changes, Prepare
from ballbot_ros.ros.parameters.fields import S
from ballbot_ros.ros.parameters.overrides import refuse_unknown_overrides
from ballbot_ros.ros.rclpy_compat import parameter_overrides


def describe(metadata: Mapping[str, Any], why: str) -> ParameterDescriptor:
    """Return the descriptor of a described field, and why it cannot change, if so."""
    unit = metadata.get('unit', '1')
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


def declare(node: Node, cls: Type[S], prepare: Optional[Prepare[S]] = None) -> S:
    """
    Declare the parameters of a node, and let those change at run time that can.

    Parameters
    ----------
    node : Node
    cls : type
        The settings, whose fields all have defaults.
    prepare : callable, optional
        Takes settings that are wanted while the node runs; raises `BallbotError` if they cannot
        work, or returns a function that puts them in force.  See `changes.Changes`.  Without it no
        parameter can change.

    Returns
    -------
    Settings
        Checked.

    Raises
    ------
    ConfigurationError
        For a value that is not acceptable, or an override that is no parameter; the message
        names the nearest one that is.

    """
    described = cls.described()
    refuse_unknown_overrides(node, described)
    given = {}
    for name, parameter in parameter_overrides(node).items():
        if name in described:
            # Checked before rclpy sees it: its own message would name neither value nor range.
            given[name] = check_value(name, parameter.value, described[name].metadata,
                                      f'node {node.get_name()}')
            parameter_overrides(node)[name] = Parameter(name, value=given[name])
    settings = cls.of(given)
    for name, item in described.items():
        why = why_fixed(item.metadata) if prepare else READ_AT_START
        node.declare_parameter(name, item.value(settings), describe(item.metadata, why))
    # Log values of a file only where they are overridden.
    logged = {name: item for name, item in described.items() if not item.part or name in given}
    node.get_logger().info('running with ' + ', '.join(
        f'{name} {item.value(settings)!r}' for name, item in logged.items()))
    Changes(node, settings, prepare)
    return settings
