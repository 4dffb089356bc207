# SPDX-License-Identifier: Apache-2.0
"""State of the ball as a value, and a model that advances it as a pure function."""
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ballbot_ros.config.fields import Checked, count, quantity, text
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics.mechanics import contact, equations
from ballbot_ros.physics.model.contact_options import ContactOptions
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.terrain import Array, Terrain, VERTEX_X
from ballbot_ros.physics.simulation.failures import (
    check_work, failure, Ledger, LEDGER_BOUND, out_of_balance)
from ballbot_ros.physics.solvers import adaptive, fixed_step


METHODS = (*fixed_step.METHODS, *adaptive.METHODS)
MODELS = ('auto', 'full')


class State(NamedTuple):
    """
    Everything that evolves; see `dynamics` for the picture of the angles.

    The last five say where energy has gone since the start [J].
    """

    time: float = 0.0
    ball_angle: float = 0.0  # theta1 [rad]
    pendulum_angle: float = 0.0  # absolute, theta1 + theta2 [rad]
    x: float = 0.0  # of the ball centre [m]
    y: float = 0.0
    ball_rate: float = 0.0  # [rad/s]
    pendulum_rate: float = 0.0
    velocity_x: float = 0.0  # [m/s]
    velocity_y: float = 0.0
    contact_loss: float = 0.0  # taken by the contact dampers
    friction_loss: float = 0.0  # by friction in the contacts
    rolling_loss: float = 0.0  # by rolling friction c1
    joint_loss: float = 0.0  # by friction c2 of the pendulum joint
    motor_work: float = 0.0  # given by the motor

    @property
    def joint_angle(self) -> float:
        """Return theta2, the pendulum angle relative to the ball [rad]."""
        return self.pendulum_angle - self.ball_angle

    @property
    def joint_rate(self) -> float:
        """Return the rate of theta2 [rad/s]."""
        return self.pendulum_rate - self.ball_rate

    @property
    def dissipated_energy(self) -> float:
        """Return all that dampers and frictions have taken [J]."""
        return self.contact_loss + self.friction_loss + self.rolling_loss + self.joint_loss


class Touch(NamedTuple):
    """One contact with the ground, for people and messages."""

    kind: int  # contact.SURFACE, EDGE or CORNER
    x: float  # contact point on the ground [m]
    y: float
    normal_x: float
    normal_y: float
    penetration: float  # [m]
    normal_force: float  # [N]
    friction_force: float  # along (normal_y, -normal_x) [N]
    slip_velocity: float  # [m/s]


class Energies(NamedTuple):
    """The energy of a state [J]."""

    kinetic: float
    potential: float
    contact: float  # stored in the contact springs

    @property
    def total(self) -> float:
        """Return the sum [J]."""
        return self.kinetic + self.potential + self.contact


@dataclass(frozen=True)
class Solver(Checked):
    """
    Which integrator, and how finely.

    ``semi_implicit`` and ``rk4`` take steps of one length; see `integrators`.

    ``adaptive`` chooses its steps by their estimated local error and meets every kink of the
    contact law; it takes explicit and L-stable implicit steps, whichever are cheaper, and
    ``explicit`` and ``implicit`` are the same with one of the two alone; see `adaptive`.

    ``trapezoidal`` is the rule of the paper, with a largest step; see `trapezoidal`.
    """

    method: str = text('integrator', default='rk4', choices=METHODS)
    step: float = quantity(
        's', 'integration step of a method with steps of one length; the largest of trapezoidal',
        default=1e-4, above=0.0, maximum=0.1)
    tolerance: float = quantity(
        'm', 'local error per step of a method that chooses its steps', default=1e-9,
        minimum=1e-14, maximum=1e-3)
    models: str = text(
        'what a method that chooses its steps may simulate: full, always the full model; auto, '
        'flight in closed form where that is exact', default='auto', choices=MODELS)
    work_budget: int = count(
        'right-hand sides that one run may take before it is given up; the default is some '
        'minutes of work', default=10_000_000_000, minimum=1, maximum=10**15)


# Solvers with a name; `paper` is table 1 of the paper.
PRESETS = {'paper': Solver('trapezoidal', step=1e-3, tolerance=1e-9)}


