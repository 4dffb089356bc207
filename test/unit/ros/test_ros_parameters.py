# SPDX-License-Identifier: Apache-2.0
"""
Parameters are refused with a helpful message, and converted only without loss.

At run time, a request changes all its values, or none and names the reason.
"""
from dataclasses import dataclass
import math
import threading

import pytest
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from refusals import refused

from ballbot_ros.config.fields import count, fixed, flag, live, quantity, text
from ballbot_ros.control import ControlTuning, load_tuning
from ballbot_ros.errors import BallbotError, ConfigurationError
from ballbot_ros.nodes.bridge.settings import BridgeSettings
from ballbot_ros.ros.parameters import Changes, declare
from ballbot_ros.ros.rclpy_compat import new_executor
from ballbot_ros.ros.settings import file_in, numbers_in, Settings

# A number so small that ros2cli sends it as text.
TINY = 1e-5


@dataclass(frozen=True)
class Example(Settings):
    """Some parameters."""

    gain: float = live(quantity('N m/rad', 'stiffness', default=2.0, minimum=0.0, maximum=10.0))
    tiny: float = live(quantity('m', 'accuracy', default=TINY, minimum=0.0))
    ratio: float = live(quantity('1', 'ratio', default=1.0, above=0.0))
    steps: int = live(count('of a stair', default=3, maximum=9))
    loud: bool = live(flag('say it', default=False))
    method: str = live(text('how', default='rk4', choices=('rk4', 'euler')))
    robot: str = fixed('the world is built of it', text('its name', default='gimball'))
    quiet: bool = fixed('it says how to begin', flag('say nothing', default=False))
    version: str = text('a number as text', default='0.5')
    tuning: str = live(file_in('tunings', 'published'))
    gains: ControlTuning = numbers_in('tuning', ControlTuning, load_tuning, 'gains.')


class Owner:
    """A node that stores its settings and refuses a gain of 7."""

    def __init__(self, make_node, **overrides):
        self.node = make_node(Node, 'example', **overrides)
        self.threads = set()
        self.settings = declare(self.node, Example, lambda wanted: self.prepare(wanted))

    def prepare(self, wanted):
        self.threads.add(threading.current_thread())
        if wanted.gain == 7.0:
            raise ConfigurationError('it diverges at a gain of 7; take 6', 'inconsistent', 'gain')

        def commit():
            self.settings = wanted
        return commit

    def set(self, **values):
        """Set all atomically, in this process."""
        return self.node.set_parameters_atomically(
            [Parameter(name.replace('__', '.'), value=value) for name, value in values.items()])

    def value(self, name):
        return self.node.get_parameter(name).value


@pytest.fixture
def owner(make_node):
    return Owner(make_node)


def test_defaults_are_declared_and_returned(owner):
    assert owner.settings == Example()
    assert {name: owner.value(name) for name in Example.described()
            if not name.startswith('gains.')} == {
        'gain': 2.0, 'tiny': TINY, 'ratio': 1.0, 'steps': 3, 'loud': False, 'method': 'rk4',
        'robot': 'gimball', 'quiet': False, 'version': '0.5', 'tuning': 'published'}


def test_an_integer_at_the_start_is_converted_to_a_float(make_node):
    owner = Owner(make_node, gain=5, ratio=2)
    assert owner.settings == Example(gain=5.0, ratio=2.0)
    assert type(owner.settings.gain) is type(owner.value('gain')) is float


def test_the_log_names_each_parameter_that_is_given(make_node, capfd):
    Owner(make_node, gain=3, use_sim_time=True)
    assert 'running with gain 3.0, use_sim_time True' in capfd.readouterr().err


def test_a_changed_value_gives_new_settings(owner):
    before = owner.settings
    assert owner.set(gain=3.0, method='euler').successful
    assert (owner.settings.gain, owner.settings.method) == (3.0, 'euler')
    assert (before.gain, before.method) == (2.0, 'rk4')
    assert owner.value('gain') == 3.0


def test_an_integer_and_a_number_as_text_become_floats_at_run_time(owner):
    assert owner.set(gain=3).successful and owner.set(tiny='1e-6').successful
    assert (owner.value('gain'), owner.value('tiny')) == (3.0, 1e-6)
    assert type(owner.value('gain')) is type(owner.settings.gain) is float


@pytest.fixture
def caught(monkeypatch):
    """Return the list of the errors that refuse requests."""
    errors, compute = [], Changes._compute

    def watched(self, parameters):
        try:
            return compute(self, parameters)
        except BallbotError as error:
            errors.append(error)
            raise
    monkeypatch.setattr(Changes, '_compute', watched)
    return errors


