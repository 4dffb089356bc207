# SPDX-License-Identifier: Apache-2.0
"""A model advances the state of the ball as a pure function."""
from dataclasses import dataclass, replace
from functools import cached_property
import math
from typing import Optional
import warnings

import numpy as np

from ballbot_ros.errors import ConfigurationError, PlausibilityWarning, SimulationError
from ballbot_ros.physics.mechanics import contact, equations
from ballbot_ros.physics.model.actuation import Actuator, actuator_torque
from ballbot_ros.physics.model.robot import ContactOptions, load_robot, Parameters, Robot
from ballbot_ros.physics.model.state import Energies, State, Touch
from ballbot_ros.physics.model.terrain import Array, TANGENT_X, Terrain, VERTEX_X
from ballbot_ros.physics.simulation.solver import (
    check_work, failure, Integrator, Ledger, LEDGER_BOUND, out_of_balance, Solver)
from ballbot_ros.physics.solvers.values import FINISHED, Status

# Static penetration, relative to the radius, at the stiffness that a refusal suggests.  At a
# tenth, a moving ball penetrates to its centre, or at a corner, where steps are explicit and many.
SINKS = 0.03


@dataclass(frozen=True, repr=False)
class Model:
    """
    A robot on a terrain: the full model, eqs. (3)-(10) and (13).

    Immutable; `advance` maps a state to a later one.

    Without a solver, `simulate` runs to an accuracy, and `advance` takes the fixed steps of
    ``Solver()``, at the same cost in every control period.
    """

    robot: Robot
    terrain: Terrain
    options: ContactOptions = ContactOptions()
    solver: Optional[Solver] = None

    def __post_init__(self) -> None:
        """Load the robot if its name or file is given."""
        object.__setattr__(self, 'robot', load_robot(self.robot))

    def __reduce__(self) -> tuple[
            type['Model'], tuple[Robot, Terrain, ContactOptions, Optional[Solver]]]:
        """Copy and unpickle without the work arrays of the solver."""
        return type(self), (self.robot, self.terrain, self.options, self.solver)

    def __repr__(self) -> str:
        """Return robot and solver, without the terrain."""
        return f'Model({self.robot!r}, {self.solver!r})'

    @property
    def solver_in_use(self) -> Solver:
        """Return the solver, or the default of `advance` if none is given."""
        return Solver() if self.solver is None else self.solver

    @cached_property
    def parameters(self) -> Parameters:
        """Return the robot as the kernels read it."""
        return Parameters.of(self.robot, self.options)

    @cached_property
    def profile(self) -> Array:
        """Return the terrain as the kernels read it."""
        return self.terrain.profile(self.robot.surface_friction, self.robot.edge_friction)

    def at_rest(self, x: float, speed: float = 0.0, pendulum_angle: float = 0.0) -> State:
        """
        Return the ball on the ground above `x`, rolling along it without slip.

        The contact carries the weight: on a level floor the ball does not bounce.

        Parameters
        ----------
        x : float
            x of the ball centre [m].
        speed : float
            Speed of the centre along the ground [m/s].
        pendulum_angle : float
            Absolute angle [rad]; its rate is 0.

        """
        height, normal_x, normal_y = self._resting_place(x)
        # Rolling without slip about the contact point, which is inside the undeformed ball.
        lever = self.robot.ball_radius
        if self.options.slip_lever == 'contact':
            lever -= min(self.robot.static_penetration * normal_y, 0.5 * lever)
        return State(x=x, y=height, pendulum_angle=pendulum_angle, ball_rate=-speed / lever,
                     velocity_x=speed * normal_y, velocity_y=-speed * normal_x)

    def _resting_place(self, x: float) -> tuple[float, float, float]:
        """Return the height of the centre, and the normal of the main contact, above x."""
        radius, robot = self.robot.ball_radius, self.parameters
        table = self._contacts

        def support(y: float) -> float:
            return self._spring_force(x, y)[1] - self.robot.weight

        # At `high` the ball is clear of all ground within reach; at `low` its centre is on the
        # ground, or at the top of a vertical face at x.
        near = 1e-9 * radius
        corners = self.profile[:, VERTEX_X]
        reach = np.concatenate([
            corners[np.abs(corners - x) < radius], [x - radius, x, x + radius]])
        high = float(np.max(self.terrain.height(reach))) + 1.01 * radius
        low = float(np.max(self.terrain.height([x - near, x, x + near]))) + near
        if support(low) < 0.0:
            # The supporting force grows with the stiffness; deeper contacts require less.
            lift = support(low) + self.robot.weight
            enough = robot.stiffness * self.robot.weight / lift / SINKS if lift > 0.0 else 0.0
            raise ConfigurationError(
                f'the ground at x = {x:g} m is too soft or too steep to carry the ball at rest: '
                f'a contact stiffness of {robot.stiffness:g} N/m gives way under '
                f'{self.robot.weight:g} N; '
                + (f'raise contact_stiffness to {enough:.3g} N/m, or ' if enough > 0.0 else '')
                + 'give the height y of the start: with y = '
                f'{high - 0.01 * radius:.9g} m the ball is clear of the ground',
                'out_of_range', 'contact_stiffness')
        for _ in range(200):
            middle = 0.5 * (low + high)
            if not low < middle < high:
                break
            if support(middle) > 0.0:
                low = middle
            else:
                high = middle
        rows = contact.find_contacts(x, low, radius, self.profile, table)
        if not rows:
            return low, 0.0, 1.0
        deepest = table[np.argmax(table[:rows, contact.PENETRATION])]
        return low, float(deepest[contact.NORMAL_X]), float(deepest[contact.NORMAL_Y])

    def _spring_force(self, x: float, y: float) -> tuple[float, float]:
        """Return the contact force on a ball at rest with its centre at (x, y) [N]."""
        count = contact.find_contacts(
            x, y, self.robot.ball_radius, self.profile, self._contacts)
        force_x = force_y = 0.0
        for kind, _, _, normal_x, normal_y, penetration, _, _ in self._contacts[:count].tolist():
            # The spring alone: without velocity there is neither damping nor friction.
            force = self.parameters.stiffness * penetration
            if kind == contact.CORNER:
                force = -force
            force_x += force * normal_x
            force_y += force * normal_y
        return force_x, force_y

    def check_start(self, state: State) -> None:
        """
        Refuse a start with the ball centre under the ground; warn if the ball is in the ground.

        The contact force is the weight at rest, and at most ``W + sqrt(W^2 + 2 k T)`` in an impact
        with the kinetic energy T.  With more, the ball starts in a wall, or a run is continued.
        If the spacing of floating-point numbers exceeds the tolerance, rounding limits accuracy.

        Raises
        ------
        ConfigurationError
            If a value of the state is not finite.
        SimulationError
            If the centre is under the ground.

        """
        for name, value in state._asdict().items():
            if not math.isfinite(value):
                raise ConfigurationError(
                    f'State: {name} must be finite, got {value!r}', 'not_finite', name)
        below = contact.ground_height(self.profile, state.x)
        radius, weight = self.robot.ball_radius, self.robot.weight
        if state.y <= below:
            slope = self.profile[contact.first_segment(self.profile, state.x)]
            raise SimulationError(
                state.time, 'the centre of the ball starts under the ground at '
                f'x = {state.x:.4g} m, with y = {state.y:.4g} m',
                f'raise y of the start (initial): with y = {below + radius / slope[TANGENT_X]:.9g}'
                ' m the ball touches the ground there', 'out_of_range', 'y')
        if state.time != 0.0:
            return
        solver, apart = self.solver_in_use, math.ulp(max(abs(state.x), abs(state.y)))
        if apart > solver.tolerance and not solver.fixed:
            warnings.warn(
                f'positions near x = {state.x:.3g} m, y = {state.y:.3g} m are rounded to '
                f'{apart:.1g} m, more than the tolerance of {solver.tolerance:.1g} m: move ground '
                'and start (initial) towards x = 0, y = 0, or ask for less accuracy',
                PlausibilityWarning, stacklevel=3)
        force = math.hypot(*self._spring_force(state.x, state.y))
        impact = 2.0 * self.parameters.stiffness * equations.kinetic_energy(
            np.array(state[1:]), self.parameters)
        if force > weight + math.sqrt(weight * weight + impact):
            deepest = max(self.touches(state), key=lambda touch: touch.penetration)
            warnings.warn(
                f'the ball starts {1e3 * deepest.penetration:.3g} mm inside the ground at '
                f'x = {deepest.x:.4g} m, y = {deepest.y:.4g} m, where it is pushed out with '
                f'{force:.3g} N: move its start (initial) away from there',
                PlausibilityWarning, stacklevel=3)

    def advance(self, state: State, actuator: Actuator, steps: int) -> State:
        """
        Return the state after a number of solver steps.

        Parameters
        ----------
        state : State
        actuator : Actuator
            See `Actuation.actuator`.
        steps : int
            Duration in steps of the solver; a variable-step method chooses its own steps.

        Raises
        ------
        SimulationError
            If a number stops being finite, the ball sinks into the ground, the work budget
            is used up, or (fixed steps) the energy balance does not close.

        """
        solver = self.solver_in_use
        vector = np.array(state[1:])
        if solver.fixed:
            check_work(solver, steps)
            ledger = Ledger(self.parameters, self.profile, vector)
        self.integrator.workspace.statistics[:] = 0
        status = self.integrator.advance(
            actuator, vector, Status(FINISHED, state.time),
            state.time + steps * solver.step)
        if status.outcome != FINISHED:
            raise failure(status.outcome, status.time, vector, solver)
        if solver.fixed:
            # Other methods control their error themselves.
            missing, _ = ledger.missing(vector[None])
            if missing > LEDGER_BOUND:
                raise out_of_balance(status.time, missing, solver)
        return State(status.time, *vector.tolist())

    # Arrays of the kernels: overwritten at each call, never read across calls.
    @cached_property
    def _contacts(self) -> Array:
        return contact.contact_table(len(self.profile))

    @cached_property
    def integrator(self) -> Integrator:
        """Return the integrator for control periods, which are shorter than most flights."""
        return Integrator(
            self.parameters, self.profile, replace(self.solver_in_use, models='full'))

    def torque(self, state: State, actuator: Actuator) -> float:
        """Return the torque of the pendulum motor [N m]."""
        return float(actuator_torque(state.time, np.array(state[1:]), actuator))

    def touches(self, state: State) -> list[Touch]:
        """Return all contacts with the ground, from left to right."""
        vector, table = np.array(state[1:]), self._contacts
        found = []
        for row in range(contact.find_contacts(
                state.x, state.y, self.robot.ball_radius, self.profile, table)):
            kind, *place = table[row, :6].tolist()
            found.append(Touch(int(kind), *place, *map(float, contact.contact_force(
                vector, self.parameters, table, row))))
        return found

    def energies(self, state: State) -> Energies:
        """Return kinetic, potential and contact energy [J]."""
        return Energies(*map(float, equations.energies(
            np.array(state[1:]), self.parameters, self.profile, self._contacts)))
