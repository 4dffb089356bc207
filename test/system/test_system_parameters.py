# SPDX-License-Identifier: Apache-2.0
"""Parameters and files that a node does not accept: exit code 2, and one line that helps."""
import pytest
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters

from ballbot_ros.config.files import find_config

FILES = {
    'scene.yaml': 'robot: gimball\nterrain:\n  - step: {hight: 0.03}\nduration: 1.0\n',
    'robot.yaml': 'name: broken\nball_mass: {value: -3.8, unit: kg, source: assumed}\n',
    'curve.yaml': 'name: broken\nrobot: gimball\nactuation: none\nsource: none\n'
                  'lowest_speed: 0.2\nhighest_speed: 1.2\nresidual: 0.001\n'
                  'coefficients: [0.0, 0.1]\n',
    'tuning.yaml': 'position_kp: 40.0\nposition_kq: 10.0\n',
    'not_yaml.yaml': 'robot: [gimball\n',
    'boldness.yaml': 'highest_speed: -1.1\n',
}

# For each case: node -> (parameters, what its one line must say).
REFUSED = {
    'unknown, but like another': {
        'simulator': ({'clock_rte': 100.0}, ("'clock_rte' is not a parameter of node simulator",
                                             "did you mean 'clock_rate'?")),
        'controller': ({'tunings': 'gentle'}, ("'tunings'", "did you mean 'tuning'?")),
        'obstacle_decision': ({'robt': 'gimball'}, ("'robt'", "did you mean 'robot'?"))},
    'unlike any other': {
        'simulator': ({'zzz': 1}, ("'zzz'", 'known are', 'clock_rate')),
        'controller': ({'zzz': 1}, ("'zzz'", 'known are', 'torque_limit')),
        'obstacle_decision': ({'zzz': 1}, ("'zzz'", 'known are', 'curve'))},
    'of the wrong type': {
        'simulator': ({'lockstep': 1}, ('node simulator: lockstep must be true or false', '1')),
        'controller': ({'rate': 'fast'}, ('node controller: rate must be a number',
                                          'at least 1', "'fast'")),
        'obstacle_decision': ({'curve': 5}, ('curve must be text', '5'))},
    'out of range': {
        'simulator': ({'clock_rate': 3e4}, ('clock_rate must be', 'at most 10000 Hz', '30000')),
        'controller': ({'delay': 11}, ('delay must be', 'at most 10', '11')),
        'obstacle_decision': ({'robot': 'gimbal'}, ("no robot named 'gimbal'", 'gimball'))},
    'not a number': {
        'simulator': ({'physics_step': '.nan'}, ('physics_step must be', 'nan')),
        'controller': ({'torque_limit': '.inf'}, ('torque_limit must be', 'inf')),
        'obstacle_decision': (
            {'tuning': 'bold'}, ("no decision tuning named 'bold'", 'decision_default'))},
    'a choice there is not, a loop that would diverge, another robot': {
        'simulator': ({'method': 'rk5'}, ('method must be one of', "did you mean 'rk4'?")),
        'controller': ({'rate': 100}, ('law (11)', 'diverges on gimball at 100 Hz',
                                       'run it at 275 Hz or more', 'lower position_kd')),
        'obstacle_decision': ({'curve': 'shellball_free'}, ('was made for shellball, not for '
                                                            'gimball',))},
    'rates that do not fit, no pendulum, file that is not there': {
        'simulator': ({'odom_rate': 300.0}, ('odom_rate must divide control_rate (500 Hz)',
                                             '250 Hz and 500 Hz do')),
        'controller': ({'robot': 'shellball'}, ('shellball has no pendulum',)),
        'obstacle_decision': ({'tuning': './none.yaml'}, ("none.yaml' does not exist",))},
    'malformed files': {
        'simulator': ({'scene': 'scene.yaml'}, ('scene.yaml: terrain: piece 1 (step)',
                                                "'hight'", "did you mean 'height'?")),
        'controller': ({'tuning': 'tuning.yaml'}, ('tuning.yaml', "'position_kq'",
                                                   "did you mean 'position_k")),
        'obstacle_decision': ({'curve': 'curve.yaml'}, ('curve.yaml', 'coefficients must be '
                                                        'four finite numbers', '[0.0, 0.1]'))},
    'more malformed files': {
        'simulator': ({'scene': 'not_yaml.yaml'}, ('not_yaml.yaml: is not valid YAML',)),
        'controller': ({'robot': 'robot.yaml'}, ('robot.yaml', 'ball_mass', '-3.8')),
        'obstacle_decision': ({'tuning': 'boldness.yaml'}, (
            'boldness.yaml: highest_speed must be more than 0 and at most 10 m/s, got -1.1',))},
    'a curve of other numbers': {
        'obstacle_decision': ({'robot': 'heavier.yaml'}, (
            'curve gimball_down was made for a gimball of other numbers',
            'ballbot fit-curve'))},
}


