# SPDX-License-Identifier: Apache-2.0
"""The demo as users start it: its output, its files, and its failures."""
import math
from pathlib import Path
import re
import signal
import subprocess
import sys

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
import numpy as np
from PIL import Image
import pytest
from rosbags.highlevel import AnyReader
from test_layouts import named_topics
from waiting import wait_until

from ballbot_ros.demo.processes import environment

TIMEOUT = 300.0
NODES = {'simulator', 'controller', 'obstacle_decision'}
README = Path(__file__).resolve().parents[2] / 'README.md'


@pytest.fixture
def demo(domain, tmp_path):
    """Return a function that starts ``ballbot demo``; the processes end with the test."""
    started = []

    def start(*arguments, together=False):
        surroundings = environment(domain, tmp_path)
        if together:  # as if the user had set no domain
            del surroundings['ROS_DOMAIN_ID']
        process = subprocess.Popen(
            [sys.executable, '-m', 'ballbot_ros.cli', 'demo', '--out', str(tmp_path / 'out'),
             *arguments], env=surroundings, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, text=True,
            # SIGINT is ignored if a shell runs the tests in the background, SIGHUP with nohup.
            preexec_fn=lambda: [signal.signal(number, signal.SIG_DFL)
                                for number in (signal.SIGINT, signal.SIGHUP)])
        started.append(process)
        return process
    yield start
    for process in started:
        process.terminate()
        process.communicate(timeout=TIMEOUT)


def timeline(text):
    """Return time [s] and text of each line with a time, without other numbers."""
    return [(float(time), re.sub(r'[\d.]+', '', words))
            for time, words in re.findall(r'^ +([\d.]+) s +(.+)$', text, re.M)]


def nodes_of(demo):
    """Return name and process id of the nodes that a demo has started."""
    names, parents = {}, {}
    for stat in Path('/proc').glob('[0-9]*/stat'):
        try:
            number, rest = stat.read_text().split(' (', 1)
        except (OSError, ValueError):
            continue  # the process has ended
        name, rest = rest.rsplit(') ', 1)
        names[int(number)], parents[int(number)] = name, int(rest.split()[1])
    found = {node: number for number, name in names.items() for node in NODES
             if name == node[:15] and parents.get(parents[number]) == demo.pid}
    return found


def nodes_once_logged(demo, logs, text, names=NODES):
    """Return the nodes of a demo, as `nodes_of`, once the logs of some contain a text."""
    paths = [logs / f'{name}.log' for name in names]
    wait_until(lambda: all(path.exists() and text in path.read_text() for path in paths))
    found = nodes_of(demo)
    assert found.keys() == NODES
    return found


@pytest.mark.slow
def test_from_an_empty_kernel_cache_both_scenes_succeed_and_all_topics_are_recorded(
        demo, monkeypatch, tmp_path):
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path / 'cache'))
    process = demo('--timeout', '250', together=True)
    printed = process.communicate(timeout=2.0 * TIMEOUT)[0]
    assert process.returncode == 0, printed
    assert list((tmp_path / 'cache' / 'ballbot_ros').rglob('*.nbi'))
    order = ['detects  a step of 31 mm', 'CROSS', 'swing', 'over with', 'touches  the 31 mm step',
             'the plan crosses', 'crossed', 'GO ROUND', '80 mm at', 'rests',
             'before the 80 mm step', 'Done:', 'STOP', 'rests',
             'before the 100 mm drop', 'Done:']
    place = 0
    for words in order:
        assert (place := printed.find(words, place)) >= 0, (words, printed)
    shown = timeline(README.read_text(encoding='utf-8'))
    assert len(shown) > 4
    for time, words in shown:  # up to the rounding of another processor
        assert [found for found, others in timeline(printed)
                if words == others and abs(found - time) < 0.1], (time, words, printed)

    with Image.open(tmp_path / 'out' / 'doorstep' / 'crossing.png') as picture:
        assert picture.format == 'PNG'
        assert 500 < picture.width < 5000 and 150 < picture.height < 5000
        assert np.asarray(picture.convert('L')).std() > 10.0  # the picture is not empty

    with AnyReader([tmp_path / 'out' / 'doorstep' / 'bag']) as bag:
        stamps = {connection.topic: set() for connection in bag.connections}
        recorded = {one.topic.lstrip('/') for one in bag.connections if one.msgcount}
        heights, last = set(), None
        for connection, _, data in bag.messages():
            message = bag.deserialize(data, connection.msgtype)
            if not hasattr(message, 'header'):
                continue
            stamps[connection.topic].add(
                round(1e3 * (message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)))
            if connection.topic == '/ball_state':
                last = message
            if connection.topic == '/step_decision':
                heights.add(round(1e2 * message.height))
    end = max(stamps['/joint_states'])
    assert end > 5000 and {3, 8} <= heights
    # Even on a busy machine, only messages in transit at the end may be missing.
    for topic, period in (('/joint_states', 2), ('/ball_state', 10), ('/odom', 10),
                          ('/terrain_observation', 20), ('/joint_commands', 2),
                          ('/step_decision', 20), ('/set_point', 20)):
        assert not set(range(0, end - 20, period)) - stamps[topic], topic
    assert printed.count('bag: complete, ') == 2
    assert {'clock', 'tf', 'tf_static', *named_topics()} <= recorded
    assert 0.726 < last.x < 3.726 - 0.226 and abs(last.velocity_x) < 0.02

    with open(tmp_path / 'out' / 'doorstep' / 'bag' / 'bag.mcap', 'rb') as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        states = [message for *_, message in reader.iter_decoded_messages(['/ball_state'])]
    assert states[-1].x == last.x and states[-1].contacts[0].normal_force > 0.0


