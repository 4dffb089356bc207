# SPDX-License-Identifier: Apache-2.0
"""
The plan of a sweep: its varied parameters, the choice of the cases, and the inputs of each case.

A case is a robot before a step.  Any parameter may vary: fields of the robot and (as
``motor.resistance``) of its motor, speed and height, the ground, the actuation.
"""
from dataclasses import asdict, dataclass, replace
import json
import math
from typing import Any, Dict, Mapping, Optional, Tuple
import warnings

import numpy as np

from ballbot_ros import __version__
from ballbot_ros.config.fields import (
    changed, check_value, Checked, count, quantity, suggestion, text, within)
from ballbot_ros.crossing import actuation_for, Rules, Site
from ballbot_ros.crossing.max_step_height import Crossings
from ballbot_ros.crossing.rules import HEIGHT, SPEED
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics import Actuation, Robot
from ballbot_ros.physics.model.actuation import SET_VALUES
from ballbot_ros.physics.model.robot import described, MOTOR, ROBOT, with_parameters
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.results.digests import digest

DESIGNS = ('grid', 'sobol', 'random')
MOST_CASES = 10**9

RADIAN = math.pi / 180.0

SITE, ACTUATION, RULES = described(Site), described(Actuation), described(Rules)
CASE = {'speed': SPEED, 'height': HEIGHT}
SI_NUMBERS = {**CASE, **SITE, **RULES, **ACTUATION, **ROBOT, **MOTOR}
# Angles in degrees, for the user: name of the value in degrees -> name of that in radians.
IN_DEGREES = {f'{name}_deg': name for name, item in SI_NUMBERS.items() if item['unit'] == 'rad'}
NUMBERS = {**SI_NUMBERS, **{
    name: {**SI_NUMBERS[owner], 'unit': 'deg', **{
        end: math.degrees(SI_NUMBERS[owner][end]) for end in ('minimum', 'maximum', 'above')}}
    for name, owner in IN_DEGREES.items()}}