@pytest.fixture
def files(tmp_path, monkeypatch):
    """Write the malformed files, and go where they are."""
    for name, content in FILES.items():
        (tmp_path / name).write_text(content)
    gimball = find_config('robots', 'gimball').read_text()
    (tmp_path / 'heavier.yaml').write_text(gimball.replace('value: 3.8,', 'value: 3.9,'))
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize('case', REFUSED)
def test_a_refusal_is_one_line_with_the_remedy(graph, files, case):
    for name, (parameters, _) in REFUSED[case].items():
        graph.start(name, **parameters)
    for name, (_, sayings) in REFUSED[case].items():
        assert graph.processes.wait(name, 30.0) == 2, graph.log(name)
        lines = [line for line in graph.log(name).splitlines() if '[INFO]' not in line]
        assert len(lines) == 1 and '[FATAL]' in lines[0], graph.log(name)
        for saying in sayings:
            assert saying in lines[0]


@pytest.mark.parametrize('arguments', [
    ('--ros-args', '-p', 'rate'), ('--ros-args', '--params-file', 'none.yaml'),
    ('--ros-args', '--params-file', 'not_yaml.yaml'), ('--ros-args', '--colour', 'red')])
def test_malformed_command_line_is_refused_too(graph, files, arguments):
    graph.start('controller', *arguments)
    assert graph.processes.wait('controller', 30.0) == 2
    # rcl logs lines of its own before it.
    assert graph.log('controller').splitlines()[-1].startswith('cannot start: ')
    assert 'Traceback' not in graph.log('controller')


def test_parameter_file_is_followed_and_takes_whole_numbers(graph, tmp_path):
    path = tmp_path / 'parameters.yaml'
    path.write_text("""
/**:
  ros__parameters:
    robot: gimball
controller:
  ros__parameters:
    rate: 400
    tuning: gentle
/left/simulator:
  ros__parameters:
    control_rate: 400
    scene: flat
""")
    file = ('--ros-args', '--params-file', str(path))
    graph.start('controller', *file)
    graph.start('simulator', *file, '-r', '__ns:=/left')
    graph.start('obstacle_decision', *file)
    graph.wait_for_log('controller', "robot 'gimball', tuning 'gentle', torque_limit 0.0, "
                       'rate 400.0')
    graph.wait_for_log('simulator', "scene 'flat', robot 'gimball'")
    assert 'control_rate 400.0' in graph.log('simulator')
    graph.wait_for_log('obstacle_decision', "robot 'gimball'")


def test_no_service_sets_gains_that_diverge(graph):
    graph.start('controller', tuning='gentle', rate=100)
    graph.wait_for_log('controller', 'these gains need joint states at 22 Hz or more')

    def change(name, value):
        new = Parameter(name=name, value=ParameterValue(
            type=ParameterType.PARAMETER_DOUBLE, double_value=value))
        response = graph.call('controller/set_parameters', SetParameters, parameters=[new])
        return response.results[0]

    for name, value, saying in (
            ('rate', 10.0, 'run it at 22 Hz or more'), ('torque_limit', -1.0, 'at least 0'),
            ('gains.position_kd', 40.0, 'lower position_kd'),
            ('tortue_limit', 1.0, 'did you mean')):
        result = change(name, value)
        assert not result.successful and saying in result.reason
    values = graph.call('controller/get_parameters', GetParameters,
                        names=['rate', 'torque_limit']).values
    assert [value.double_value for value in values] == [100.0, 0.0]
    assert change('gains.position_kd', 0.7).successful