# Values that are refused at the start and while the node runs: name, value, reason and words of
# the message.
REFUSED = [
    ('gian', 3.0, 'unknown_name', ("'gain'",)),
    ('Gain', 1.0, 'unknown_name', ("'gain'",)),
    ('gain', 10.5, 'out_of_range', ('example', '0', '10 N m/rad', '10.5')),
    ('gain', -1, 'out_of_range', ('-1',)),
    ('gain', math.nan, 'not_finite', ('nan',)),
    ('gain', math.inf, 'not_finite', ('inf',)),
    ('gain', 'stiff', 'wrong_type', ("'stiff'",)),
    ('gain', True, 'wrong_type', ('True',)),
    ('gain', [1.0], 'wrong_type', ()),
    ('tiny', -1.0, 'out_of_range', ('-1',)),
    ('ratio', 0.0, 'out_of_range', ()),
    ('steps', 2.5, 'wrong_type', ('2.5',)),
    ('steps', 10, 'out_of_range', ('0', '9', '10')),
    ('loud', 1, 'wrong_type', ('1',)),
    ('loud', 'yes', 'wrong_type', ("'yes'",)),
    ('method', 4, 'wrong_type', ('4',)),
    ('method', 'rk5', 'not_a_choice', ('rk4, euler', "'rk4'")),
    ('gains.position_kp', -1.0, 'out_of_range', ('-1',)),
    ('gains.position_kp', 4000.0, 'out_of_range', ('4000',)),
    ('tuning', 'gentel', 'unknown_name', ('gentle',))]


@pytest.mark.parametrize('name, value, reason, names', [
    *REFUSED,
    ('zzz', 1.0, 'unknown_name', (
        'gain', 'loud', 'method', 'ratio', 'robot', 'steps', 'use_sim_time', 'version')),
    ('use_simtime', True, 'unknown_name', ("'use_sim_time'",)),
    ('qos_overrides./odom.publisher.depth', 1, 'unknown_name', ())])
def test_a_parameter_refused_at_the_start_is_named_with_value_and_range(
        make_node, name, value, reason, names):
    with refused(reason, name) as caught:
        Owner(make_node, **{name: value})
    assert all(one in str(caught.value) for one in (name, *names))


@pytest.mark.parametrize('name, value, reason, names', [
    *REFUSED,
    ('gain', 'nan', 'not_finite', ('nan',)),
    ('gain', None, 'wrong_type', ('None',)),
    ('robot', 'shellball', 'fixed', ('robot:=shellball',)),
    ('quiet', True, 'fixed', ('quiet:=true',)),
    ('version', 0.6, 'fixed', ('version:=0.6',)),
    ('gain', 7.0, 'inconsistent', ('6',))])
def test_a_refused_value_changes_nothing_and_the_answer_names_it(
        owner, caught, name, value, reason, names):
    before = owner.settings
    result = owner.set(**{'steps': 4, 'loud': True, name: value})
    error, = caught
    assert (error.reason, error.field) == (reason, name), error
    assert not result.successful and result.reason == str(error)
    assert all(one in result.reason for one in names)
    # All or nothing.
    assert owner.settings is before
    assert [owner.value(name) for name in ('gain', 'steps', 'loud')] == [2.0, 3, False]


def test_a_description_states_whether_the_parameter_can_change_and_why_not(owner):
    for name, item in Example.described().items():
        found = owner.node.describe_parameter(name)
        fits = 'Can change' if not found.read_only else 'Cannot change while the node runs: '
        assert fits in found.description, name
    assert owner.node.describe_parameter('robot').read_only
    assert 'the world is built of it' in owner.node.describe_parameter('robot').description
    assert not owner.node.describe_parameter('gains.position_kd').read_only
    slider, = owner.node.describe_parameter('gain').floating_point_range
    assert (slider.from_value, slider.to_value) == (0.0, 10.0)


def test_another_file_sets_all_its_numbers_except_those_given_explicitly(owner):
    assert owner.value('gains.position_kp') == 40.0
    assert owner.set(gains__position_kp=20.0).successful
    assert owner.set(tuning='gentle', gains__blend_time=0.3).successful
    assert owner.settings.gains == ControlTuning(
        **{**vars(load_tuning('gentle')), 'blend_time': 0.3})
    assert owner.value('gains.position_kp') == 6.0 and owner.value('tuning') == 'gentle'


