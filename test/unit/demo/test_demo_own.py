# SPDX-License-Identifier: Apache-2.0
"""The demo with a custom robot, and one that reports an e-stop."""
from types import SimpleNamespace

import pytest
from refusals import refused

from ballbot_ros.config.files import shipped_folder
from ballbot_ros.demo import demo, hardware, recorded_graph
from ballbot_ros.demo.demo import CASES, demo_cases, passages_of
from ballbot_ros.demo.house import run_house_demo
from ballbot_ros.demo.timeline import account, Expected, Passage, Timeline
from ballbot_ros.errors import ConfigurationError, UnstableLoopError
from ballbot_ros.msg import BallState, Contact, MotorStatus
from ballbot_ros.physics import load_scene
from ballbot_ros.ros.conversions import to_time


def test_the_default_cases_are_those_of_the_readme():
    assert list(demo_cases()) == list(CASES)
    assert [(case.planner, case.scene, case.expected) for case in demo_cases(planner='cubic')] == [
        ('cubic', 'voltage_start', (Expected.CROSSED,)), ('cubic', 'drop_on_slope', None)]
    with refused('not_a_choice', 'planner'):
        demo_cases(planner='cubik')
    case, = demo_cases('doorstep', longest=12.0)
    assert case == CASES[0]._replace(longest=12.0)


def test_a_custom_scene_has_its_robot_and_the_matching_curve():
    case, = demo_cases('household')
    assert case.expected is None and case.scene == 'household'
    assert (case.robot, case.curve, case.tuning) == ('gimball', 'gimball_down', 'published')
    case, = demo_cases(tuning='gentle')
    assert case.scene == 'doorstep' and case.expected is None and case.tuning == 'gentle'


@pytest.fixture
def own_robot(tmp_path):
    """Return the file of a robot without a height curve."""
    path = tmp_path / 'mine.yaml'
    text = (shipped_folder('config') / 'robots' / 'gimball.yaml').read_text()
    path.write_text(text.replace('name: gimball', 'name: mine'))
    return str(path)


def test_a_robot_without_a_curve_is_refused_with_the_command_to_run(own_robot):
    with pytest.raises(ConfigurationError) as refusal:
        demo_cases(robot=own_robot)
    assert f'ballbot fit-curve --robot {own_robot} --actuation held' in str(refusal.value)
    with refused('inconsistent', 'curve'):
        demo_cases(robot=own_robot, curve='gimball_down')


def test_a_house_refuses_the_curve_of_another_robot(tmp_path):
    with refused('inconsistent', 'curve'):
        run_house_demo(tmp_path, curve='shellball_free')


def test_a_house_refuses_a_goal_off_the_map_before_the_nodes_start(refuses, tmp_path):
    out = tmp_path / 'out'
    refuses('off_map', 'goal', 'demo', '--house', '--goal', '8100', '5500', '--out', out)
    assert not out.exists()


@pytest.mark.slow
def test_a_robot_without_a_pendulum_and_gains_that_diverge_are_refused(monkeypatch):
    with refused('inconsistent', 'pendulum_mass'):
        demo_cases(robot='shellball')
    monkeypatch.setattr(demo, 'CONTROL_RATE', 100.0)
    with pytest.raises(UnstableLoopError, match='275'):
        demo_cases('household')


def test_carpets_and_cords_have_their_observed_heights():
    assert [passage.name for passage in passages_of(load_scene('household'))] == [
        '6 mm step', '6 mm drop', '8 mm step', '8 mm drop', '10 mm step', '10 mm drop']
    assert [passage.name for passage in passages_of(load_scene('doorstep'))] == [
        '31 mm step', '80 mm step']


def test_a_run_without_expectations_is_reported_face_by_face(gimball):
    timeline = Timeline([Passage(1.0, 0.03, 0.03, None), Passage(2.0, 0.08, 0.11, None)],
                        gimball, lambda *event: None)
    assert account(timeline) == ['the 30 mm step at 1.00 m: not touched',
                                 'the 80 mm step at 2.00 m: not touched']
    for stamp, x, y, touched in ((0.0, 0.0, 0.226, ()), (1.0, 1.1, 0.256, ()),
                                 (2.0, 1.8, 0.256, (2.0,))):
        message = BallState(x=x, y=y, velocity_x=0.5, contacts=[
            Contact(kind=2, x=place) for place in touched])
        message.header.stamp = to_time(stamp)
        timeline.add_state(message)
    assert account(timeline) == [
        'the 30 mm step at 1.00 m: crossed', 'the 80 mm step at 2.00 m: touched, not crossed',
        'had not come to rest after 2.0 s, at 1.80 m']


# The e-stop in the hardware demo


