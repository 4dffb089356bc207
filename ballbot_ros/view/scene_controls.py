# SPDX-License-Identifier: Apache-2.0
"""What can be set while a scene runs, and in which range."""
from typing import Mapping, NamedTuple, Tuple

from ballbot_ros.config.files import shipped_files
from ballbot_ros.physics.simulation.solver import LARGEST
from ballbot_ros.view.ground import step_ahead
from ballbot_ros.view.laws import bounds_of, laws_of, UNITS
from ballbot_ros.view.scene_run import SceneRun
from ballbot_ros.view.source import Control

SLOWEST, FASTEST = 0.05, 4.0  # simulated seconds per second on the wall
HIGHEST_STEP, HIGHEST_FRICTION, LONGEST_STRIDE = 0.15, 1.2, 5.0  # [m], [1], [s]
NO_SET_POINT = 'a free pendulum follows no set-point; choose another law'


class FileChoice(NamedTuple):
    """A file that is in use, by its name, and one of one's own that may be chosen again."""

    chosen: str
    own: str


def controls_of(run: SceneRun, paused: bool, speed: float, first: float, scene: FileChoice,
                robot: FileChoice) -> Mapping[str, Control]:
    """
    Return the controls of a scene that runs.

    Parameters
    ----------
    run : SceneRun
    paused : bool
    speed : float
        Simulated seconds per second on the wall.
    first : float
        Earliest time that can be looked at [s].
    scene, robot : FileChoice

    """
    law = run.law.law
    ahead = step_ahead(run.model.terrain, run.state.x, run.robot.ball_radius)
    return {
        'pause': Control(paused),
        'step': Control(lowest=run.period, highest=LONGEST_STRIDE, unit='s'),
        'reset': Control(),
        'speed': Control(speed, SLOWEST, FASTEST),
        'seek': Control(lowest=first, unit='s'),
        'scene': Control(scene.chosen, choices=_names('scenes', scene)),
        'robot': Control(robot.chosen, choices=_names('robots', robot)),
        'law': Control(law, choices=laws_of(run.robot)),
        'set_point': Control(refusal=NO_SET_POINT) if law == 'free' else Control(
            run.law.set_point, *bounds_of(run.robot, law), unit=UNITS[law]),
        'step_height': Control(ahead.height if ahead else 0.0, -HIGHEST_STEP, HIGHEST_STEP, 'm'),
        'friction': Control(run.robot.surface_friction, 0.0, HIGHEST_FRICTION),
        'accuracy': Control(run.accuracy or 0.0, 0.0, LARGEST, 'm'),
        'e_stop': Control(run.e_stop),
    }


def _names(kind: str, choice: FileChoice) -> Tuple[str, ...]:
    """Return the names of the files that come with the package, after one of one's own."""
    shipped = tuple(file.stem for file in shipped_files(kind))
    return shipped if choice.own in shipped else (choice.own, *shipped)
