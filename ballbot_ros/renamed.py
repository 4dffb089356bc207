# SPDX-License-Identifier: Apache-2.0
"""
Names that changed once, so that an old one gives an error that names the new one.

Add a pair here when a public name changes, and a line to CHANGELOG.rst.  Nothing else is needed:
`config.fields.suggestion`, which words every refusal of an unknown name, looks here first, and
so does Python's import of a module or name that is not there.  Only a facade whose old names are
also reached as attributes calls `refuse_old_names`.
"""
from importlib.abc import MetaPathFinder
import sys
from typing import Any, Callable, Iterable, TypeVar

from ballbot_ros.errors import RenamedError

Class = TypeVar('Class', bound=type)

# Modules, and names of packages -> where they are now.
PYTHON = {
    'ballbot_ros.fields': 'ballbot_ros.config.fields',
    'ballbot_ros.paths': 'ballbot_ros.config.files',
    'ballbot_ros.hardware': 'ballbot_ros.drives',
    'ballbot_ros.drives.DRIVERS': 'ballbot_ros.drives.DRIVES',
    'ballbot_ros.laboratory': 'ballbot_ros.studies',
    'ballbot_ros.output': 'ballbot_ros.results, figures in ballbot_ros.figures',
    'ballbot_ros.bridge.report': 'ballbot_ros.bridge.session',
    'ballbot_ros.bridge.timeouts': 'ballbot_ros.studies.command_loss',
    'ballbot_ros.bridge.calibration': 'ballbot_ros.bridge.commissioning.calibration',
    'ballbot_ros.bridge.doctor': 'ballbot_ros.bridge.commissioning.doctor',
    'ballbot_ros.decision.fitting': 'ballbot_ros.studies.curve_fit',
    'ballbot_ros.decision.estimate': 'ballbot_ros.decision.planners.reach',
    'ballbot_ros.decision.policy': 'ballbot_ros.decision.planners.cubic',
    'ballbot_ros.decision.curve.Making': 'ballbot_ros.decision.curve.CurveProvenance',
    'ballbot_ros.emulator.device': 'ballbot_ros.drives.emulated_device',
    **{f'ballbot_ros.emulator.{vendor}': f'ballbot_ros.drives.{vendor}.emulated'
       for vendor in ('odrive', 'roboclaw', 'vesc')},
    'ballbot_ros.ros.timekeeper': 'ballbot_ros.ros.scheduler',
    'ballbot_ros.ros.lockstep': 'ballbot_ros.ros.run_control',
    'ballbot_ros.demo.story': 'ballbot_ros.demo.timeline',
    'ballbot_ros.demo.beginning': 'ballbot_ros.demo.synchronized_start',
    **{f'ballbot_ros.decision.{old}': 'ballbot_ros.decision.Pilot'
       for old in ('lean', 'wanted_speed', 'set_angle', 'approach_speed', 'approach')},
    'ballbot_ros.decision.decide': 'ballbot_ros.decision.Decider',
    'ballbot_ros.decision.Sighting': 'ballbot_ros.decision.Profile',
    'ballbot_ros.studies.uncertainty': 'ballbot_ros.physics.model.uncertainty',
    'ballbot_ros.studies.parameters': 'ballbot_ros.physics.model.named_parameters',
    'ballbot_ros.results.Face': 'ballbot_ros.results.FaceMeeting',
    'ballbot_ros.studies.sweep_plan.Plan': 'ballbot_ros.studies.sweep_plan.SweepPlan',
    'ballbot_ros.decision.Track': 'ballbot_ros.decision.Profile',
    'ballbot_ros.decision.TrackedStep': 'ballbot_ros.decision.Face',
    'ballbot_ros.decision.values.StepObservation':
        'ballbot_ros.decision.observations.StepObservation',
    'ballbot_ros.plant.commands': 'ballbot_ros.control.command_gate',
    'ballbot_ros.plant.CommandGate': 'ballbot_ros.control.CommandGate',
    'ballbot_ros.control.linear': 'ballbot_ros.control.rolling_model',
    **{f'ballbot_ros.control.{old}': f'ballbot_ros.control.RollingModel, method {new}'
       for old, new in (('held_acceleration', 'held_acceleration'),
                        ('linear_rolling', 'about_held'),
                        ('rolling_accelerations', 'accelerations'))},
    'ballbot_ros.estimation.Rolling': 'ballbot_ros.control.RollingModel',
    'ballbot_ros.estimation.rolling': 'ballbot_ros.control.rolling_model',
    'ballbot_ros.plant.pace': 'ballbot_ros.plant.pacing',
    'ballbot_ros.plant.sensor': 'ballbot_ros.plant.step_sensor',
    'ballbot_ros.physics.crossing': 'ballbot_ros.crossing',
    'ballbot_ros.physics.dynamics': 'ballbot_ros.physics.mechanics.equations',
    'ballbot_ros.physics.laws': 'ballbot_ros.physics.mechanics.laws',
    'ballbot_ros.physics.integrators': 'ballbot_ros.physics.solvers.registry',
    'ballbot_ros.physics.actuation': 'ballbot_ros.physics.model.actuation',
    'ballbot_ros.physics.options': 'ballbot_ros.physics.model.contact_options',
    'ballbot_ros.physics.robot': 'ballbot_ros.physics.model.robot',
    'ballbot_ros.physics.terrain': 'ballbot_ros.physics.model.terrain',
    'ballbot_ros.physics.model.Model': 'ballbot_ros.physics.simulation.model.Model',
    'ballbot_ros.physics.scene': 'ballbot_ros.physics.simulation.scene',
    'ballbot_ros.physics.trajectory': 'ballbot_ros.physics.simulation.trajectory',
    'ballbot_ros.physics.max_step': 'ballbot_ros.crossing.max_step_height',
    'ballbot_ros.physics.max_steps': 'ballbot_ros.crossing.max_step_heights',
    'ballbot_ros.physics.MaxStep': 'ballbot_ros.crossing.MaxStepHeight',
    'ballbot_ros.physics.crosses': 'ballbot_ros.crossing.try_step',
    'ballbot_ros.physics.drive_for': 'ballbot_ros.crossing.actuation_for',
    'ballbot_ros.physics.highest_step': 'ballbot_ros.crossing.max_step_height',
    **{f'ballbot_ros.physics.{name}': f'ballbot_ros.crossing.{name}' for name in (
        'cruising', 'held_at', 'rolling', 'Rules', 'Site', 'try_step')},
}

