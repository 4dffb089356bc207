# SPDX-License-Identifier: Apache-2.0
"""
Check of the remedies of refusals: each stated change is applied, and the case runs again.

A message may state several settings; each is applied first with the stated value, then further in
the same direction, until the verdict is good or chaotic, by the same criteria.  A stated start may
need more work: it is also tried with ten times the budget, which in these cases is far below that
of the package.
"""
from collections import Counter
from dataclasses import dataclass, replace
import re

import cases
from cases import make_case
from judge import CHAOTIC, GOOD, judge, REFUSED

from ballbot_ros.physics import Model, State

FURTHER = 4  # decades that a setting is moved, where no value is named ...
DEARER = 2   # ... and of what costs work


@dataclass(frozen=True)
class Remedy:
    """Result for a refusal; `setting` is empty if no stated change is effective."""

    name: str
    seed: int
    why: str
    setting: str = ''


def solver_with(case, **changes):
    """Return a case with another solver."""
    return replace(case, model=replace(
        case.model, solver=replace(case.model.solver_in_use, **changes)))


def robot_with(case, **changes):
    """Return a case with another robot, at the same start."""
    robot = case.model.robot
    return replace(case, model=replace(case.model, robot=replace(robot, **changes)))


def with_budget(case, factor, _):
    return solver_with(case, work_budget=min(10**15, round(
        case.model.solver_in_use.work_budget * factor)))


def with_method(case, factor, _):
    # The budget of these cases is far below that of the product, which this would not meet.
    return solver_with(case, method='adaptive', work_budget=round(cases.BUDGET * factor))


def with_step(case, factor, _):
    solver = case.model.solver_in_use
    return solver_with(case, step=solver.step / (2.0 * factor),
                       work_budget=round(2 * factor) * solver.work_budget)


def with_stiffness(case, factor, _):
    return robot_with(case, contact_stiffness=case.model.robot.contact_stiffness * factor)


def with_softness(case, factor, _):
    return robot_with(case, contact_stiffness=case.model.robot.contact_stiffness / factor)


def with_threshold(case, factor, _):
    return robot_with(case, slip_threshold=case.model.robot.slip_threshold * factor)


def with_gains(case, factor, _):
    """Return a case with softer gains, of the law and of the loop."""
    return replace(case, **{part: replace(own, **{
        name: getattr(own, name) / factor for name in (
            'position_kp', 'position_kd', 'velocity_kp', 'velocity_ki')})
        for part, own in (('actuation', case.actuation), ('tuning', case.tuning))})


def with_tolerance(case, factor, _):
    return solver_with(case, tolerance=min(1e-3, case.model.solver_in_use.tolerance * factor))


def with_slowness(case, factor, _):
    """Return a case that starts more slowly."""
    rates = ('velocity_x', 'velocity_y', 'ball_rate', 'pendulum_rate')
    return replace(case, start=case.start._replace(**{
        rate: getattr(case.start, rate) / factor for rate in rates}))


def with_height(case, _, found):
    return replace(case, start=case.start._replace(y=float(found[1])))


# What a message says, the setting that it means, and the case with that setting.
SETTINGS = (
    (r'with y = ([-\d.e+]+) m the ball touches', 'y of the start as named', with_height),
    (r'raise work_budget|work_budget of \d+; raise it', 'work_budget', with_budget),
    (r'the adaptive method', 'adaptive method', with_method),
    (r'a smaller step than', 'step', with_step),
    (r'raise contact_stiffness', 'contact_stiffness up', with_stiffness),
    (r'lower the speed', 'speed', with_slowness),
    (r'larger slip_threshold', 'slip_threshold', with_threshold),
    (r'softer contact_stiffness', 'contact_stiffness down', with_softness),
    (r'softer gains', 'gains', with_gains),
    (r'raise the tolerance', 'tolerance', with_tolerance))
CLEAR = re.compile(r'with y = ([-\d.e+]+) m the ball is clear')
STIFFER = re.compile(r'raise contact_stiffness to ([-\d.e+]+) N/m')


def stiffer(value):
    """Return how cases are made with another contact stiffness, for a start that it carries."""
    def make(name, seed):
        before = cases.meeting
        cases.meeting = lambda draw, robot, *rest, **more: before(
            draw, replace(robot, contact_stiffness=value), *rest, **more)
        try:
            return make_case(name, seed)
        finally:
            cases.meeting = before
    return make


def higher(value):
    """Return how cases are made that do not start at rest on their ground, but at a height."""
    def at_height(model, x, speed=0.0, pendulum_angle=0.0):
        return State(x=x, y=value, pendulum_angle=pendulum_angle, velocity_x=speed,
                     ball_rate=-speed / model.robot.ball_radius)

    def make(name, seed):
        before = Model.at_rest
        Model.at_rest = at_height
        try:
            return make_case(name, seed)
        finally:
            Model.at_rest = before
    return make


def budgeted(make):
    """Return how cases are made with ten times the work budget, too."""
    return lambda name, seed: with_budget(make(name, seed), 10.0, None)


def works(name, seed, make):
    """Return whether a case that is made in this way is judged good, or chaotic."""
    return judge(name, seed, make).verdict in (GOOD, CHAOTIC)


def changed(change, factor, found):
    """Return how cases are made with a setting changed."""
    return lambda name, seed: change(make_case(name, seed), factor, found)


def remedy(refused):
    """Return what becomes of a refused case with what its refusal names."""
    name, seed, why = refused
    value, height = STIFFER.search(why), CLEAR.search(why)
    makes = [('contact_stiffness as named', stiffer(float(value[1])))] if value else []
    if height:
        makes.append(('y of the start as named', higher(float(height[1]))))
    makes += [(f'{setting}, work_budget x 10', budgeted(make)) for setting, make in makes]
    if not makes:
        makes = [(f'{setting} x {10**decade}' if change is not with_height else setting,
                  changed(change, 10.0**decade, found))
                 for decade in range(1, 1 + FURTHER)
                 for pattern, setting, change in SETTINGS
                 if decade <= DEARER or change not in (with_budget, with_method, with_step)
                 for found in [re.search(pattern, why)] if found]
    for setting, make in makes:
        if works(name, seed, make):
            return Remedy(name, seed, why, setting)
    return Remedy(name, seed, why)


def refusal(job):
    """Return class, seed and words of a case that is refused, else nothing."""
    found = judge(*job)
    return (*job, found.why) if found.verdict == REFUSED else None


def report(remedies):
    """Return which settings helped, and every refusal whose words do not."""
    counts = Counter(item.setting or 'NOTHING' for item in remedies)
    lines = [f'{count:6}  {setting}' for setting, count in counts.most_common()]
    lines += [f'NO REMEDY {item.name}:{item.seed}  {item.why}'
              for item in remedies if not item.setting]
    helped = sum(bool(item.setting) for item in remedies)
    return '\n'.join([*lines, f'{helped} of {len(remedies)} refusals name what makes them work'])
