# SPDX-License-Identifier: Apache-2.0
"""
Compile the kernels of the nodes before they start; no ROS is needed.

Each node compiles its own kernels before it is ready. If they are compiled here, several nodes do
not compile them at the same time. As a program, ``python -m ballbot_ros.demo.prepare NODE ...``
does so for the named nodes, and imports the modules of the picture, to cache their bytecode.
"""
from importlib import import_module
import sys
from typing import Callable, Mapping, Sequence

from ballbot_ros.bridge.session import warm_up as warm_up_bridge
from ballbot_ros.control import checked_controller, load_tuning
from ballbot_ros.decision import nominal_knowledge
from ballbot_ros.decision.decider import warm_up as warm_up_decision
from ballbot_ros.floors import load_floor
from ballbot_ros.navigation import RoutePlanner
from ballbot_ros.physics import load_scene
from ballbot_ros.physics.model.robot import load_robot
from ballbot_ros.plant import Plant


NODES: Mapping[str, Callable[[], object]] = {
    'simulator': lambda: Plant(load_scene('doorstep'), 500.0),
    'controller': lambda: checked_controller(
        load_robot('gimball'), load_tuning('published'), 500.0, 0),
    'bridge': lambda: warm_up_bridge(load_robot('gimball')),
    'decision': lambda: warm_up_decision(nominal_knowledge(), 'rollout'),
    'navigator': lambda: RoutePlanner(load_floor('apartment'), nominal_knowledge()).warm_up()}


def prepare(nodes: Sequence[str]) -> None:
    """Compile the kernels of some of `NODES`, unless the cache has them."""
    for node in nodes:
        NODES[node]()


if __name__ == '__main__':
    import_module('ballbot_ros.figures.film')
    prepare(sys.argv[1:])
