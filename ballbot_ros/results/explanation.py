# SPDX-License-Identifier: Apache-2.0
"""What was modelled in a run, what was left out, why, and what that costs, in plain words."""
from dataclasses import asdict, dataclass
import math
from typing import Any, Iterator, Optional

from ballbot_ros.physics.simulation.reachability import analyse, Analysis
from ballbot_ros.physics.simulation.scene import Scene
from ballbot_ros.physics.simulation.trajectory import Trajectory
from ballbot_ros.physics.solvers.registry import METHODS
from ballbot_ros.physics.solvers.spans import Span
from ballbot_ros.results.summary import plain
from ballbot_ros.results.wording import plural

LEFT_OUT = {
    'full': 'nothing: every contact with its spring, damper and friction',
    'flight': 'nothing: the motion in closed form, exact but for rounding',
}
MOST_PARTS = 12


@dataclass(frozen=True)
class Explanation:
    """What a run could meet, which models it went through, and what that costs."""

    analysis: Analysis  # what was known before the run
    seconds: dict[str, float]  # simulated time in each model [s]
    spans: tuple[Span, ...]  # its parts in order
    error: Optional[float]  # estimated, of the whole run [m], where an accuracy was asked for
    sentences: tuple[str, ...]  # all of that in words

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain values for JSON; a number that is not finite is None."""
        content: dict[str, Any] = plain(
            {**asdict(self), 'spans': [item._asdict() for item in self.spans]})
        return content


def explain(trajectory: Trajectory, scene: Scene) -> Explanation:
    """Explain a run of a scene."""
    analysis = analyse(scene.model, scene.start, scene.actuation, scene.run.duration)
    seconds: dict[str, float] = {}
    for span in trajectory.spans:
        seconds[span.model] = seconds.get(span.model, 0.0) + span.end - span.begin
    assured = trajectory.assurance
    error = assured.estimate if assured else None
    words = (*_before(analysis, scene), *_during(trajectory, seconds),
             *_left_out(analysis, scene, assured is not None), *_cost(trajectory, scene))
    return Explanation(analysis, seconds, trajectory.spans, error, words)


def _before(analysis: Analysis, scene: Scene) -> Iterator[str]:
    """Say what could be known without simulating."""
    if math.isfinite(analysis.speed):
        yield (f'Before the run: energy allows at most {analysis.speed:.3g} m/s, so the ball '
               f'stays between x = {analysis.leftmost:.3g} m and {analysis.rightmost:.3g} m.')
    else:
        yield ('Before the run: nothing bounds the energy, because the motor may give any '
               'torque; a torque_limit would. All of the ground counts as within reach.')
    yield (f'Within reach are {plural(analysis.segments, "flat piece")} of ground, '
           f'{plural(analysis.edges, "edge")} and {plural(analysis.corners, "corner")}.')
    for possible, what in ((analysis.several_contacts, 'Several contacts at once are'),
                           (analysis.sliding, 'Sliding is'), (analysis.flight, 'Flight is')):
        yield f'{what} {"possible" if possible else "impossible"}.'
    if analysis.pendulum is not None:
        yield _pendulum(analysis.pendulum, scene)


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


def _during(trajectory: Trajectory, seconds: dict[str, float]) -> Iterator[str]:
    """Say what was modelled when, and what was left out."""
    for model, time in seconds.items():
        yield f'Model "{model}" for {time:.4g} s; left out: {LEFT_OUT[model]}.'
    if 1 < len(trajectory.spans) <= MOST_PARTS:
        for span in trajectory.spans:
            yield (f'  {span.begin:.4f} s to {span.end:.4f} s: {span.model}, because '
                   f'{span.reason}.')
    elif trajectory.spans:
        yield f'The model changed {len(trajectory.spans) - 1} times.'


def _left_out(analysis: Analysis, scene: Scene, assured: bool) -> Iterator[str]:
    """Say what the solver did without, what it kept, and why; `assured` runs are adaptive."""
    method = METHODS[scene.model.solver.method]
    if analysis.pendulum is None:
        yield 'Pendulum: the robot has none, so its equations are left out.'
    if method.flies or assured:
        yield ('Search for contacts: left out of each step, which keeps the contacts that it '
               'began with; where one begins or ends, the step ends.')
        if scene.model.solver.models == 'full':
            yield 'Flight in closed form: switched off by models: full.'
        elif not analysis.closed_form:
            yield ('Flight in closed form: there is none, because the law of the motor is not '
                   'linear.')
    elif method.fixed:
        yield ('Search for contacts: done at every function evaluation, because steps of one '
               'length do not end where a contact does.')
    yield 'Energy ledger: kept, because the summary shows what it misses.'


def _cost(trajectory: Trajectory, scene: Scene) -> Iterator[str]:
    """Say what it costs in error."""
    yield 'The models themselves cost no error; what there is comes from the steps.'
    assured = trajectory.assurance
    if assured is not None:
        yield (f'Models and steps together: two runs whose tolerances differ by a factor of 30 '
               f'agree to {assured.estimate:.1e} m up to {assured.horizon:.4g} s.')
        return
    yield ('No accuracy was asked for, so nobody has measured the error of this run; '
           '--accuracy does.')
    if METHODS[scene.model.solver.method].fixed:
        yield 'Steps of one length know the full model only.'