@pytest.mark.slow
def test_through_an_emulated_drive_one_step_is_crossed_and_one_refused(demo):
    process = demo('--hardware')
    printed = process.communicate(timeout=2.0 * TIMEOUT)[0]
    if process.returncode and 'the load of this machine is' in printed:
        pytest.skip('the load of this machine is too high for a demo in real time')
    assert process.returncode == 0, printed
    place = 0
    for words in ('CROSS', 'touches  the 31 mm step', 'crossed', 'GO ROUND', 'rests', 'Done:'):
        assert (place := printed.find(words, place)) >= 0, (words, printed)


@pytest.mark.slow
def test_the_ball_drives_through_a_house_over_thresholds_and_steps(demo, tmp_path):
    printed = (process := demo('--house', '--timeout', '250')).communicate(timeout=5 * TIMEOUT)[0]
    assert process.returncode == 0, printed
    place = 0
    for words in ('goal  the bedroom', 'crosses  the kitchen threshold',
                  'crosses  the bedroom step', 'arrives  in the bedroom',
                  'crosses  the bathroom step', 'arrives  in the bathroom', 'Done:'):
        assert (place := printed.find(words, place)) >= 0, (words, printed)
    with Image.open(tmp_path / 'out' / 'house.png') as picture:
        assert picture.width > 500 and np.asarray(picture.convert('L')).std() > 10.0
    with AnyReader([tmp_path / 'out' / 'bag']) as bag:
        recorded = {one.topic.lstrip('/') for one in bag.connections if one.msgcount}
        *_, last = (bag.deserialize(data, one.msgtype) for one, _, data in bag.messages(
            [one for one in bag.connections if one.topic == '/odom']))
    assert {'map', 'scan', 'plan', 'cmd_vel', 'set_point', 'joint_states'} <= recorded
    # In the frame of the start, whose x axis is the y axis of the map.
    there = last.pose.pose.position
    assert math.dist((1.7 - there.y, 1.4 + there.x), (8.1, 5.5)) < 0.2


def test_a_house_demo_that_does_not_arrive_fails(demo):
    printed = (process := demo('--house', '--duration', '2')).communicate(timeout=TIMEOUT)[0]
    assert process.returncode == 1, printed
    assert 'FAILED' in printed and 'the bedroom was not reached' in printed


def test_a_node_that_dies_fails_the_demo_and_is_named(demo, tmp_path):
    process = demo()
    nodes = nodes_once_logged(process, tmp_path / 'out' / 'doorstep' / 'logs',
                              'joint states have arrived', {'controller'})
    subprocess.run(['kill', '-KILL', str(nodes['controller'])], check=True)
    printed = process.communicate(timeout=TIMEOUT)[0]
    assert process.returncode == 1, printed
    assert 'FAILED' in printed and 'node controller ended with code -9, see ' in printed
    assert 'Traceback' not in printed
    assert not any(Path('/proc', str(number)).exists() for number in nodes.values())


@pytest.mark.parametrize('number, code', [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupted_demo_leaves_no_process_running(demo, tmp_path, number, code):
    process = demo()
    nodes = nodes_once_logged(process, tmp_path / 'out' / 'doorstep' / 'logs', 'running with')
    process.send_signal(number)
    printed = process.communicate(timeout=TIMEOUT)[0]
    assert process.returncode == code, printed
    assert 'Traceback' not in printed
    assert not any(Path('/proc', str(number)).exists() for number in nodes.values())


def test_a_demo_with_a_first_step_too_high_fails_and_reports_why(domain, tmp_path):
    # The first step of 60 mm is too high: the ball crosses no step and does not come to rest.
    scene = tmp_path / 'too_high.yaml'
    scene.write_text('robot: gimball\nterrain:\n  - flat: {length: 1.4}\n'
                     '  - step: {height: 0.06}\n  - flat: {length: 1.0}\n'
                     '  - step: {height: 0.08}\n  - flat: {length: 1.0}\nduration: 10.0\n')
    done = subprocess.run(
        [sys.executable, '-c', 'import pathlib, sys; '
         'from ballbot_ros.demo.demo import run_demo, TWO_STEPS; '
         f'cases = [TWO_STEPS._replace(scene="{scene}", longest=5.0)]; '
         'sys.exit(run_demo(pathlib.Path("out"), cases=cases))'],
        cwd=tmp_path, env=environment(domain, tmp_path), capture_output=True, text=True,
        timeout=TIMEOUT)
    assert done.returncode == 1, done.stderr
    for words in ('the 60 mm step was never accepted', 'the 60 mm step was not crossed',
                  'the robot did not come to rest'):
        assert words in done.stderr
    assert (tmp_path / 'out' / 'too_high' / 'bag' / 'bag.mcap').exists()
