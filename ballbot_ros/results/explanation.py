# SPDX-License-Identifier: Apache-2.0
"""What was modelled in a run, what was left out, why, and what that costs, in plain words."""
from dataclasses import asdict, dataclass
import math
from typing import Any, Optional

from ballbot_ros.physics.simulation.reachability import analyse, Analysis
from ballbot_ros.physics.simulation.scene import Scene
from ballbot_ros.physics.simulation.trajectory import Trajectory
from ballbot_ros.physics.solvers.spans import Span
from ballbot_ros.results.summary import plain

LEFT_OUT = {
    'full': 'nothing: every contact with its spring, damper and friction',
    'flight': 'nothing: the motion in closed form, exact but for rounding',
}
MOST_PARTS = 12


@dataclass(frozen=True)
class Explanation:
    """
    What a run could meet, which models it went through, and what that costs.

    Attributes
    ----------
    analysis : Analysis
        What was known before the run.
    seconds : dict of str to float
        Simulated time in each model [s].
    spans : tuple of Span
        Its parts in order.
    error : float or None
        Estimated error of the whole run [m], where an accuracy was asked for.
    sentences : tuple of str
        All of that in words.

    """

    analysis: Analysis
    seconds: dict[str, float]
    spans: tuple[Span, ...]
    error: Optional[float]
    sentences: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain values for JSON; a number that is not finite is None."""
        content = plain({**asdict(self), 'spans': [item._asdict() for item in self.spans]})
        assert isinstance(content, dict)
        return content


def explain(trajectory: Trajectory, scene: Scene) -> Explanation:
    """
    Explain a run.

    Parameters
    ----------
    trajectory : Trajectory
        Of that scene.
    scene : Scene

    """
    analysis = analyse(scene.model, scene.start, scene.actuation, scene.run.duration)
    seconds: dict[str, float] = {}
    for span in trajectory.spans:
        seconds[span.model] = seconds.get(span.model, 0.0) + span.end - span.begin
    assured = trajectory.assurance
    error = assured.estimate if assured else None
    words = (*_before(analysis, scene), *_during(trajectory, seconds),
             *_cost(trajectory, scene))
    return Explanation(analysis, seconds, trajectory.spans, error, words)


def _before(analysis: Analysis, scene: Scene) -> list[str]:
    """Say what could be known without simulating."""
    words = []
    if math.isfinite(analysis.speed):
        words.append(
            f'Before the run: energy allows at most {analysis.speed:.3g} m/s, so the ball stays '
            f'between x = {analysis.leftmost:.3g} m and {analysis.rightmost:.3g} m.')
    else:
        words.append('Before the run: nothing bounds the energy, because the motor may give any '
                     'torque; a torque_limit would. All of the ground counts as within reach.')
    words.append(
        f'Within reach are {_count(analysis.segments, "flat piece")} of ground, '
        f'{_count(analysis.edges, "edge")} and {_count(analysis.corners, "corner")}.')
    for possible, what in (
            (analysis.several_contacts, 'several contacts at once'),
            (analysis.sliding, 'sliding'), (analysis.flight, 'flight')):
        words.append(f'{what[0].upper()}{what[1:]} {"is" if "at" not in what else "are"} '
                     f'{"possible" if possible else "impossible"}.')
    if analysis.pendulum is not None:
        words.append(_pendulum(analysis.pendulum, scene))
    return words


def _pendulum(bound: float, scene: Scene) -> str:
    """Say whether the pendulum matters."""
    if not math.isfinite(bound):
        return 'The pendulum matters: it may decide over an obstacle, or over sliding.'
    wanted = scene.run.accuracy
    text = f'The pendulum moves the centre by at most {bound:.2g} m'
    if wanted is not None and bound < wanted:
        return (f'{text}, less than the accuracy of {wanted:g} m: the robot could be simulated '
                'without it.')
    return f'{text}; it is kept.'


def _during(trajectory: Trajectory, seconds: dict[str, float]) -> list[str]:
    """Say what was modelled when, and what was left out."""
    words = []
    for model, time in seconds.items():
        words.append(f'Model "{model}" for {time:.4g} s; left out: {LEFT_OUT[model]}.')
    if 1 < len(trajectory.spans) <= MOST_PARTS:
        words += [f'  {span.begin:.4f} s to {span.end:.4f} s: {span.model}, because '
                  f'{span.reason}.' for span in trajectory.spans]
    elif trajectory.spans:
        words.append(f'The model changed {len(trajectory.spans) - 1} times.')
    return words


def _cost(trajectory: Trajectory, scene: Scene) -> list[str]:
    """Say what it costs in error."""
    words = ['The models themselves cost no error; what there is comes from the steps.']
    assured = trajectory.assurance
    if assured is None:
        words.append('No accuracy was asked for, so nobody has measured the error of this run; '
                     '--accuracy does.')
    else:
        words.append(
            f'Models and steps together: two runs whose tolerances differ by a factor of 30 '
            f'agree to {assured.estimate:.1e} m up to {assured.horizon:.4g} s.')
    if scene.model.solver.method in ('rk4', 'semi_implicit') and assured is None:
        words.append('Steps of one length know the full model only.')
    return words


def _count(number: int, what: str) -> str:
    return f'{number} {what}{"" if number == 1 else "s"}'
