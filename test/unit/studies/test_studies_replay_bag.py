# SPDX-License-Identifier: Apache-2.0
"""Replay of bags: bit-identical for the simulator, a comparison with the model for a robot."""
from dataclasses import replace
import json
import math
from pathlib import Path
import shlex
import sys
from types import SimpleNamespace

from bag_of_a_run import BagOf
import numpy as np
import pytest
from refusals import refused

from ballbot_ros.bags import opener
from ballbot_ros.bags.metadata import bag_metadata, BRIDGE, SIMULATOR
from ballbot_ros.bags.recorded_run import read_run
from ballbot_ros.cli.command import main
from ballbot_ros.physics import load_scene, Solver
from ballbot_ros.plant import Plant

RATE, PERIODS = 500.0, 400
SETTINGS = {'scene': 'flat', 'lockstep': True}


def plant_of(scene='flat', robot=None, **changes):
    scene = load_scene(scene, robot, Solver('rk4', 1e-4))
    if changes:
        model = replace(scene.model, robot=replace(scene.model.robot, **changes))
        scene = replace(scene, model=model)
    return Plant(scene, RATE)


def wanted(number):
    """Return a torque that changes each period and sometimes exceeds the limit of the motor."""
    return 0.5 * math.sin(0.05 * number) + (20.0 if number % 97 == 0 else 0.0)


def record(folder, metadata=None, late=(), lost=(), reset_at=None, namespace='', plant=None):
    """Write the bag of a run; commands of `late` periods are late, those of `lost` are missing."""
    plant = plant or plant_of()
    bag = BagOf(folder, bag_metadata(SIMULATOR, SETTINGS, load_scene('flat'))
                if metadata is None else metadata, namespace)
    for number in range(PERIODS):
        stamp = bag.state(plant)
        if number == reset_at:
            plant.reset()
            bag.state(plant)
        if number not in lost:
            bag.joints('joint_commands', stamp, ['pendulum'], effort=[wanted(number)])
        plant.advance(wanted(number - (number in late)))
    bag.state(plant)
    bag.joints('joint_commands', stamp, ['pendulum'], effort=[0.0])  # from a controller that stops
    bag.writer.close()
    return folder


def replayed(capsys, *words):
    """Return exit code, standard output and standard error of a replay."""
    code = main(['replay', *map(str, words)])
    return (code, *capsys.readouterr())


