# SPDX-License-Identifier: Apache-2.0
"""A simulated run as named columns with units."""
from dataclasses import dataclass, fields
from difflib import get_close_matches
from functools import cached_property
from pathlib import Path
from typing import (
    Any, ItemsView, Iterator, KeysView, Mapping, NamedTuple, Optional, Union, ValuesView)

import numpy as np

from ballbot_ros.config.optional import load_optional
from ballbot_ros.jit import compiled
from ballbot_ros.physics.mechanics.contact import (
    contact_force, contact_table, CORNER, EDGE, find_contacts, KIND, NORMAL_X, NORMAL_Y,
    PENETRATION)
from ballbot_ros.physics.mechanics.equations import energies
from ballbot_ros.physics.model.robot import Parameters
from ballbot_ros.physics.model.state import SIZE, State, X, Y
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.simulation.model import Model

# Every column of a trajectory and its unit, in the order of the files.
UNITS: Mapping[str, str] = {
    'time': 's', 'x': 'm', 'y': 'm', 'ball_angle': 'rad', 'pendulum_angle': 'rad',
    'velocity_x': 'm/s', 'velocity_y': 'm/s', 'ball_rate': 'rad/s', 'pendulum_rate': 'rad/s',
    'pendulum_torque': 'N m',
    'surface_normal_force': 'N', 'surface_friction_force': 'N',
    'edge_normal_force': 'N', 'edge_friction_force': 'N',
    'contact_force_x': 'N', 'contact_force_y': 'N',
    'penetration': 'm', 'slip_velocity': 'm/s',
    'kinetic_energy': 'J', 'potential_energy': 'J', 'contact_energy': 'J',
    'contact_loss': 'J', 'friction_loss': 'J', 'rolling_loss': 'J', 'joint_loss': 'J',
    'motor_work': 'J',
}


# The columns that are computed from a state.
DERIVED = ('kinetic_energy', 'potential_energy', 'contact_energy', 'surface_normal_force',
           'surface_friction_force', 'edge_normal_force', 'edge_friction_force',
           'contact_force_x', 'contact_force_y', 'penetration', 'slip_velocity')


@compiled
def write_derived(states: Array, parameters: Parameters, ground: Array, contacts: Array,
                  out: Array) -> None:
    """Fill `out`, one row per state, with the columns `DERIVED`; `contacts` is a work array."""
    for row in range(len(states)):
        state = states[row]
        kinetic, potential, stored = energies(state, parameters, ground, contacts)
        surface_normal = surface_friction = edge_normal = edge_friction = 0.0
        force_x = force_y = penetration = slip_velocity = 0.0
        for item in range(find_contacts(state[X], state[Y], parameters.radius, ground, contacts)):
            normal, friction, slip = contact_force(state, parameters, contacts, item)
            if contacts[item, KIND] == EDGE:
                edge_normal += normal
                edge_friction += friction
            else:
                surface_normal += normal
                surface_friction += friction
            force_x += normal * contacts[item, NORMAL_X] + friction * contacts[item, NORMAL_Y]
            force_y += normal * contacts[item, NORMAL_Y] - friction * contacts[item, NORMAL_X]
            if contacts[item, KIND] != CORNER and contacts[item, PENETRATION] > penetration:
                penetration, slip_velocity = contacts[item, PENETRATION], slip
        found = (kinetic, potential, stored, surface_normal, surface_friction, edge_normal,
                 edge_friction, force_x, force_y, penetration, slip_velocity)
        # Element by element: the length check of a tuple assignment takes long to compile.
        for column in range(len(found)):
            out[row, column] = found[column]


class Effort(NamedTuple):
    """Computational cost of a run."""

    steps: int = 0
    rejected: int = 0  # steps of a variable-step method that were not accurate enough
    events: int = 0  # located kinks of the contact law
    evaluations: int = 0  # of the right-hand side
    flights: int = 0  # in closed form


