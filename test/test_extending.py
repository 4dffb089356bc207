# SPDX-License-Identifier: Apache-2.0
"""
A solver, a drive, sensors, a planner and a limit are each added in a copy, and then used.

A file is copied and changed, and a table gets a line, as in docs/architecture.md.  No other file
changes, and the output for users contains the new name.
"""
import json
import os
from pathlib import Path
import re
import shutil
import subprocess
import sys

import pytest

ROOT = Path(__file__).resolve().parent.parent

# The second-order scheme in place of the fourth-order one of rk4.py.
MIDPOINT = """\
    work, mode = workspace.work, workspace.mode
    probe, k1 = work[values.PROBE:], work[values.STAGES:]
    k2 = work[values.STAGES + WIDTH:]
    derivative(time, state, system, mode, k1)
    for i in range(SIZE):
        probe[i] = state[i] + 0.5 * size * k1[i]
    derivative(time + 0.5 * size, probe, system, mode, k2)
    for i in range(SIZE):
        state[i] += size * k2[i]
"""

# The pair of Tsitouras, Comput. Math. Appl. 62 (2011) 770, in place of dormand_prince.py's.
TSITOURAS = """\
A = np.array([
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [0.161, 0.0, 0.0, 0.0, 0.0, 0.0],
    [-0.008480655492356989, 0.335480655492357, 0.0, 0.0, 0.0, 0.0],
    [2.8971530571054935, -6.359448489975075, 4.3622954328695815, 0.0, 0.0, 0.0],
    [5.325864828439257, -11.748883564062828, 7.4955393428898365, -0.09249506636175525, 0.0, 0.0],
    [5.86145544294642, -12.92096931784711, 8.159367898576159, -0.071584973281401,
     -0.028269050394068383, 0.0],
    [0.09646076681806523, 0.01, 0.4798896504144996, 1.379008574103742, -3.290069515436081,
     2.324710524099774]])
C = np.array([0.0, 0.161, 0.327, 0.9, 0.9800255409045097, 1.0, 1.0])
ERROR = np.array([0.00178001105222577714, 0.0008164344596567469, -0.007880878010261995,
                  0.1447110071732629, -0.5823571654525552, 0.45808210592918697, -1 / 66])
CONTINUE = np.array([-1.0530884977290216, 0.1017, 2.490627285651253, -16.548102889244902,
                     47.37952196281928, -34.87065786149661, 2.5])
"""


class House:
    """A modifiable copy of the package."""

    def __init__(self, folder):
        """Copy the files that the package needs to run."""
        self.folder = folder
        for name in ('ballbot_ros', 'config', 'examples'):
            shutil.copytree(ROOT / name, folder / name,
                            ignore=shutil.ignore_patterns('__pycache__'))
        shutil.copy(ROOT / 'package.xml', folder)

    def change(self, name, *changes):
        """Replace text, each a pattern that occurs, in a file of the package."""
        path = self.folder / 'ballbot_ros' / name
        text = path.read_text(encoding='utf-8')
        for pattern, new in changes:
            text, times = re.subn(pattern, lambda _: new, text, count=1, flags=re.DOTALL)
            assert times, f'{name}: no {pattern}'
        path.write_text(text, encoding='utf-8')

    def copy(self, old, new):
        """Copy a file or a folder of the package."""
        old, new = (self.folder / 'ballbot_ros' / name for name in (old, new))
        (shutil.copytree if old.is_dir() else shutil.copy)(old, new)

    def run(self, *words, fails=False):
        """Return the output of a Python program, uncompiled, which is faster for short runs."""
        environment = {**os.environ, 'PYTHONPATH': str(self.folder), 'BALLBOT_UNCOMPILED': '1'}
        done = subprocess.run([sys.executable, *words], cwd=self.folder, env=environment,
                              capture_output=True, text=True, timeout=300)
        assert (done.returncode != 0) == fails, done.stdout + done.stderr
        return done.stdout + done.stderr


@pytest.fixture
def house(tmp_path):
    """Return a modifiable copy of the package."""
    return House(tmp_path)


def test_a_fixed_step_method_needs_a_file_and_a_line(house):
    house.copy('physics/solvers/rk4.py', 'physics/solvers/midpoint.py')
    house.change('physics/solvers/midpoint.py',
                 (r'EVALUATIONS = 4', 'EVALUATIONS = 2'),
                 (r'    work, mode, first = .*?\Z', MIDPOINT.rstrip()))
    house.change('physics/solvers/fixed_step.py',
                 (r'import rk4,', 'import midpoint, rk4,'),
                 (r"'rk4': rk4}", "'rk4': rk4, 'midpoint': midpoint}"))
    scene = house.folder / 'short.yaml'
    scene.write_text('{robot: gimball, terrain: [flat: {length: 2}], initial: {x: 0.5, speed: 1}, '
                     'actuation: {law: torque, torque: 0.5}, duration: 0.05}', encoding='utf-8')

    def simulate(method, **how):
        return house.run('-m', 'ballbot_ros.cli', 'simulate', str(scene), '--method', method,
                         '--step', '1e-3', '--json', **how)
    mine, known = (json.loads(simulate(method)) for method in ('midpoint', 'rk4'))
    assert mine['evaluations'] < known['evaluations']
    assert mine['x'] == pytest.approx(known['x'], abs=1e-6) != 0.5
    assert "'midpoint'" in simulate('midpiont', fails=True)


