# SPDX-License-Identifier: Apache-2.0
"""Replay a bag of the simulator: the same commands, from the same start, bit for bit."""
import argparse
import statistics
from typing import Any

from ballbot_ros.cli.replayed import COMMANDS, parameters_of, Replayed, SET_POINTS, table, TORQUES


def replay_simulator(arguments: argparse.Namespace, run: Any, metadata: Any) -> Replayed:
    """Run again, by commands first, and say whether all states are the same."""
    from ballbot_ros.bags.rerun import rerun
    from ballbot_ros.physics import load_scene
    from ballbot_ros.physics.simulation.solver import Solver
    from ballbot_ros.plant import Plant
    from ballbot_ros.results.summary import plain
    known = dict(metadata.parameters)
    if 'control_rate' not in known and len(run.stamps) > 2 and known.get('control') != 'onboard':
        steps = [after - before for before, after in zip(run.stamps, run.stamps[1:])]
        known['control_rate'] = round(1e9 / statistics.median(steps), 6)
    settings = parameters_of(arguments, known)
    scene = load_scene(settings.scene, settings.robot or None,
                       Solver(settings.method, settings.physics_step))
    remarks = differing(metadata, scene)

    def again(by: str) -> Any:
        plant = Plant(scene, settings.control_rate, settings.torque_limit or None,
                      settings.accuracy or None)
        return rerun(plant, run, source(by, run, settings, scene))
    ways = [arguments.by] if arguments.by else ways_of(settings, run)
    found = [again(ways[0])]
    # By what the motor gave, the model is to blame for a difference, and not when commands came.
    if found[0].departure is not None:
        found += [again(way) for way in ways[1:]]
    best = max(found, key=lambda item: item.identical)
    lines = [f'simulator, scene {settings.scene}, robot {scene.model.robot.name}, '
             f'{settings.control_rate:g} Hz', *remarks]
    for item in found:
        lines += wording(item)
    series, numbers = compared(best)
    if best.departure is not None and numbers:
        lines += ['', table(numbers)]
    identical = best.departure is None and not best.ended
    content = plain({
        'identical': identical, 'remarks': remarks,
        'runs': [{'driven_by': item.what, 'states': item.states, 'identical': item.identical,
                  'applied': item.applied, 'filled': item.filled, 'resets': item.resets,
                  'ended': item.ended,
                  'departure': item.departure and vars(item.departure)} for item in found],
        'differences': [item._asdict() for item in numbers]})
    return Replayed('\n'.join(lines), content, series, identical)


def ways_of(settings: Any, run: Any) -> list[str]:
    """Return what may have driven the run, the best first."""
    if settings.control == 'onboard':
        return [SET_POINTS]
    return [COMMANDS, TORQUES] if run.commands else [TORQUES]


def source(by: str, run: Any, settings: Any, scene: Any) -> Any:
    """Return where the torque comes from."""
    from ballbot_ros.bags.rerun import Commands, Laws, MotorTorques
    from ballbot_ros.control import checked_controller, load_tuning, Supervision
    if by == SET_POINTS:
        return Laws(run, checked_controller(
            scene.model.robot, load_tuning(settings.tuning), settings.control_rate, 0,
            Supervision(set_point_timeout=settings.set_point_timeout)))
    return Commands(run) if by == COMMANDS else MotorTorques(run)


def differing(metadata: Any, scene: Any) -> list[str]:
    """Return what is not as it was when the bag was made."""
    from ballbot_ros import __version__
    from ballbot_ros.results.digests import scene_digests
    here, lines = scene_digests(scene), []
    for name, what in (('scene', 'terrain, contact or start'), ('robot', 'numbers of the robot')):
        there = metadata.digests.get(name, here[name])
        if there != here[name]:
            lines.append(f'{what} are not those of the recording: digest {here[name]} here, '
                         f'{there} there')
    if metadata.version not in ('', __version__):
        lines.append(f'recorded with version {metadata.version}, this is {__version__}')
    return lines


def wording(found: Any) -> list[str]:
    """Return what became of a run, in lines."""
    lines = [f'driven by {found.applied} {found.what}'
             + (f'; {found.filled} are missing, in their place what the motor gave'
                if found.filled else '')
             + (f'; {found.resets} resets' if found.resets else '')]
    if found.departure is None:
        lines.append(f'identical: {found.identical} states')
    else:
        first = found.departure
        lines.append(
            f'departs at t = {first.time:.3f} s, after {first.states} identical states: '
            f'{first.channel.replace("_", " ")} {first.recorded!r} in the recording, '
            f'{first.again!r} now; {found.identical} of {found.states} states are identical')
    if found.ended:
        lines.append(f'ended early: {found.ended}')
    return lines


def compared(found: Any) -> tuple[Any, list[Any]]:
    """Return times, recorded and model of all channels, and their differences."""
    import numpy as np

    from ballbot_ros.bags.departures import differences
    series = {name: (np.array(list(values)), np.array(list(values.values())),
                     np.array([found.again[name][time] for time in values]))
              for name, values in found.recorded.items() if len(values) > 1}
    return series, differences(series)
