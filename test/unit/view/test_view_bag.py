# SPDX-License-Identifier: Apache-2.0
"""A bag on the page: recorded values are shown at their time, missing ones are not invented."""
from types import SimpleNamespace

import numpy as np
import pytest
from refusals import refused

from ballbot_ros.bags.metadata import bag_metadata, SIMULATOR
from ballbot_ros.bags.writer import message_types, RosbagsWriter
from ballbot_ros.decision import Kind, Reason
from ballbot_ros.physics import load_robot, load_scene
from ballbot_ros.view.assembly import FrameAssembly, KINDS, REASONS
from ballbot_ros.view.bag_source import BagSource, Playback

GIMBALL = load_robot('gimball')
TYPES = message_types()


def header(time, frame=''):
    stamp = TYPES.types['builtin_interfaces/msg/Time'](int(time), round(time % 1 * 1e9))
    return TYPES.types['std_msgs/msg/Header'](stamp, frame)


def joint_state(time, shell, joint):
    return TYPES.types['sensor_msgs/msg/JointState'](
        header(time), ['shell', 'pendulum'], np.array([shell, joint]), np.array([-1.0, 1.5]),
        np.array([0.0, 0.7]))


def odometry(time, x):
    make = TYPES.types
    vector, point = make['geometry_msgs/msg/Vector3'], make['geometry_msgs/msg/Point']
    pose = make['geometry_msgs/msg/Pose'](
        point(x, 0.0, 0.226), make['geometry_msgs/msg/Quaternion'](0.0, 0.0, 0.0, 1.0))
    twist = make['geometry_msgs/msg/Twist'](vector(0.5, 0.0, 0.0), vector(0.0, 0.0, 0.0))
    return make['nav_msgs/msg/Odometry'](
        header(time), 'base_link', make['geometry_msgs/msg/PoseWithCovariance'](
            pose, np.zeros(36)), make['geometry_msgs/msg/TwistWithCovariance'](
                twist, np.zeros(36)))


def looked(time, points):
    x, z = (np.array(values) for values in zip(*points))
    return TYPES.types['ballbot_ros/msg/TerrainObservation'](
        header(time, 'base_link'), x, z, np.zeros(len(x)), float(x[0]), float(x[-1]))


def write_bag(folder, messages, metadata=None):
    """Write (topic, message, time) to a bag; the bag time may differ from the stamp."""
    writer, connections = RosbagsWriter(folder, metadata or {}), {}
    writer.open()
    for topic, message, time in messages:
        kind = message.__msgtype__
        if topic not in connections:
            connections[topic] = writer.add_topic(topic, kind)
        writer.write(connections[topic], round(time * 1e9), TYPES.serialize_cdr(message, kind))
    writer.close()
    return folder


def rolling(begin=0.0, seconds=2.0, prefix=''):
    """Yield joint states at 100 Hz and odometry at 50 Hz of a ball that rolls at 0.5 m/s."""
    for number in range(round(100 * seconds) + 1):
        time = begin + 0.01 * number
        if number % 2 == 0:
            yield f'{prefix}/odom', odometry(time, 0.005 * number), time
        yield f'{prefix}/joint_states', joint_state(time, -0.02 * number, 0.03 * number), time


@pytest.fixture
def played():
    """Return a function that opens a bag and returns its source, read to the end."""
    opened = []

    def play(path, **options):
        source = BagSource(path, **options)
        opened.append(source)
        source.start()
        source._thread.join()
        return source

    yield play
    for source in opened:
        source.close()