def test_the_replay_of_a_simulated_run_is_bit_identical(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, _ = replayed(capsys, record(tmp_path / 'bag'))
    assert code == 0 and f'identical: {PERIODS + 1} states' in out
    assert not (tmp_path / 'ballbot_output').exists()  # there is nothing to report


def test_a_lost_command_is_replaced_by_the_torque_of_the_motor(tmp_path, capsys):
    code, out, _ = replayed(capsys, record(tmp_path / 'bag', lost=(7, 8)))
    assert code == 0 and '2 are missing' in out and f'identical: {PERIODS + 1} states' in out


def test_a_reset_is_replayed(tmp_path, capsys):
    code, out, _ = replayed(capsys, record(tmp_path / 'bag', reset_at=200))
    assert code == 0 and '1 resets' in out and f'identical: {PERIODS + 2} states' in out


def test_with_late_commands_the_torque_of_the_motor_confirms_the_model(tmp_path, capsys):
    code, out, _ = replayed(capsys, record(tmp_path / 'bag', late=(100,)))
    assert code == 0
    assert 'departs at t = 0.202 s, after 101 identical states: ball angle' in out
    assert f'identical: {PERIODS + 1} states' in out


def test_a_paused_start_that_was_published_before_the_recording_is_replayed(tmp_path, capsys):
    plant = plant_of()
    plant.advance(wanted(0))
    code, out, _ = replayed(capsys, record(tmp_path / 'bag', plant=plant))
    assert code == 0 and f'identical: {PERIODS + 1} states' in out


def test_a_bag_that_lacks_the_start_of_the_run_is_explained(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr('ballbot_ros.cli.replay.write', lambda *results: [])
    plant = plant_of()
    for number in range(100):
        plant.advance(wanted(number))
    code, out, _ = replayed(capsys, record(tmp_path / 'bag', plant=plant))
    assert code == 1 and 'start_paused' in out


@pytest.mark.slow
def test_another_robot_is_reported_by_its_digest_and_its_first_difference(tmp_path, capsys):
    plant = plant_of(pendulum_mass=2.0)
    code, out, _ = replayed(
        capsys, record(tmp_path / 'bag', plant=plant, metadata=bag_metadata(
            SIMULATOR, SETTINGS, replace(load_scene('flat'), model=plant.model))),
        '--out', tmp_path / 'out', '--format', 'png')
    assert code == 1
    assert 'parameters of the robot are not those of the recording: digest' in out
    assert 'departs at t = 0.000 s, after 0 identical states' in out
    content = json.loads((tmp_path / 'out' / 'replay.json').read_text())
    assert content['identical'] is False
    assert {item['channel'] for item in content['differences']} >= {'x', 'joint_angle'}
    assert (tmp_path / 'out' / 'replay.png').stat().st_size > 5000


@pytest.mark.slow
def test_parameters_missing_in_a_bag_are_requested(tmp_path, capsys, refuses):
    bag = record(tmp_path / 'bag', metadata={})
    refuses('missing', '--scene', 'replay', bag)
    code, out, _ = replayed(capsys, bag, '--scene', 'flat')
    assert code == 0 and 'flat, robot gimball, 500 Hz' in out
    refuses('inconsistent', 'control_rate', 'replay', bag, '--scene', 'flat', '--set',
            'control_rate=400')
    refuses('unknown_name', 'contrl_rate', 'replay', bag, '--scene', 'flat', '--set',
            'contrl_rate=400')
    refuses('inconsistent', '--before', 'replay', bag, '--before', '3')


def test_a_missing_file_of_a_bag_is_reported_with_the_options_that_replace_it(tmp_path, refusal):
    metadata = bag_metadata(SIMULATOR, {**SETTINGS, 'scene': 'gone.yaml'}, load_scene('flat'))
    bag = record(tmp_path / 'bag', metadata)
    error = refusal('replay', bag)
    assert (error.reason, error.field) == ('missing', 'scene')
    message = str(error)
    assert 'gone.yaml' in message and str(bag) in message
    assert '--scene' in message and '--robot' in message


def test_a_malformed_parameter_is_refused(tmp_path, refuses):
    bag = record(tmp_path / 'bag')
    for word in ('control_rate', 'control_rate=['):
        refuses('wrong_type', '--set', 'replay', bag, '--set', word)


def test_with_two_robots_the_namespace_is_required(tmp_path, capsys):
    plant = plant_of()
    bag = BagOf(tmp_path / 'bag', {})
    for bag.namespace in ('/left', '/right'):
        bag.state(plant)
    bag.writer.close()
    with refused('ambiguous', '--namespace'):
        read_run(tmp_path / 'bag')
    assert read_run(tmp_path / 'bag', 'left').stamps == [0]
    with refused('unknown_name', '--namespace') as caught:
        read_run(tmp_path / 'bag', 'rihgt')
    assert "'/right'" in str(caught.value)


def test_foreign_and_damaged_bags_are_refused(tmp_path, refuses):
    bag = BagOf(tmp_path / 'foreign', {})
    bag.write('imu', 'sensor_msgs/msg/JointState', 0, name=[], position=np.array([]),
              velocity=np.array([]), effort=np.array([]))
    bag.writer.close()
    file = record(tmp_path / 'cut') / 'cut.mcap'
    data = file.read_bytes()
    file.write_bytes(data[:len(data) // 2])
    (tmp_path / 'odd').mkdir()
    (tmp_path / 'odd' / 'metadata.yaml').write_text('{')
    refuses('wrong_kind', 'joint_states', 'replay', tmp_path / 'foreign')
    for name in ('cut', 'odd', 'none.mcap'):
        refuses('unreadable', str(tmp_path / name), 'replay', tmp_path / name)
    for content in (b'', b'hello', bytes(100)):
        (tmp_path / 'odd.mcap').write_bytes(content)
        refuses('wrong_kind', str(tmp_path / 'odd.mcap'), 'replay', tmp_path / 'odd.mcap')
    (tmp_path / 'odd.mcap').write_bytes(data[:8])
    refuses('unreadable', str(tmp_path / 'odd.mcap'), 'replay', tmp_path / 'odd.mcap')


def record_robot(folder):
    """Write the bag of a real robot, with another joint friction and offsets of the angles."""
    plant = plant_of(joint_friction=0.1)
    bag = BagOf(folder, bag_metadata(BRIDGE, {'hardware': 'gimball_vesc'}))
    rng = np.random.default_rng(1)
    for number in range(PERIODS):
        state, stamp = plant.state, round(plant.time * 1e9) + 5 * 10**9
        noise = rng.normal(0.0, 1e-4, 2)
        bag.joints('joint_states', stamp, ['shell', 'pendulum'],
                   [state.ball_angle + 7.0 + noise[0], state.joint_angle - 7.0 + noise[1]],
                   [state.ball_rate, state.joint_rate], [0.0, plant.torque])
        plant.advance(wanted(number))
    bag.writer.close()
    return folder


@pytest.mark.slow
def test_the_differences_of_a_real_robot_are_reported_and_its_recording_can_be_identified(
        tmp_path, capsys):
    folder = tmp_path / 'my out'
    code, out, _ = replayed(capsys, record_robot(tmp_path / 'bag'), '--out', folder,
                            '--format', 'png')
    assert code == 0
    assert 'real robot, 400 states in 0.798 s; the model is gimball on flat' in out
    content = json.loads((folder / 'replay.json').read_text())
    worst = {item['channel']: item['largest'] for item in content['differences']}
    assert worst['joint_angle'] > 0.01
    hint = shlex.split(out.rpartition('ballbot ')[2])
    assert hint[:3] == ['identify', str(folder / 'scene.yaml'), str(folder / 'recording.csv')]
    assert main([*hint[:-1], '--out', str(tmp_path / 'found'), '--quiet']) == 0
    found = json.loads((tmp_path / 'found' / 'identify.json').read_text())
    assert found['estimates'][0]['value'] == pytest.approx(0.1, rel=0.02)


class FakeRosbag2:
    """The part of `rosbag2_py`, and of its `SequentialReader`, that the package uses."""

    def __init__(self, *messages):
        self.messages = list(messages)
        self.StorageOptions = self.ConverterOptions = lambda *_, **given: given.get('uri')

    def SequentialReader(self):
        return self

    def open(self, path, _):
        if not Path(path).exists():
            raise RuntimeError('no such bag')

    def get_all_topics_and_types(self):
        return [SimpleNamespace(name='/joint_states', type='sensor_msgs/msg/JointState')]

    def get_metadata(self):
        return SimpleNamespace(custom_data={'key': 'value'})

    def has_next(self):
        return bool(self.messages)

    def read_next(self):
        if self.messages[0] is None:
            raise RuntimeError('chunk is damaged')
        return self.messages.pop(0)


def test_a_bag_is_read_with_rosbag2_py_if_ros_provides_it(tmp_path, monkeypatch):
    messages = pytest.importorskip('sensor_msgs.msg')
    from rclpy.serialization import serialize_message
    state = messages.JointState(name=['shell', 'pendulum'], position=[1.0, 2.0],
                                velocity=[3.0, 4.0], effort=[0.0, 5.0])
    data = serialize_message(state)

    def use(*contents):
        monkeypatch.setitem(sys.modules, 'rosbag2_py', FakeRosbag2(*contents))
    # This simulates a machine without rosbags.
    monkeypatch.setattr(opener, 'find_spec', lambda name: name == 'rosbag2_py' or None)
    use(('/joint_states', data, 0), ('/other', b'', 0))
    run = read_run(tmp_path)
    assert run.metadata == {'key': 'value'}
    assert run.joints == {0: [{'ball_angle': 1.0, 'ball_rate': 3.0, 'joint_angle': 2.0,
                               'joint_rate': 4.0, 'pendulum_torque': 5.0}]}
    use(None)
    for damaged in (tmp_path, tmp_path / 'none'):
        with refused('unreadable'):
            read_run(damaged)
