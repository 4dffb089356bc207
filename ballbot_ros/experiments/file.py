# SPDX-License-Identifier: Apache-2.0
"""The file of an experiment: scene, nodes and seeds; and the folder with all its inputs."""
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Dict, Mapping

import yaml

from ballbot_ros.config.fields import Checked, expect_mapping, quantity, section, text
from ballbot_ros.config.files import find_config, located, read_config
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.nodes.controller.settings import ControllerSettings
from ballbot_ros.nodes.obstacle_decision.settings import DecisionSettings
from ballbot_ros.nodes.simulator.settings import SimulatorSettings
from ballbot_ros.ros.settings import config_folders

FILE = 'experiment.yaml'
NODES: Mapping[str, Any] = {'simulator': SimulatorSettings, 'controller': ControllerSettings,
                            'obstacle_decision': DecisionSettings}
# Parameters that the experiment sets, and the reasons.
RESERVED_PARAMETERS = {
    'scene': 'it is a field of the experiment', 'robot': 'it is a field of the experiment',
    'seed': 'it is set to each of the seeds of the experiment',
    'lockstep': 'an experiment runs in lockstep', 'start_paused': 'the experiment starts the run',
    'real_time_factor': 'an experiment runs at maximum speed',
    'control': 'in lockstep, joint_commands answer each state',
    'lockstep_set_point_period': 'it is the period of the observations',
    'outcome_log': 'a run that learns from the previous one is not repeatable'}


@dataclass(frozen=True)
class Experiment(Checked):
    """Runs of a scene in lockstep, one for each seed."""

    scene: str = text('name of a scene or a YAML file')
    duration: float = quantity('s', 'simulated time of a run', above=0.0, maximum=3600.0)
    seeds: Any = section('whole numbers, the seeds of the sensor noise: one run for each')
    robot: str = text('name or file of a robot; empty keeps that of the scene', default='')
    simulator: Any = section('parameters of the node simulator', default=None)
    controller: Any = section('parameters of the node controller', default=None)
    obstacle_decision: Any = section(
        'parameters of the node obstacle_decision; if left out, the ball is not driven',
        default=None)
    # Parameters of each node, checked, with all rates of the simulator.
    nodes: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    @property
    def periods(self) -> int:
        """Return the number of control periods of a run."""
        return round(self.duration * float(self.nodes['simulator']['control_rate']))

    @property
    def period(self) -> float:
        """Return the period of the observations [s]; 0 without obstacle_decision."""
        simulator = self.nodes['simulator']
        return 1.0 / (simulator['terrain_rate'] or simulator['observation_rate']) \
            if 'obstacle_decision' in self.nodes else 0.0


def load_experiment(path: Path) -> Experiment:
    """
    Read the file of an experiment; the files that it names are relative to it.

    Raises `ConfigurationError` naming file, field, value and allowed range.
    """
    _, content = read_config('experiments', path.resolve())
    plan = Experiment.from_mapping(content, str(path))
    seeds = plan.seeds
    whole = isinstance(seeds, list) and seeds and all(
        isinstance(seed, int) and not isinstance(seed, bool) and 0 <= seed < 2**31
        for seed in seeds)
    if not whole or len(set(seeds)) < len(seeds):
        raise ConfigurationError(f'{path}: seeds must be a list of different whole numbers from 0 '
                                 f'to {2**31 - 1}, got {seeds!r}', 'not_a_choice', 'seeds')
    folder = path.resolve().parent
    plan = replace(plan, scene=located(plan.scene, folder))
    plan = replace(plan, nodes=_nodes(plan, path, folder))
    control_period = 1.0 / plan.nodes['simulator']['control_rate']
    step = plan.period or control_period
    if any(abs(plan.duration / each - round(plan.duration / each)) > 1e-6
           for each in (step, control_period)):
        raise ConfigurationError(
            f'{path}: duration must be a whole number of periods of {step:g} s, '
            f'got {plan.duration:g}', 'inconsistent', 'duration')
    return plan


def _nodes(plan: Experiment, path: Path, folder: Path) -> Dict[str, Dict[str, Any]]:
    """Return the parameters of each node; see `Experiment.nodes`."""
    nodes: Dict[str, Dict[str, Any]] = {}
    for name, kind in NODES.items():
        given = getattr(plan, name)
        if given is None and name == 'obstacle_decision':
            continue
        place = f'{path}: {name}'
        entries = dict(expect_mapping(given or {}, place))
        for key, why in RESERVED_PARAMETERS.items():
            if key in entries:
                raise ConfigurationError(
                    f'{place}: {key} cannot be set here: {why}', 'not_settable', key)
        for key in config_folders(kind).keys() & entries:
            if isinstance(entries[key], str):
                entries[key] = located(entries[key], folder)
        kind.from_mapping(entries, place)
        nodes[name] = entries
    simulator = nodes['simulator']
    simulator.setdefault('control_rate', SimulatorSettings.control_rate)
    simulator.setdefault('observation_rate', SimulatorSettings.observation_rate)
    simulator.setdefault(
        'terrain_rate', 0.0 if simulator['observation_rate'] else SimulatorSettings.terrain_rate)
    if 'obstacle_decision' in nodes \
            and bool(simulator['terrain_rate']) == bool(simulator['observation_rate']):
        raise ConfigurationError(
            f'{path}: simulator: in lockstep the decision answers each observation: one of '
            'terrain_rate and observation_rate must be above 0 Hz, and the other one 0',
            'inconsistent', 'observation_rate')
    return nodes


def freeze(plan: Experiment) -> Dict[str, str]:
    """
    Return the texts of the files with all inputs of an experiment, by file name.

    The first is the experiment itself, which names the others by relative paths.
    """
    files: Dict[str, str] = {}

    def keep(kind: str, name: str) -> str:
        source = find_config(kind, name)
        target = f'config/{kind}/{source.name}'
        content = source.read_text(encoding='utf-8')
        if files.get(target, content) != content:
            raise ConfigurationError(
                f'two files are named {source.name}: {source} is one of them',
                'inconsistent', kind)
        files[target] = content
        return f'./{target}'
    robot = plan.robot or str(read_config('scenes', plan.scene)[1].get('robot', ''))
    lines: Dict[str, Any] = {
        'scene': keep('scenes', plan.scene), 'robot': keep('robots', robot),
        'duration': plan.duration, 'seeds': list(plan.seeds)}
    for name, entries in plan.nodes.items():
        kind = NODES[name]
        folders = {key: folder for key, folder in config_folders(kind).items()
                   if key not in RESERVED_PARAMETERS}
        values = {**{key: getattr(kind, key) for key in folders}, **entries}
        lines[name] = {key: keep(folders[key], value) if key in folders else value
                       for key, value in values.items()}
    return {FILE: yaml.safe_dump(lines, sort_keys=False), **dict(sorted(files.items()))}


def node_parameters(plan: Experiment, seed: int) -> Dict[str, Dict[str, Any]]:
    """Return all parameters of each node of a run."""
    found = {name: {**entries, 'robot': plan.robot} for name, entries in plan.nodes.items()}
    found['simulator'].update(
        scene=plan.scene, seed=seed, lockstep=True, real_time_factor=0.0, start_paused=True)
    found['controller']['lockstep_set_point_period'] = plan.period
    return found