def test_a_bag_without_the_true_state_shows_the_measurements(tmp_path, played):
    source = played(write_bag(tmp_path / 'bag', rolling(begin=1.7e9)), robot='gimball')
    assert source.history.span == (0.0, pytest.approx(2.0)) and len(source.history) == 201
    source.apply('seek', 1.0)
    frame = source.shown
    assert frame.time == pytest.approx(1.0, abs=1e-6) and frame.x == pytest.approx(0.5)
    assert frame.ball_angle == pytest.approx(-2.0)
    assert frame.pendulum_angle == pytest.approx(1.0)  # absolute: shell and joint together
    assert frame.pendulum_torque == 0.7
    assert frame.contacts is None and frame.energies is None and frame.decision is None
    assert frame.e_stop is None and source.terrain is None
    assert not source.health.notes


def test_the_metadata_of_a_bag_give_robot_and_ground(tmp_path, played):
    made = bag_metadata(SIMULATOR, {'scene': 'shellball_drop'}, load_scene('shellball_drop'))
    source = played(write_bag(tmp_path / 'bag', rolling(), made))
    assert source.robot.name == 'shellball'
    assert source.terrain is load_scene('shellball_drop').model.terrain or (
        source.terrain.vertices == load_scene('shellball_drop').model.terrain.vertices).all()


def test_the_curve_is_that_of_the_recorded_decision(tmp_path, played):
    for name, decision in (('no', None), ('held', {'curve': 'gimball_horizontal'}),
                           ('gone', {'curve': '/nowhere/mine.yaml'})):
        made = bag_metadata(SIMULATOR, {'scene': 'doorstep'}, decision=decision)
        source = played(write_bag(tmp_path / name, rolling(), made))
        assert source.curve.name == ('gimball_horizontal' if name == 'held' else 'gimball_down')
        assert bool(source.health.notes) is (name == 'gone')
    assert '/nowhere/mine.yaml' in source.health.notes[0]


def test_a_bag_in_which_time_restarts_shows_the_last_run_and_a_note(
        tmp_path, played):
    again = [(topic, message, time + 5.0) for topic, message, time in rolling()]
    source = played(write_bag(tmp_path / 'bag', [*rolling(), *again]))
    assert any('This bag contains 2 runs' in note for note in source.health.notes)
    assert source.history.span == (0.0, pytest.approx(2.0, abs=0.01))


def test_a_bag_without_a_robot_is_drawn_as_gimball_with_a_note(tmp_path, played):
    source = played(write_bag(tmp_path / 'bag', rolling()))
    assert source.robot.name == 'gimball' and '--robot NAME' in source.health.notes[0]


def test_unknown_ground_is_that_of_the_observations(tmp_path, played):
    messages = list(rolling())
    for time in (0.505, 1.505):
        ahead = 1.0 - 0.5 * (time - 0.005)
        messages.append(('/terrain_observation', looked(
            time, [(-0.3, -0.226), (ahead, -0.226), (ahead, -0.176), (2.0, -0.176)]), time))
    source = played(write_bag(tmp_path / 'bag', sorted(messages, key=lambda item: item[2])))
    assert source.terrain.height(0.9) == pytest.approx(0.0, abs=1e-9)
    assert source.terrain.height(1.1) == pytest.approx(0.05)
    assert source.terrain.height(2.6) == pytest.approx(0.05)


def test_an_initial_message_without_a_stamp_does_not_thin_out_the_frames(tmp_path, played):
    # A latched e-stop was recorded at 0, the other messages at the current time.
    stop = TYPES.types['std_msgs/msg/Bool'](True)
    source = played(write_bag(tmp_path / 'bag', [('/e_stop', stop, 0.0), *rolling(1.7e9)]))
    assert len(source.history) == 201 and source.shown.e_stop is True


def test_one_of_several_robots_must_be_selected(tmp_path, played):
    bag = write_bag(tmp_path / 'bag', sorted(
        [*rolling(prefix='/left'), *rolling(prefix='/right', seconds=1.0)],
        key=lambda item: item[2]))
    with refused('ambiguous', '--namespace'):
        BagSource(bag)
    with refused('unknown_name', '--namespace'):
        BagSource(bag, namespace='middle')
    assert played(bag, namespace='/right').history.span[1] == pytest.approx(1.0)