@dataclass(frozen=True)
class Model:
    """
    A robot on a terrain: the full model, eqs. (3)-(10) and (13).

    Immutable; `advance` maps a state to a later one.
    """

    robot: Robot
    terrain: Terrain
    options: ContactOptions = ContactOptions()
    solver: Solver = Solver()

    @cached_property
    def numbers(self) -> equations.Numbers:
        """Return the robot as the kernels read it."""
        return equations.Numbers.of(self.robot, self.options)

    @cached_property
    def profile(self) -> Array:
        """Return the terrain as the kernels read it."""
        return self.terrain.profile(self.robot.surface_friction, self.robot.edge_friction)

    def at_rest(self, x: float, speed: float = 0.0, pendulum_angle: float = 0.0) -> State:
        """
        Return the ball on the ground above `x`, rolling along it without slip.

        The contact carries the weight: on a level floor nothing bounces.

        Parameters
        ----------
        x : float
            Of the ball centre [m].
        speed : float
            Of the centre, along the ground [m/s].
        pendulum_angle : float
            Absolute [rad]; without rate.

        """
        height, normal_x, normal_y = self._resting_place(x)
        # Rolling without slip about the contact point, which lies inside the ball.
        lever = self.robot.ball_radius
        if self.options.slip_lever == 'contact':
            lever -= min(self.robot.static_penetration * normal_y, 0.5 * lever)
        return State(x=x, y=height, pendulum_angle=pendulum_angle, ball_rate=-speed / lever,
                     velocity_x=speed * normal_y, velocity_y=-speed * normal_x)

    def _resting_place(self, x: float) -> tuple:
        """Return the height of the centre, and the normal of the main contact, above x."""
        radius, robot = self.robot.ball_radius, self.numbers
        table = contact.contact_table(len(self.profile))

        def support(y: float) -> float:
            rows = contact.find_contacts(x, y, radius, self.profile, table)
            lift = sum(robot.stiffness * table[row, contact.PENETRATION]
                       * table[row, contact.NORMAL_Y]
                       * (-1.0 if table[row, contact.KIND] == contact.CORNER else 1.0)
                       for row in range(rows))
            return float(lift) - self.robot.weight

        # Above everything within reach nothing carries the ball; at the ground all does.
        corners = self.profile[:, VERTEX_X]
        reach = np.concatenate([
            corners[np.abs(corners - x) < radius], [x - radius, x, x + radius]])
        high = float(np.max(self.terrain.height(reach))) + 1.01 * radius
        low = float(self.terrain.height(x)) + 1e-9 * radius
        if support(low) < 0.0:
            raise ConfigurationError(
                f'the ground at x = {x:g} m is too soft or too steep to carry the ball at rest: '
                f'a contact stiffness of {robot.stiffness:g} N/m gives way under '
                f'{self.robot.weight:g} N; give the height y of the start')
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

    def advance(self, state: State, drive: equations.Drive, steps: int) -> State:
        """
        Return the state after some time.

        Parameters
        ----------
        state : State
        drive : Drive
            See `Actuation.drive`.
        steps : int
            The time, in steps of the solver; the adaptive method takes others on the way.

        Raises
        ------
        SimulationError
            If a number stops being finite, the ball sinks into the ground, the work budget
            is used up, or (fixed steps) the energy ledger does not close.

        """
        vector = np.array(state[1:])
        if self.solver.method in adaptive.METHODS:
            time, _, _, ending = self._scratch.advance(
                self, drive, vector, state.time, state.time + steps * self.solver.step)
        else:
            check_work(self, steps)
            ledger = Ledger(self, vector, self._table)
            done, ending = fixed_step.advance(
                fixed_step.METHODS.index(self.solver.method), state.time, vector,
                self.solver.step, steps, self.numbers, self.profile, drive,
                self._table, self._work)
            time = state.time + done * self.solver.step
            # The adaptive method looks after its error itself; fixed steps do not.
            missing, _ = ledger.missing(vector[None])
            if ending == fixed_step.FINISHED and missing > LEDGER_BOUND:
                raise out_of_balance(time, missing, self)
        if ending != fixed_step.FINISHED:
            raise failure(ending, time, vector, self)
        return State(time, *vector.tolist())

    # Scratch arrays of the kernels: overwritten at each call, never read across calls.
    @cached_property
    def _table(self) -> Array:
        return contact.contact_table(len(self.profile))

    @cached_property
    def _work(self) -> Array:
        return fixed_step.workspace()

    @cached_property
    def _scratch(self) -> adaptive.Scratch:
        return adaptive.Scratch(len(self.profile))

    def torque(self, state: State, drive: equations.Drive) -> float:
        """Return the torque of the pendulum motor [N m]."""
        return float(equations.drive_torque(state.time, np.array(state[1:]), drive))

    def touches(self, state: State) -> list[Touch]:
        """Return all contacts with the ground, from left to right."""
        table = self._table
        rows = contact.find_contacts(
            state.x, state.y, self.robot.ball_radius, self.profile, table)
        found = []
        for row in range(rows):
            normal, friction, slip, _ = contact.contact_force(
                self.numbers, table, row, state.velocity_x, state.velocity_y, state.ball_rate)
            kind, x, y, normal_x, normal_y, penetration = table[row, :6].tolist()
            found.append(Touch(int(kind), x, y, normal_x, normal_y, penetration,
                               float(normal), float(friction), float(slip)))
        return found

    def energies(self, state: State) -> Energies:
        """Return kinetic, potential and contact energy [J]."""
        vector = np.array(state[1:])
        return Energies(
            float(equations.kinetic_energy(vector, self.numbers)),
            float(equations.potential_energy(vector, self.numbers)),
            float(contact.spring_energy(self.numbers, self.profile, self._table,
                                        state.x, state.y)))
