# SPDX-License-Identifier: Apache-2.0
"""What decisions are made with, as the parameters ask for."""
from ballbot_ros.control import load_tuning
from ballbot_ros.decision import check_decision, Knowledge, load_curve
from ballbot_ros.nodes.obstacle_decision.settings import DecisionSettings
from ballbot_ros.physics.model.robot import load_robot


def known(settings: DecisionSettings) -> Knowledge:
    """Return what parameters name; raise `ConfigurationError` for what does not fit together."""
    knowledge = Knowledge(
        load_robot(settings.robot), load_curve(settings.curve, settings.variant),
        settings.margins, load_tuning(settings.control_tuning))
    check_decision(knowledge.robot, knowledge.curve, knowledge.tuning)
    return knowledge
