# SPDX-License-Identifier: Apache-2.0
"""Replay a bag of a real robot: where the model departs from what was measured."""
import argparse
from typing import Any

from ballbot_ros.cli.replayed import COMMANDS, Replayed, SET_POINTS, table
from ballbot_ros.errors import ConfigurationError


def replay_robot(arguments: argparse.Namespace, run: Any, metadata: Any) -> Replayed:
    """Drive the model by the recorded torque, from the first state, and compare."""
    from ballbot_ros.bags.departures import (
        commanded_torque, differences, driven_series, measured_columns, scene_content)
    from ballbot_ros.physics.simulation.scene import read_scene
    from ballbot_ros.results.summary import plain
    refuse(arguments)
    robot = arguments.robot or robot_of(metadata, arguments)
    columns = measured_columns(run)
    by = arguments.by or ('torques' if 'pendulum_torque' in columns else COMMANDS)
    if by == COMMANDS:
        columns['pendulum_torque'] = commanded_torque(run, columns)
    elif 'pendulum_torque' not in columns:
        raise ConfigurationError(
            f'{arguments.file}: its joint_states have no effort; --by commands takes what was '
            'commanded')
    content = scene_content(arguments.scene or 'flat', robot, columns, from_scene=True)
    scene = read_scene(content, 'scene of the recording', 'recording')
    series = driven_series(scene, columns)
    numbers = differences(series)
    what = 'commanded' if by == COMMANDS else 'that the motor gave by joint_states'
    name = scene.model.robot.name
    words = (f'real robot, {len(columns["time"])} states in {columns["time"][-1]:.3f} s; the '
             f'model is {name} on {arguments.scene or "flat"}, from the first state, under the '
             f'torque {what}\n\n{table(numbers)}')
    return Replayed(words, plain({
        'identical': None, 'driven_by': by, 'robot': name,
        'states': len(columns['time']), 'duration': float(columns['time'][-1]),
        'differences': [item._asdict() for item in numbers]}), series, None,
        {'recording.csv': columns, 'scene.yaml': content})


def refuse(arguments: argparse.Namespace) -> None:
    """Refuse options that only a bag of the simulator takes."""
    if arguments.set:
        raise ConfigurationError(
            f'--set is for a bag of the simulator; {arguments.file} is of a real robot')
    if arguments.by == SET_POINTS:
        raise ConfigurationError(
            '--by set-points is for a bag of the simulator with control:=onboard: a real robot '
            'was driven by its own estimate of its state; take torques')


def robot_of(metadata: Any, arguments: argparse.Namespace) -> str:
    """Return the robot that the hardware file of a bridge names; empty for that of the scene."""
    hardware = metadata.parameters.get('hardware')
    if not hardware or arguments.scene:
        return ''
    from ballbot_ros.bridge.hardware_file import load_hardware
    return str(load_hardware(str(hardware)).robot)