def test_settings_are_created_from_the_names_of_a_dump():
    made = Example.from_mapping({'gain': 3, 'gains.position_kp': 5, 'tuning': 'gentle'}, 'bag')
    assert (made.gain, made.gains.position_kp, made.gains.position_kd) == (3.0, 5.0, 0.8)
    with refused('unknown_name', 'gian') as caught:
        Example.from_mapping({'gian': 3.0}, 'bag')
    assert "'gain'" in str(caught.value)  # the nearest name
    with refused('out_of_range', 'gains.position_kp'):
        Example.from_mapping({'gains.position_kp': -1.0}, 'bag')


def test_a_number_given_at_the_start_overrides_that_of_the_file(make_node):
    given = Owner(make_node, **{'gains.position_kp': 5, 'tuning': 'gentle'})
    assert given.settings.gains.position_kp == given.value('gains.position_kp') == 5.0
    assert given.settings.gains.position_kd == load_tuning('gentle').position_kd


def messages(owner, names=None):
    """Return all parameters as `ros2 param load` sends them after `ros2 param dump`."""
    from rcl_interfaces.msg import Parameter as Message
    from rclpy.parameter import get_parameter_value
    import yaml
    names = names or owner.node.list_parameters([], 0).names
    dump = yaml.dump({name: owner.node.get_parameter(name).value for name in names})
    return [Message(name=name, value=get_parameter_value(str(value)))
            for name, value in yaml.safe_load(dump).items()]


@pytest.fixture(params=[new_executor, SingleThreadedExecutor])
def ask(request, owner, context):
    """Return a function that calls a service of the node, which spins meanwhile."""
    executor = request.param(context=context)
    executor.add_node(owner.node)

    def ask(kind, name, parameters):
        client = owner.node.create_client(kind, f'example/{name}')
        assert client.wait_for_service(10.0)
        answer = client.call_async(kind.Request(parameters=parameters))
        while not answer.done():
            executor.spin_once(timeout_sec=0.1)
        owner.node.destroy_client(client)
        return answer.result()
    yield ask
    executor.remove_node(owner.node)
    executor.shutdown()


def test_a_change_by_service_is_committed_in_the_thread_of_the_executor(owner, ask):
    seen = []
    prepare = owner.prepare

    def watched(wanted):
        commit = prepare(wanted)
        return lambda: (seen.append(threading.current_thread()), commit())
    owner.prepare = watched
    result = ask(SetParametersAtomically, 'set_parameters_atomically', [
        Parameter('gain', value=4.0).to_parameter_msg(),
        Parameter('steps', value=4).to_parameter_msg()]).result
    assert result.successful and (owner.settings.gain, owner.settings.steps) == (4.0, 4)
    assert threading.main_thread() not in owner.threads
    assert seen == [threading.main_thread()]


def test_a_service_answers_each_parameter_separately(owner, ask, caught):
    results = ask(SetParameters, 'set_parameters', [
        Parameter(name, value=value).to_parameter_msg() for name, value in (
            ('gain', 5.0), ('gain', 11.0), ('robot', 'x'), ('steps', 5))]).results
    assert [result.successful for result in results] == [True, False, False, True]
    assert [(error.reason, error.field) for error in caught] == [
        ('out_of_range', 'gain'), ('fixed', 'robot')]
    assert [result.reason for result in results] == ['', *map(str, caught), '']
    assert (owner.settings.gain, owner.settings.steps) == (5.0, 5)


def test_a_node_accepts_its_own_dump(owner, ask):
    assert owner.set(gain=4.5, gains__position_kp=30.0).successful
    before = owner.settings
    results = ask(SetParameters, 'set_parameters', messages(owner)).results
    assert len(results) > 20
    assert [result.reason for result in results if not result.successful] == []
    assert owner.settings == before


def test_an_earlier_dump_is_restored(owner, ask):
    dump = messages(owner)
    assert owner.set(gain=4.5, method='euler', gains__position_kp=30.0).successful
    assert all(one.successful for one in ask(SetParameters, 'set_parameters', dump).results)
    assert owner.settings == Example()


def test_an_unexpected_error_in_a_check_is_answered(owner, ask):
    def broken(wanted):
        raise ZeroDivisionError('by nought')
    owner.prepare = broken
    result, = ask(SetParameters, 'set_parameters', [
        Parameter('gain', value=4.0).to_parameter_msg()]).results
    assert not result.successful and 'by nought' in result.reason


def test_a_real_motor_follows_no_set_point_indefinitely():
    with refused('out_of_range', 'set_point_timeout'):
        BridgeSettings(set_point_timeout=0.0)