def test_a_bag_of_the_demo_is_opened_by_its_folder_or_its_file(tmp_path, played):
    bag = write_bag(tmp_path / 'doorstep' / 'bag', rolling())
    assert played(tmp_path / 'doorstep').title == 'Bag doorstep/bag'
    assert len(played(next(bag.glob('*.mcap'))).history) == 201


@pytest.mark.parametrize('make', [
    lambda path: None, lambda path: path.mkdir(), lambda path: path.write_bytes(b'nothing')])
def test_a_path_without_a_bag_is_refused(tmp_path, make):
    make(tmp_path / 'bag')
    with refused('unreadable'):
        BagSource(tmp_path / 'bag')


def test_a_bag_of_something_else_is_refused(tmp_path):
    bag = write_bag(tmp_path / 'bag', [('/odom', odometry(0.0, 0.0), 0.0)])
    with refused('wrong_kind', 'joint_states'):
        BagSource(bag)


def test_controls_play_pause_seek_and_refuse(tmp_path, played):
    source = played(write_bag(tmp_path / 'bag', rolling()))
    source.apply('pause', True)
    source.apply('seek', 0.5)
    source.apply('step', 0.25)
    assert source.shown.time == pytest.approx(0.75) and not source.health.running
    source.apply('speed', 0.05)
    source.apply('pause', False)
    assert source.health.running
    source.apply('reset', True)
    assert source.controls['speed'].value == 0.05
    for name, value, reason in (('seek', 3.0, 'out_of_range'), ('speed', 0.0, 'out_of_range'),
                                ('pause', 1.0, 'wrong_type'),
                                ('step_height', 0.03, 'unknown_name')):
        with refused(reason, name):
            source.apply(name, value)


def test_a_playback_follows_the_clock_and_restarts_after_its_end():
    now, span = [10.0], [(2.0, 6.0)]
    play = Playback(lambda: span[0], lambda: now[0])
    assert play.place == 2.0
    now[0] += 1.0
    assert play.place == 3.0 and not play.paused
    play.set_speed(2.0)
    now[0] += 1.0
    assert play.place == 5.0
    now[0] += 5.0
    assert play.place == 6.0 and play.paused
    play.pause(False)
    assert play.place == 2.0 and not play.paused
    play.pause(True)
    now[0] += 5.0
    assert play.place == 2.0
    play.seek(4.0)
    play.pause(False)
    now[0] += 0.5
    assert play.place == 5.0


def test_decisions_and_reasons_have_the_values_of_the_message():
    for values, kinds in ((KINDS, Kind), (REASONS, Reason)):
        assert set(values.values()) == {'unknown', *(kind.value for kind in kinds)}
    assert KINDS[2] == 'cross' and REASONS[18] == 'likely'


def test_the_true_state_precedes_the_measured_one_while_it_is_published():
    assembly = FrameAssembly(GIMBALL)
    state = SimpleNamespace(
        header=header(1.0), x=0.5, y=0.2, ball_angle=0.0, pendulum_angle=np.nan, velocity_x=0.0,
        velocity_y=0.0, ball_rate=0.0, pendulum_rate=np.nan, pendulum_torque=np.nan,
        position_x=0.4, position_y=0.3, heading=0.6, lean=0.1, tilt=-0.2, contacts=[],
        kinetic_energy=0.0, potential_energy=0.0, contact_energy=0.0, dissipated_energy=0.0,
        motor_work=0.0)
    frame = assembly.take('ball_state', state)
    assert frame.contacts == () and frame.pendulum_angle is None
    assert (frame.place, frame.lean, frame.tilt) == ((0.4, 0.3, 0.6), 0.1, -0.2)
    assert assembly.take('joint_states', joint_state(1.1, 0.0, 0.0)) is None
    assert assembly.take('joint_states', joint_state(2.0, 0.0, 0.0)) is not None