class Assurance(NamedTuple):
    """Error bound of a run, and its basis."""

    accuracy: float  # requested [m]
    estimate: float  # of the largest error of position up to the horizon [m]
    horizon: float  # simulated time up to which the accuracy holds [s]
    complete: bool  # whether that is the entire run
    tolerance: float  # local error per step with which the run was made [m]
    runs: int  # needed for this assurance


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory:
    """
    A run of a model; its arrays are read-only.

    Attributes
    ----------
    model : Model
    rows : (n, 15) array
        Time, the state vector (see `model.state`), torque of the motor.
    effort : Effort
    assurance : Assurance or None
        If an accuracy was requested.
    scene : Scene or None
        The simulated scene, with the requested duration and output step.

    """

    model: Model
    rows: Array
    effort: Effort = Effort()
    assurance: Optional[Assurance] = None
    scene: Any = None

    def __post_init__(self) -> None:
        object.__setattr__(self, 'rows', _read_only(self.rows))

    def __repr__(self) -> str:
        """Return scene and duration as text; see `columns` for the values."""
        return (f'Trajectory({self.model.robot.name!r}, {len(self)} samples from '
                f'{self.rows[0, 0]:g} to {self.rows[-1, 0]:g} s)')

    def __reduce__(self) -> tuple[type['Trajectory'], tuple[Any, ...]]:
        """Copy and unpickle without the columns, which are computed from the rows."""
        return type(self), tuple(getattr(self, item.name) for item in fields(self))

    @property
    def units(self) -> Mapping[str, str]:
        """Return the unit of each column."""
        return UNITS

    @property
    def crossed(self) -> Optional[bool]:
        """
        Return whether the ball crossed every step of the ground ahead of the start.

        None where the ground ahead of the start has no step; see `Summary.faces` for each step.
        """
        faces = self.summary().faces
        return all(face.passed for face in faces) if faces else None

    def summary(self) -> Any:
        """
        Return the `results.Summary` of the run: extremes, contacts and steps, in SI units.

        It does not depend on the output step.
        """
        from ballbot_ros.results.summary import summarise
        return summarise(self)

    def to_pandas(self) -> Any:
        """
        Return all columns as a pandas.DataFrame; units are in its ``attrs['units']``.

        Raises
        ------
        ConfigurationError
            If pandas is not installed.

        """
        pandas = load_optional('pandas', 'pandas', 'pip install pandas', 'to_pandas')
        table = pandas.DataFrame(self.columns)
        table.attrs['units'] = dict(UNITS)
        return table

    def to_xarray(self) -> Any:
        """
        Return all columns as an xarray.Dataset over time; each variable has its unit.

        Raises
        ------
        ConfigurationError
            If xarray is not installed.

        """
        xarray = load_optional('xarray', 'xarray', 'pip install xarray', 'to_xarray')
        table = xarray.Dataset(
            {name: ('time', values.copy(), {'units': UNITS[name]})
             for name, values in self.items() if name != 'time'},
            {'time': ('time', self['time'].copy(), {'units': UNITS['time']})},
            {'robot': self.model.robot.name})
        if self.scene is not None:
            table.attrs['scene'] = self.scene.name
        return table

    def save(self, path: Union[str, Path]) -> None:
        """
        Write all columns with their units to a .csv, .npz or .parquet file.

        Raises
        ------
        ConfigurationError
            If the file has another extension, or cannot be written.

        """
        from ballbot_ros.results.files import write_trajectory
        write_trajectory(self, path)

    def plot(self, path: Union[str, Path, None] = None) -> Any:
        """
        Return a matplotlib Figure of the columns over time; also write it to a PNG or SVG file.

        Raises
        ------
        ConfigurationError
            If the file cannot be written.

        """
        from ballbot_ros.figures import canvas, panels
        robot = self.model.robot.name
        title = f'{self.scene.name}, robot {robot}' if self.scene is not None else robot
        figure = panels.time_series(self, title)
        if path is not None:
            canvas.save(figure, path)
        return figure

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, column: str) -> Array:
        """Return a column by its name in `UNITS`; raise `KeyError` with the available names."""
        if column not in UNITS:
            near = get_close_matches(str(column), UNITS, 1)
            raise KeyError(f'{column!r} is not a column'
                           + (f'; did you mean {near[0]!r}?' if near else '')
                           + f'; the columns are {", ".join(UNITS)}')
        return self.columns[column]

    def __iter__(self) -> Iterator[str]:
        """Return an iterator over the names of the columns."""
        return iter(UNITS)

    def __contains__(self, column: object) -> bool:
        return column in UNITS

    def keys(self) -> KeysView[str]:
        """Return the names of the columns."""
        return self.columns.keys()

    def values(self) -> ValuesView[Array]:
        """Return the columns."""
        return self.columns.values()

    def items(self) -> ItemsView[str, Array]:
        """Return names and columns."""
        return self.columns.items()

    def state(self, index: int) -> State:
        """Return the state of one sample."""
        return State(*self.rows[index, :-1].tolist())

    @cached_property
    def columns(self) -> dict[str, Array]:
        """Return all columns by name; their units are in `UNITS`."""
        table = np.empty((len(self.rows), len(DERIVED)))
        # Contiguous and writable: the type for which the solvers are compiled.
        states = np.ascontiguousarray(self.rows[:, 1:1 + SIZE])
        write_derived(states, self.model.parameters, self.model.profile,
                      contact_table(len(self.model.profile)), table)
        found = dict(zip((*State._fields, 'pendulum_torque', *DERIVED),
                         (*self.rows.T, *_read_only(table).T)))
        return {name: found[name] for name in UNITS}

    @property
    def dissipated_energy(self) -> Array:
        """Return the energy dissipated by dampers and friction since the start [J]."""
        return (self['contact_loss'] + self['friction_loss'] + self['rolling_loss']
                + self['joint_loss'])

    @property
    def energy_residual(self) -> Array:
        """
        Return the residual of the energy balance at each sample [J].

        Kinetic, potential, contact and dissipated energy, minus the work of the motor,
        relative to the value at the start: zero for an exact integration.
        """
        ledger = (self['kinetic_energy'] + self['potential_energy'] + self['contact_energy']
                  + self.dissipated_energy - self['motor_work'])
        return ledger - ledger[0]

    @property
    def energy_in_play(self) -> float:
        """
        Return the reference energy of the run [J].

        The largest kinetic energy, change of potential energy, contact energy, dissipated
        energy or motor work, with which a residual is to be compared.
        """
        potential = self['potential_energy']
        return float(max(np.max(np.abs(part)) for part in (
            self['kinetic_energy'], potential - potential[0], self['contact_energy'],
            self.dissipated_energy, self['motor_work'])))


def _read_only(values: Array) -> Array:
    """Return a view that cannot be written to."""
    view = values.view()
    view.flags.writeable = False
    return view
