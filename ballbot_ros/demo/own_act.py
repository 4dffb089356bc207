# SPDX-License-Identifier: Apache-2.0
"""An act of the demo with user files for robot, scene, curve or gains."""
from typing import Optional, Sequence

from ballbot_ros.config.fields import check_value
from ballbot_ros.config.files import find_config, read_yaml, shipped_files
from ballbot_ros.control import checked_controller, load_tuning
from ballbot_ros.decision import load_curve, load_decision_tuning
from ballbot_ros.decision.tuning import check_decision
from ballbot_ros.demo.demo import Act, ACTS, CONTROL_RATE, LONGEST, TUNING
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.nodes.obstacle_decision.settings import DecisionSettings
from ballbot_ros.physics import load_scene, Robot
from ballbot_ros.physics.model.robot import load_robot

DECISION = 'decision_default'


def own_acts(scene: Optional[str] = None, robot: Optional[str] = None,
             curve: Optional[str] = None, tuning: Optional[str] = None,
             longest: Optional[float] = None, planner: str = 'rollout') -> Sequence[Act]:
    """
    Return the acts of a demo, after the same checks as in their nodes.

    Parameters
    ----------
    scene, robot, curve, tuning : str, optional
        Names or paths; by default the scenes of the demo, the robot of the scene, a curve for
        that robot, and the published gains.
    longest : float, optional
        End of the run, in simulated time [s].
    planner : str
        Planner of the decision, see `decision.planning.planners`.

    Raises
    ------
    ConfigurationError
        If a file does not exist or files are inconsistent; with the remedy.

    """
    check_value('planner', planner, DecisionSettings.__dataclass_fields__['planner'].metadata,
                'demo')
    duration = LONGEST if longest is None else longest
    if not (robot or curve or tuning):
        # The expected decisions are those of the default planner.
        known = [act._replace(longest=duration, planner=planner,
                              expected=act.expected if planner == 'rollout' else None)
                 for act in ACTS if scene in (None, act.scene)]
        if known:
            return known
    scene = scene or ACTS[0].scene
    load_scene(scene, robot)  # refuses what is wrong in it
    name = robot or str(read_yaml(find_config('scenes', scene))['robot'])
    kind = load_robot(name)
    tuning = tuning or TUNING
    checked_controller(kind, load_tuning(tuning), CONTROL_RATE, 0.0)
    return [Act(f'{kind.name} on the scene {scene}.', scene, None, name,
                fitting_curve(kind, name, curve), tuning, duration, planner)]


def fitting_curve(robot: Robot, name: str, curve: Optional[str]) -> str:
    """Return a curve that was made for a robot: the one that is given, or one that is shipped."""
    tuning = load_decision_tuning(DECISION)
    if curve:
        check_decision(robot, load_curve(curve), tuning)
        return curve
    for file in shipped_files('curves'):
        try:
            check_decision(robot, load_curve(file.stem), tuning)
        except ConfigurationError:
            continue
        return file.stem
    raise ConfigurationError(
        f'no height curve here was made for the robot {name}, and the decision needs one: make '
        f'it with "ballbot fit-curve --robot {name} --actuation held --out my_curve.yaml", then '
        f'give --curve my_curve.yaml', 'missing', '--curve')