def test_a_step_of_the_adaptive_method_needs_a_file_and_a_line(house):
    house.copy('physics/solvers/dormand_prince.py', 'physics/solvers/tsitouras.py')
    house.change('physics/solvers/tsitouras.py', (r'A = np.*?(?=STARTS = )', TSITOURAS))
    house.change('physics/solvers/controller.py',
                 (r'dormand_prince, rodas5p', 'dormand_prince, rodas5p, tsitouras'),
                 (r"'implicit': rodas5p}", "'implicit': rodas5p, 'tsitouras': tsitouras}"))
    program = house.folder / 'drop.py'
    program.write_text("""
import json, sys
import numpy as np
from ballbot_ros.physics import *
found = []
for method, tolerance in (('explicit', 1e-12), ('explicit', 1e-7), ('tsitouras', 1e-7)):
    robot = load_robot('gimball')
    model = Model(robot, Terrain.flat(), solver=Solver(method, tolerance=tolerance, models='full'))
    start = State(y=robot.ball_radius + 1e-3, velocity_x=0.5, velocity_y=-0.5, pendulum_rate=1.0)
    run = simulate(model, start, Actuation(), 0.1)
    found.append([run['x'][-1], run['y'][-1], run.effort.evaluations, run.effort.events])
print(json.dumps(found))
""", encoding='utf-8')
    exact, known, mine = json.loads(house.run('drop.py'))
    assert mine[:2] == pytest.approx(exact[:2], abs=1e-6) and mine[3] == exact[3]
    assert mine[:2] != known[:2] and mine[2] < 2 * known[2]
    assert "'tsitouras'" in house.run('-m', 'ballbot_ros.cli', 'simulate', 'flat', '--method',
                                      'tsituoras', fails=True)


def test_a_contact_law_needs_a_file_and_a_line(house):
    laws = 'physics/model/contact_laws'
    house.copy(f'{laws}/hunt_crossley.py', f'{laws}/own.py')
    # The damping grows with the square of the penetration, and equals the original at 1 mm.
    house.change(f'{laws}/own.py',
                 (r'damping = parameters.dissipation \* penetration',
                  'damping = 1e3 * parameters.dissipation * penetration * penetration'),
                 (r'velocity, parameters.dissipation \* velocity',
                  'velocity, 2e3 * parameters.dissipation * penetration * velocity'),
                 (r'-parameters.dissipation \* max\(deepest, 0.0\)',
                  '-1e3 * parameters.dissipation * deepest * deepest'))
    house.change('physics/model/robot.py', (r"'hunt_crossley'\)", "'hunt_crossley', 'own')"))
    program = house.folder / 'drop.py'
    program.write_text("""
import json, sys
import numpy as np
from ballbot_ros.physics import *
ends = []
for law in sys.argv[1:]:
    robot = load_robot('shellball').replace(contact_law=law, contact_dissipation=1.0)
    model = Model(robot, Terrain.flat(), solver=Solver('adaptive', tolerance=1e-10))
    start = State(y=robot.ball_radius + 1e-3, velocity_y=-0.5)
    run = simulate(model, start, Actuation(), 0.1)
    ends.append([run['contact_loss'][-1],
                 np.max(np.abs(run.energy_residual)) / run.energy_in_play])
print(json.dumps(ends))
""", encoding='utf-8')
    (known, exact), (mine, closed) = json.loads(
        house.run('drop.py', 'hunt_crossley', 'own'))
    assert 0.0 < mine != pytest.approx(known, rel=0.05)
    assert exact < 1e-6 and closed < 1e-6  # the energy balance closes
    assert "'own'" in house.run('drop.py', 'onw', fails=True)