# Verbs of the command ``ballbot``.
VERBS = {'max-step': 'max-step-height'}

# Options of the command line, with their dashes.
OPTIONS: dict[str, str] = {
    '--angle': '--angle-deg', '--slope': '--slope-deg', '--slopes': '--slopes-deg',
    '--slope-before': '--slope-before-deg', '--slope-behind': '--slope-behind-deg',
    '--lowest-speed': '--speed FIRST:LAST:COUNT', '--highest-speed': '--speed FIRST:LAST:COUNT',
    '--points': '--speed FIRST:LAST:COUNT'}

# Parameters of the nodes.
PARAMETERS: dict[str, str] = {}

# Keys of YAML files, and words that are values there or on the command line.
KEYS: dict[str, str] = {}


# Words of any of these that have no successor, and why.
GONE = {'reduced': 'rolling without slip as a simpler model is gone, for it made runs slower; '
                   'see docs/model.md'}


def remark(name: str, known: Iterable[str]) -> str:
    """Return what became of an old name, if it is one of `known` or gone; else nothing."""
    names = set(known)
    for table in (VERBS, OPTIONS, PARAMETERS, KEYS):
        if table.get(name) in names:
            return f'it is now {table[name]!r}'
    return GONE.get(name, '')


def refuse_old_names(facade: dict[str, Any]) -> None:
    """
    Let the namespace of a module, its ``globals()``, answer an old attribute with `RenamedError`.

    A name that never was gives `AttributeError`, as usual.  Not written as a ``__getattr__`` in
    the module: mypy would take any name of it for given.
    """
    module = facade['__name__']

    def __getattr__(name: str) -> Any:
        _refuse(f'{module}.{name}')
        raise AttributeError(f'module {module!r} has no attribute {name!r}')
    facade['__getattr__'] = __getattr__


def old_attributes(**renamed: str) -> Callable[[Class], Class]:
    """Return a decorator that lets the instances of a class name what an old attribute became."""
    def mark(cls: Class) -> Class:
        def __getattr__(self: Any, name: str) -> Any:
            now = f'; it is now {renamed[name]!r}' if name in renamed else ''
            raise AttributeError(f'{cls.__name__!r} object has no attribute {name!r}{now}')
        setattr(cls, '__getattr__', __getattr__)
        return cls
    return mark


class _OldNames(MetaPathFinder):
    """
    Finds nothing, and refuses what has moved.

    Asked first: an older copy of this package that is installed, too, still has the old modules,
    and `ballbot_ros.__path__` joins it to this one.
    """

    def find_spec(self, fullname: str, path: Any = None, target: Any = None) -> None:
        """Raise `RenamedError` for an old name."""
        _refuse(fullname)


def _refuse(name: str) -> None:
    if name in PYTHON:
        raise RenamedError(f'{name} is now {PYTHON[name]}')


def watch_imports() -> None:
    """Let the import of an old module name the new one; once is enough."""
    if not any(isinstance(finder, _OldNames) for finder in sys.meta_path):
        sys.meta_path.insert(0, _OldNames())