@dataclass(frozen=True)
class SweepPlan(Checked):
    """
    A sweep; immutable: equal plans have equal cases.

    Raises `ConfigurationError` naming the unknown, missing or invalid value.
    """

    robot: Robot  # values of the parameters that do not vary
    actuation: Actuation = Actuation()
    site: Site = Site()
    rules: Rules = Rules()
    design: str = text('how the cases are chosen', default='grid', choices=DESIGNS)
    cases: int = count('number of cases, except of a grid', default=0, maximum=MOST_CASES)
    seed: int = count('seed of a design other than a grid', default=0)
    accuracy: float = quantity(
        'm', 'largest error of a height that is searched for', default=5e-5, minimum=1e-8,
        maximum=1e-2)
    fixed: Any = ()  # speed, and height if it is not searched for, unless they vary
    grid: Any = ()  # values of each varied parameter, for ``grid`` only
    ranges: Any = ()  # range of each varied parameter, for the other designs

    def __post_init__(self) -> None:
        super().__post_init__()
        # Worker processes do not need the provenance.
        object.__setattr__(self, 'robot', replace(self.robot, provenance={}))
        for name in ('fixed', 'grid', 'ranges'):
            object.__setattr__(self, name, dict(getattr(self, name)))
        unused, used = (self.ranges, self.grid) if self.design == 'grid' \
            else (self.grid, self.ranges)
        if unused or not used:
            raise ConfigurationError(
                f'sweep: design {self.design!r} needs '
                + ('values, as in 0.2,0.5 or 0.2:1.2:21, and no ranges' if self.design == 'grid'
                   else 'ranges from low to high, as in 0.2:1.2, and no lists'),
                'inconsistent', 'design')
        names = (*used, *self.fixed)
        unknown = [name for name in names if name not in NUMBERS]
        if unknown:
            raise ConfigurationError(
                'sweep: ' + '; '.join(f'{name!r} is not a parameter{suggestion(name, NUMBERS)}'
                                      for name in unknown), 'unknown_name', unknown[0])
        for name, values in {**used, **{key: (item,) for key, item in self.fixed.items()}}.items():
            if not len(values):
                raise ConfigurationError(f'sweep: {name} has no values', 'missing', name)
            for value in values:
                check_value(name, value, NUMBERS[name], 'sweep')
        for name, (low, high) in self.ranges.items():
            if not low < high:
                raise ConfigurationError(
                    f'sweep: {name} must go from low to high, got {low:g} to {high:g}',
                    'out_of_range', name)
        motor = [name for name in used if name in MOTOR]
        if motor and self.robot.motor is None:
            raise ConfigurationError(
                f'sweep: robot {self.robot.name!r} has no motor, so {", ".join(motor)} cannot '
                'vary', 'inconsistent', motor[0])
        if 'clearance' in names and self.rules.over != 'clear':
            raise ConfigurationError(
                f'sweep: clearance needs the rule clear, over is {self.rules.over!r}; make it '
                "'clear' (--over clear)", 'inconsistent', 'clearance')
        if 'speed' not in names:
            raise ConfigurationError(
                'sweep: speed is missing; fix it, or let it vary', 'missing', 'speed')
        owners = [IN_DEGREES.get(name, name) for name in names]
        twice = sorted(name for name in set(owners) if owners.count(name) > 1)
        if twice:
            raise ConfigurationError(
                f'sweep: {twice[0]} is given twice; fix it or vary it', 'inconsistent', twice[0])
        if not 1 <= self.size <= MOST_CASES:
            raise ConfigurationError(
                f'sweep: there must be at least 1 and at most {MOST_CASES} cases'
                f'{"" if self.design == "grid" else " (--cases)"}, got {self.size}',
                'out_of_range', 'cases')

    @property
    def names(self) -> Tuple[str, ...]:
        """Return the parameters that vary."""
        return tuple(self.grid if self.design == 'grid' else self.ranges)

    @property
    def size(self) -> int:
        if self.design != 'grid':
            return self.cases
        return int(np.prod([len(values) for values in self.grid.values()], dtype=object))

    @property
    def searches(self) -> bool:
        """Return whether maximum step heights are searched for, instead of trying given ones."""
        return 'height' not in (*self.names, *self.fixed)

    def block(self, first: int, stop: int) -> Array:
        """Return the cases from `first` to before `stop`: a row each, a column per name."""
        stop = min(stop, self.size)
        if self.design == 'grid':
            places = np.unravel_index(
                np.arange(first, stop), [len(values) for values in self.grid.values()])
            return np.stack([np.array(values, dtype=float)[place] for values, place in zip(
                self.grid.values(), places)], axis=1)
        low, high = np.array(list(self.ranges.values()), dtype=float).T
        if self.design == 'sobol':
            from scipy.stats import qmc
            engine = qmc.Sobol(len(low), seed=self.seed)
            if first > 0:
                engine.fast_forward(first)
            with warnings.catch_warnings():
                # SciPy warns of blocks whose size is not a power of two; only the total matters.
                warnings.simplefilter('ignore')
                points = engine.random(stop - first)
        else:
            # A separate stream for each block would change with the size of the blocks.
            bits = np.random.PCG64(self.seed)
            bits.advance(first * len(low))
            points = np.random.Generator(bits).random((stop - first, len(low)))
        return np.array(low + points * (high - low), dtype=float)

    def case(self, values: Mapping[str, Any]) -> tuple[Any, ...]:
        """
        Return robot, speed, height (None to search), actuation, site and rules of a case.

        Columns in place of numbers are the values of many cases, see `crossings`.
        """
        values = self.in_si(values)

        def change(part: Any, known: Mapping[str, Any]) -> Any:
            return changed(part, {
                name: value for name, value in values.items() if name in known})
        robot = with_parameters(self.robot, values)
        actuation = change(self.actuation, ACTUATION)
        if 'set_rate' not in values:
            actuation = actuation_for(robot, actuation)(values['speed'])
        return (robot, values['speed'], values.get('height'), actuation,
                change(self.site, SITE), change(self.rules, RULES))

    def in_si(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return fixed and varied values in SI units, by their SI names."""
        return {IN_DEGREES.get(name, name): RADIAN * value if name in IN_DEGREES else value
                for name, value in {**self.fixed, **values}.items()}

    def crossings(self, rows: Array) -> Optional[tuple[Crossings, Any, Array]]:
        """
        Return the cases of a block as the kernels read them, with the heights of their steps [m].

        The heights are None to search.  The third value is the mask of these cases, (n,): for
        other rows, `case` raises an error.  None if there is no such case.
        """
        columns = {**{name: np.full(len(rows), value, dtype=float)
                      for name, value in self.fixed.items()}, **dict(zip(self.names, rows.T))}
        try:
            with np.errstate(all='ignore'):
                case = self.case(columns)
                which = self._in_order(columns, case)
                if not which.any():
                    return None
                robot, speed, height, actuation, site, rules = case
                crossings = Crossings.of(
                    len(rows), robot, speed, actuation.start_angle, actuation, site, rules)
        except ConfigurationError:  # in all cases
            return None
        return (Crossings(crossings.rows[which], crossings.grounds[which]),
                None if height is None else height[which], which)

    def _in_order(self, columns: Mapping[str, Array], case: tuple[Any, ...]) -> Any:
        """Return which cases pass all checks that need no simulation."""
        robot, _, _, actuation, _, _ = case
        values = self.in_si(columns)
        ranges = [within(value, SI_NUMBERS[name]) for name, value in values.items()]
        ranges += [within(getattr(actuation, name), ACTUATION[name]) for name in SET_VALUES]
        # A set value without its law is refused, and a voltage of 0 is yet to be determined.
        loose = [value == 0.0 if actuation.law == 'free' else value != 0.0
                 for name, value in values.items()
                 if name in SET_VALUES and actuation.law in ('free', 'voltage')]
        return np.logical_and.reduce([
            *np.broadcast_arrays(*ranges, *loose, robot.consistent, robot.gravity > 0.0,
                                 actuation.fits(robot))])

    def describe(self) -> Dict[str, Any]:
        """Return all inputs of the results, as JSON values."""
        content = {key: value for key, value in asdict(self).items() if key != 'robot'}
        content['robot'] = self.robot.name
        content['robot_digest'] = self.robot.digest
        content['version'] = __version__
        described: Dict[str, Any] = json.loads(json.dumps(content))
        return described

    @property
    def digest(self) -> str:
        """Return a digest of `describe`."""
        return digest(self.describe())