def test_a_parameter_of_the_robot_needs_its_declaration_and_the_law_that_uses_it(house):
    # Between other parameters: no code depends on their order.
    house.change('physics/model/robot.py', (r'    contact_law: str', """\
    rebound_damping: float = quantity(
        'N s/m', 'damping of the shell that is added as it rebounds', minimum=0.0, default=0.0)
    contact_law: str"""), (r'\n    damping: float', '\n    rebound: float\n    damping: float'),
                 (r'robot.contact_damping,\n', 'robot.rebound_damping, robot.contact_damping,\n'))
    house.change('physics/model/contact_laws/kelvin_voigt.py', (
        r'    return parameters.damping \* velocity, 0.0, parameters.damping', """\
    damping = parameters.damping + (parameters.rebound if velocity > 0.0 else 0.0)
    return damping * velocity, 0.0, damping"""), (
        '_fastest: float,', 'fastest: float,'), (
        'return parameters.damping, 0.0',
        'return parameters.damping, -parameters.rebound * max(fastest, 0.0)'))
    program = house.folder / 'drop.py'
    program.write_text("""
import json
import numpy as np
from ballbot_ros.physics import *
ends = []
for damping in (0.0, 100.0):
    robot = load_robot('gimball').replace(rebound_damping=damping)
    model = Model(robot, Terrain.flat(), solver=Solver('adaptive', tolerance=1e-9))
    start = State(y=robot.ball_radius + 1e-3, velocity_y=-0.5, pendulum_angle=0.3)
    run = simulate(model, start, Actuation(), 0.1)
    ends.append([run['contact_loss'][-1],
                 np.max(np.abs(run.energy_residual)) / run.energy_in_play])
print(json.dumps(ends))
""", encoding='utf-8')
    (less, _), (more, closed) = json.loads(house.run('drop.py'))
    assert 0.0 < 1.05 * less < more
    assert closed < 1e-6  # the energy balance closes


@pytest.mark.parametrize('copied, protocol, classes', [
    ('uart', 'vesc', "'Vesc', 'VescDevice'"),
    ('can', 'vesc_can', "'VescCan', 'VescCanDevice', CAN")])
def test_a_drive_needs_a_folder_and_a_line(house, copied, protocol, classes):
    house.copy(f'drives/vesc/{copied}', 'drives/own')
    house.change('drives/own/driver.py', (f"'{protocol}'", "'own'"))
    house.change('drives/__init__.py', (
        r"    'vesc': ", f"    'own': Vendor('ballbot_ros.drives.own', {classes}),\n    'vesc': "))
    # In real time, therefore with a fast solver.
    example = house.folder / 'examples' / 'emulated_drive.py'
    example.write_text(example.read_text().replace("load_scene('flat')", (
        "load_scene('flat', solver=Solver('semi_implicit', step=1e-3))")).replace(
        'import load_scene', 'import load_scene, Solver'), encoding='utf-8')
    printed = house.run('examples/emulated_drive.py', 'own')
    assert 'own, firmware' in printed
    assert [float(x) for x in re.findall(r'(\S+) rad', printed)][-1] > 0.0
    assert 'own' in house.run('-m', 'ballbot_ros.cli', 'emulate-motor', '--help')
    house.run('-m', 'ballbot_ros.cli', 'new', 'hardware', 'own.yaml', '--protocol', 'own')
    assert 'own' in house.run('-c', (
        'from ballbot_ros.bridge.hardware_file import load_hardware\n'
        "print(load_hardware('own.yaml').connection.protocol)"))


def test_an_inertial_sensor_needs_a_folder_and_a_line(house):
    house.copy('imus/witmotion', 'imus/own')
    house.change('imus/own/emulated.py', ('imus.witmotion.protocol', 'imus.own.protocol'))
    house.change('imus/own/protocol.py', ('HEADER, SIZE = 0x55', 'HEADER, SIZE = 0x77'))
    house.change('imus/__init__.py', (
        r"    'witmotion': ",
        "    'own': ImuVendor('ballbot_ros.imus.own', 'WitMotion', 'EmulatedWitMotion'),\n"
        "    'witmotion': "))
    program = house.folder / 'read.py'
    program.write_text("""
from ballbot_ros.drives.transport import Link
from ballbot_ros.emulator.imu_line import ImuLine
from ballbot_ros.imus import sensor_class
from ballbot_ros.imus.source import Axes, ImuSource
line = ImuLine(sensor='own')
line.measure(0.5, 0.0, 9.81)
source = ImuSource(sensor_class('own')(9600, 10, 98), lambda baud: Link(line.path, baud),
                   Axes('x y z'), 0.0)
found = []
while not found:
    found = source.read(0.05)
print(found[0])
line.stop()
""", encoding='utf-8')
    assert re.search(r'turn_rate=\(0.0, -0.499\d*, 0.0', house.run('read.py'))


