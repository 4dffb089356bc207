# SPDX-License-Identifier: Apache-2.0
"""
Compile what the nodes call, so that the first run is like all others.

Each node does so itself, before it is ready; here it is done once, and before all of them do it
at the same time.
"""
from ballbot_ros.bridge.warm_up import warm_up as warm_up_bridge
from ballbot_ros.control import checked_controller, load_tuning
from ballbot_ros.decision import Knowledge, load_curve, load_decision_tuning
from ballbot_ros.decision.decider import warm_up as warm_up_decision
from ballbot_ros.physics import load_scene
from ballbot_ros.physics.model.robot import load_robot
from ballbot_ros.plant import Plant


def prepare() -> None:
    """Compile what is not compiled yet; some time at first, and none later."""
    robot, tuning = load_robot('gimball'), load_tuning('published')
    Plant(load_scene('doorstep'), 500.0)
    checked_controller(robot, tuning, 500.0, 0)
    warm_up_bridge(robot)
    warm_up_decision(
        Knowledge(robot, load_curve('gimball_down'), load_decision_tuning('decision_default'),
                  tuning), 'rollout')
