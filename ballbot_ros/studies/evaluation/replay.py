# SPDX-License-Identifier: Apache-2.0
"""One approach again, with what was decided and why, for people."""
import math
from typing import Any, Dict, List, Optional, Tuple

from ballbot_ros.decision import Decider, Decision
from ballbot_ros.physics.model.state import State
from ballbot_ros.studies.evaluation.campaign import Campaign
from ballbot_ros.studies.evaluation.closed_loop import true_faces
from ballbot_ros.studies.evaluation.loop import run_approach

REGULAR = 0.5  # a line at least this often [s]


class DecisionLog:
    """
    Collects a line for each change of the decision, and some between.

    Attributes
    ----------
    lines : list of str

    """

    def __init__(self, every: float = REGULAR):
        """Start without lines."""
        self.lines: List[str] = []
        self._every, self._due = every, 0.0
        self._last: Optional[Tuple[Any, ...]] = None

    def note(self, now: float, state: State, decision: Decision, set_angle: float,
             decider: Decider) -> None:
        """Take what was decided at a time; see `loop.Listener`."""
        plan = decision.plan
        mind = (decision.kind, decision.reason, plan.strategy if plan else None)
        if mind == self._last and now < self._due - 1e-9:
            return
        self._last, self._due = mind, now + self._every
        profile = decider.profile
        seen = ', '.join(
            f'{1e3 * face.height:+.1f}({1e3 * face.height_sd:.1f}) mm at '
            f'{face.position:.3f}({1e3 * face.position_sd:.0f} mm)' for face in (
                profile.faces if profile else ()))
        if profile and profile.rejection:
            seen += f' [{profile.rejection.value}: {profile.explanation}]'
        if profile and math.isfinite(profile.slope):
            seen += f' slope {math.degrees(profile.slope):+.1f} deg'
        text = (f'{now:6.2f} s  x {state.x:+.3f} m  v {state.velocity_x:+.3f} m/s  pendulum '
                f'{math.degrees(state.pendulum_angle):+4.0f} -> {math.degrees(set_angle):+4.0f} '
                f'deg  {decision.kind.value}/{decision.reason.value}: {decision.explanation}')
        if plan:
            text += (f'\n          plan {plan.strategy.value}: from {plan.start:.2f} m at '
                     f'{plan.speed:.2f} m/s, swing {math.degrees(plan.swing_angle):.0f} deg at '
                     f'{plan.swing_position:.2f} m, edge {plan.edge:.2f} m, then '
                     f'{plan.after.value}, stand at {plan.stop_position:.2f} m')
        if decision.outlook:
            look = decision.outlook
            text += (f'\n          over {look.probability:.3f} stuck {look.stuck:.3f} falls '
                     f'{look.falls:.3f} touch {look.touch_speed:.2f} m/s, {look.attempts} '
                     f'attempts; braking room {look.braking_room:.2f} m')
        self.lines.append(text + (f'\n          seen {seen}' if seen else ''))


def _number(value: Optional[float]) -> str:
    """Return a number with three digits, a dash for none."""
    return '-' if value is None else f'{value:.3f}'


def replay(campaign: Campaign, planner: str, group: str, number: int,
           every: float = REGULAR) -> Tuple[List[str], Dict[str, Any]]:
    """
    Run one approach of a campaign again.

    Returns
    -------
    lines : list of str
        What it is, what was decided when, and what came of it.
    row : dict
        As the campaign keeps it.

    """
    approach = campaign.approach(group, number)
    timeline = DecisionLog(every)
    row = run_approach(approach, planner, campaign.believer(), timeline.note)
    faces = '; '.join(f'{1e3 * height:+.1f} mm at {left:.3f} m' for left, _, _, height in
                      true_faces(approach.ground.terrain))
    ending = [f'{row["outcome"]} at {row["time"]:.2f} s, x {row["x"]:.3f} m, gap '
              f'{_number(row["gap"])} m, hit at {row["hit_speed"]:.2f} m/s, {row["changes"]} '
              f'changes of mind; {row["decisions"]} decisions of {row["mean_ms"]:.2f} ms']
    ending += [
        f'attempt at {one["time"]:.2f} s on {one["face"]:.3f} m: {one["strategy"] or planner} at '
        f'{one["speed"]:.2f} m/s, promised {_number(one["probability"])}, '
        + ('over' if one['over'] else 'not over') + (', the same again' if one['same'] else '')
        for one in row['attempts']]
    if row['failure']:
        ending.append(row['failure'])
    return [approach.words, f'true faces: {faces or "none"}', *timeline.lines, *ending], row