def test_a_planner_needs_a_file_and_a_line(house):
    house.copy('decision/planning/cubic.py', 'decision/planning/timid.py')
    house.change('decision/planning/timid.py', (
        r'        return Choice\(\n            None if selected is None',
        '        selected, reason = None, Reason.TOO_HIGH\n'
        '        return Choice(\n            None if selected is None'))
    house.change('decision/planning/planners.py', (
        r'from ballbot_ros.decision.planning.cubic import CurveSelector\n',
        'from ballbot_ros.decision.planning.cubic import CurveSelector\n'
        'from ballbot_ros.decision.planning import timid\n'),
                 (r"\{\n    'cubic'",
                  "{'timid': partial(FacePlanner, timid.CurveSelector), 'cubic'"))
    loop = house.folder / 'examples' / 'closed_loop.py'
    loop.write_text(loop.read_text().replace("planner='rollout'", "planner='timid'").replace(
        '12 * RATE', 'RATE // 10'), encoding='utf-8')
    assert 'no plan crosses it from any start' in house.run('examples/closed_loop.py')


def test_a_limit_of_the_pendulum_rate_needs_a_field_of_the_tuning_and_two_lines(
        house):
    house.change('control/tuning.py', (r'    speed_gain: float', """\
    rate_limit: float = quantity(
        'rad/s', 'pendulum rate above which no torque accelerates it', above=0.0, maximum=100.0,
        default=100.0)
    speed_gain: float"""))
    house.change('control/controller.py', (
        r'        torque = limited\(unsaturated, self._tuning.torque_limit\)\n', """\
        torque = limited(unsaturated, self._tuning.torque_limit)
        if torque * readings.pendulum_rate > 0.0 \\
                and abs(readings.pendulum_rate) > self._tuning.rate_limit:
            torque = 0.0
"""))
    (house.folder / 'mine.yaml').write_text('rate_limit: 2.0\n', encoding='utf-8')
    program = house.folder / 'limited.py'
    program.write_text("""
from ballbot_ros.control import JointReadings, load_tuning, Mode, PendulumController, SetPoint
from ballbot_ros.physics import load_robot
for rate in (1.0, 3.0, -3.0):
    controller = PendulumController(load_robot('gimball'), load_tuning('mine.yaml'))
    controller.give(SetPoint(Mode.DRIVE, 50.0, 0.0))
    print(controller.torque(JointReadings(0.002, 0.0, 0.0, 0.0, rate)) > 0.0)
""", encoding='utf-8')
    assert house.run('limited.py').split() == ['True', 'False', 'True']
    written = house.folder / 'new.yaml'
    house.run('-m', 'ballbot_ros.cli', 'new', 'tuning', str(written))
    assert 'rate_limit' in written.read_text(encoding='utf-8')


def test_a_sensor_of_the_simulator_needs_a_topic_a_rate_and_a_message(house):
    house.change('ros/topics.py', (r"    'odom': ", """\
    'inclination': Topic('std_msgs/msg/Float64', STATE, SENSOR, 'simulator', '',
                         'angle of the pendulum'),
    'odom': """))
    house.change('nodes/simulator/settings.py', (r'    seed: int', """\
    inclination_rate: float = live(rate_of('inclination', 50.0))
    seed: int"""))
    house.change(
        'nodes/simulator/outputs.py',
        (r'from rclpy.publisher', 'from std_msgs.msg import Float64\nfrom rclpy.publisher'),
        (r'        rates = \{', "        rates = {'inclination': 'inclination_rate', "),
        (r"            elif topic == 'terrain_observation':", """\
            elif topic == 'inclination':
                message = Float64(data=plant.state.pendulum_angle)
            elif topic == 'terrain_observation':"""))
    program = house.folder / 'look.py'
    program.write_text("""
import rclpy
from ballbot_ros.nodes.simulator.node import Simulator
rclpy.init(args=['--ros-args', '-p', 'start_paused:=true', '-p', 'scene:=fig7_middle'])
node = Simulator()
for publisher, message in node._outputs._sensors.measure(everything=True):
    print(publisher.topic_name, getattr(message, 'data', ''))
""", encoding='utf-8')
    assert re.search(r'/inclination -?\d', house.run('look.py'))
    refused = house.folder / 'refused.py'
    refused.write_text(program.read_text().replace('start_paused:=true', 'inclination_rat:=5.0'))
    assert "did you mean 'inclination_rate'" in house.run('refused.py', fails=True)


def test_the_documents_name_the_copied_file_and_the_table():
    text = (ROOT / 'docs' / 'architecture.md').read_text(encoding='utf-8')
    rows = re.findall(r'^\| an? .*\|$', text, re.M)
    assert len(rows) == 11
    for row in rows:
        _, _, copied, registered, _ = row.split('|')
        places = [re.findall(r'`([\w/]+(?:\.py)?)`', cell) for cell in (copied, registered)]
        paths = [ROOT / 'ballbot_ros' / name for cell in places for name in cell if '/' in name]
        assert paths and all(path.exists() for path in paths), row
        table = re.search(r'`([A-Z]+)` in', registered)
        if table:
            assert f'\n{table.group(1)}' in paths[-1].read_text(encoding='utf-8'), row
