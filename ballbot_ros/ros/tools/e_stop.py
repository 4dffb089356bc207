# SPDX-License-Identifier: Apache-2.0
"""Call services of type std_srvs/Trigger: e-stop engaged, e-stop released."""
from typing import List, NamedTuple

from std_srvs.srv import Trigger

from ballbot_ros.config.fields import suggestion
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.ros.tools.observer import Observer


class ServiceAnswer(NamedTuple):
    """Answer of a service."""

    success: bool
    message: str


def trigger(observer: Observer, node: str, verb: str, timeout: float) -> ServiceAnswer:
    """
    Call a service of a node.

    Parameters
    ----------
    observer : Observer
    node : str
        Name of the node, with its namespace if it has one.
    verb : str
        ``'release_e_stop'`` for instance.
    timeout : float
        For the service to appear, and for its answer [s].

    Raises
    ------
    ConfigurationError
        If there is no such service, or it does not answer; names the nodes that have one.

    """
    # Look up the server first: a client would count as one, too.
    def who() -> List[str]:
        return sorted(name[:-len(verb) - 1] for name, _ in
                      observer.node.get_service_names_and_types() if name.endswith(f'/{verb}'))

    wanted = observer.resolve(f'{node.rstrip("/")}/{verb}')[:-len(verb) - 1]
    observer.wait(lambda: wanted in who(), timeout)
    known = who()
    client = observer.node.create_client(Trigger, f'{node.rstrip("/")}/{verb}')
    if wanted not in known or not observer.wait(client.service_is_ready, timeout):
        there = f'; {", ".join(known)} {"has" if len(known) == 1 else "have"} one (--node)' \
            if known else '; is the node running, in this ROS_DOMAIN_ID?'
        raise ConfigurationError(
            f'no node {node!r} with a service {verb}{suggestion(wanted, known, listing=False)}'
            f'{there}', 'unknown_name', '--node')
    answer = client.call_async(Trigger.Request())
    if not observer.wait(answer.done, timeout):
        raise ConfigurationError(f'{node}/{verb} has not answered within {timeout:g} s; look '
                                 'whether it did what it was asked for', 'unavailable', '--node')
    result = answer.result()
    return ServiceAnswer(result.success, result.message)