@pytest.fixture
def person(monkeypatch):
    """Return a controllable operator, whose services reply with the texts of `answers`."""
    clock, answers, taking = SimpleNamespace(now=100.0), {}, []

    def create_client(kind, name):
        def call_async(request):
            done = SimpleNamespace(success=answers[name] == '', message=answers[name])
            return SimpleNamespace(done=lambda: True, result=lambda: done)
        return SimpleNamespace(service_is_ready=lambda: name in answers, call_async=call_async)
    monkeypatch.setattr(hardware, 'create_subscription',
                        lambda node, topic, callback: taking.append(callback))
    monkeypatch.setattr(hardware, 'time', SimpleNamespace(monotonic=lambda: clock.now))
    actions = hardware.release_and_resume(SimpleNamespace(create_client=create_client))
    assert next(actions) is None

    def poll(seconds):
        for _ in range(round(seconds / 0.1)):
            clock.now += 0.1
            why = next(actions)
            if why:
                return why
        return None
    return SimpleNamespace(answers=answers, poll=poll, take=lambda message: taking[0](message))


RELEASE, RESUME = 'bridge/release_e_stop', 'obstacle_decision/resume'


def test_an_e_stop_that_engages_by_itself_ends_the_demo_with_its_reason(person):
    person.answers.update({RELEASE: '', RESUME: ''})
    person.take(MotorStatus(e_stop='engaged at start'))
    assert person.poll(3.0) is None
    person.take(MotorStatus(e_stop='engaged at start'))  # a delayed message
    assert person.poll(1.0) is None
    person.take(MotorStatus())
    assert person.poll(1.0) is None
    person.take(MotorStatus(e_stop='the drive took off the power', faults=['WATCHDOG']))
    why = person.poll(0.2)
    assert why.startswith('the e-stop has engaged by itself: the drive took off the power '
                          '(WATCHDOG)')


def test_a_lasting_refusal_ends_the_demo_with_its_last_output(person, monkeypatch):
    person.answers.update({RELEASE: 'the line is down', RESUME: ''})
    assert person.poll(10.0) is None
    person.answers[RELEASE] = 'the drive reports WATCHDOG'
    monkeypatch.setattr(hardware.os, 'getloadavg', lambda: (1e3, 0.0, 0.0))
    why = person.poll(15.0)
    assert why.startswith('bridge/release_e_stop has refused for 20 s: the drive reports WATCHDOG')
    assert 'load of this machine is 1000.0' in hardware.load_note()


def test_a_first_refusal_is_retried(person):
    person.answers.update({RELEASE: 'no IMU yet', RESUME: 'the e-stop is engaged'})
    assert person.poll(8.0) is None
    person.answers[RELEASE] = ''
    assert person.poll(8.0) is None
    person.answers[RESUME] = ''
    assert person.poll(60.0) is None


def test_a_simulation_is_reset_until_it_is_recorded_and_then_advanced(monkeypatch):
    clock, calls, recorded = SimpleNamespace(now=100.0, stamp=0), [], {}
    answer = SimpleNamespace(success=True, message='')

    def create_client(kind, name):
        return SimpleNamespace(service_is_ready=lambda: True, call_async=lambda request: (
            calls.append(name) or SimpleNamespace(done=lambda: True, result=lambda: answer)))
    monkeypatch.setattr(
        recorded_graph, 'time', SimpleNamespace(monotonic=lambda: clock.now))
    actions = recorded_graph.run_simulator(
        SimpleNamespace(create_client=create_client), SimpleNamespace(
            recorded=recorded, reached=lambda stamps: stamps == {'odom': clock.stamp}),
        ['odom'], recorded_graph.endless_advances(['odom'], 500.0))

    def calls_in(seconds):
        calls.clear()
        for _ in range(round(seconds / 0.1)):
            assert next(actions) is None
            clock.now += 0.1
        return calls
    assert set(calls_in(1.0)) == {'simulator/reset'} and 4 <= len(calls) <= 6
    while calls_in(0.1) != ['simulator/reset']:
        pass
    recorded['odom'] = [0]
    assert calls_in(0.1) == ['simulator/step']  # before the next reset would be due
    assert calls_in(0.9) == []
    clock.stamp = 10**9
    assert calls_in(1.0) == ['simulator/step']
    answer.success, answer.message = False, 'it fell'
    assert next(actions) == 'the simulator has stopped: it fell'


@pytest.mark.parametrize('given, lockstep, factor', [
    ({}, True, 0.0), ({'real_time': True}, False, 1.0), ({'watched': True}, True, 1.0)])
def test_a_viewed_demo_runs_at_most_in_real_time(
        tmp_path, monkeypatch, given, lockstep, factor):
    class Started(Exception):
        """Raised in place of the graph."""

    def graph(folder, topics, timeline, nodes, metadata, domain):
        assert nodes['simulator'] == metadata
        raise Started(metadata)
    monkeypatch.setattr(demo, 'prepare', lambda nodes: None)
    monkeypatch.setattr(demo, 'in_processes', lambda works, together: [
        work() for work in works])
    monkeypatch.setattr(demo, 'recorded_graph', graph)
    monkeypatch.setattr(demo, 'bag_metadata', lambda name, simulator, *_: simulator)
    with pytest.raises(Started) as started:
        demo.run_demo(tmp_path, quiet=True, **given)
    simulator, = started.value.args
    assert (simulator['lockstep'], simulator['real_time_factor']) == (lockstep, factor)
