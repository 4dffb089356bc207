# SPDX-License-Identifier: Apache-2.0
"""
Discovery range of a node: this machine only, unless the user configures another one.

A ROS graph has no access control: any program that discovers a node can drive the robot.
Therefore discovery over the network is opt-in.
"""
from typing import Dict, Mapping, MutableMapping

from ballbot_ros.config.files import shipped_folder

RANGE_VARIABLE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
# If one of these is set, the user has configured discovery.
DISCOVERY_VARIABLES = (
    RANGE_VARIABLE, 'ROS_LOCALHOST_ONLY', 'ROS_STATIC_PEERS', 'ROS_DISCOVERY_SERVER')
# Environment variables of Fast DDS for its settings: up to version 2, and later.
FAST_DDS_VARIABLES = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE')
SUBNET_SETTING = f'{RANGE_VARIABLE}=SUBNET'


def chosen(environment: Mapping[str, str]) -> Dict[str, str]:
    """Return the variables by which the user has set the discovery range, empty for none."""
    return {name: environment[name] for name in DISCOVERY_VARIABLES if environment.get(name)}


def on_this_machine(environment: Mapping[str, str]) -> bool:
    """Return whether only programs of this machine discover the nodes of an environment."""
    if environment.get('ROS_LOCALHOST_ONLY') == '1':
        return True
    choice = chosen(environment)
    return not choice or choice == {RANGE_VARIABLE: 'LOCALHOST'}


def variables(environment: Mapping[str, str]) -> Dict[str, str]:
    """
    Return the variables to add to an environment before a node is created in it.

    For the local range, Fast DDS is configured to receive on loopback only; a settings file of
    the user has priority.  Other middlewares use the range alone.
    """
    if not on_this_machine(environment):
        return {}
    added = {} if chosen(environment) else {RANGE_VARIABLE: 'LOCALHOST'}
    path = str(shipped_folder('config') / 'fastdds' / 'this_machine.xml')
    if not any(environment.get(name) for name in FAST_DDS_VARIABLES):
        added.update(dict.fromkeys(FAST_DDS_VARIABLES, path))
    return added


def apply(environment: MutableMapping[str, str]) -> str:
    """Add `variables` to an environment, and return a sentence with the discovery range."""
    choice = chosen(environment)
    environment.update(variables(environment))
    if not choice:
        return f'discovery from this machine only; to include other machines, set {SUBNET_SETTING}'
    settings = ', '.join(f'{name}={value}' for name, value in choice.items())
    return f'discovery {"from this machine only," if on_this_machine(environment) else "as"}' \
        f' set by {settings}'
