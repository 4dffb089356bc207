# SPDX-License-Identifier: Apache-2.0
"""All kernels of the loop are compiled before it starts."""
import os
import subprocess
import sys

import pytest

from ballbot_ros.jit import COMPILED

# In a new process, because other tests have already compiled kernels in this one.
PROGRAM = """
from virtual_robot import VirtualRobot
from ballbot_ros.compile_notice import on_first_call
from ballbot_ros.control import ControlTuning, Mode, PendulumController, SetPoint
from ballbot_ros.physics import load_robot

robot = VirtualRobot(held=True)


def refuse(kernel, kept):
    raise AssertionError(f'{kernel} is called for the first time')


on_first_call(refuse)
robot.ready()
robot.run(0.1, torque=0.1)
for mode in Mode:
    controller = PendulumController(load_robot('gimball'), ControlTuning())
    for _ in range(20):
        readings = robot.run(0.002).estimate.readings
        controller.give(SetPoint(mode, 0.1, readings.stamp))
        controller.torque(readings)
"""


@pytest.mark.slow
@pytest.mark.skipif(not COMPILED, reason='nothing is compiled')
def test_a_session_compiles_nothing_after_its_start():
    subprocess.run([sys.executable, '-c', PROGRAM], check=True, env={
        **os.environ, 'PYTHONPATH': os.pathsep.join([os.path.dirname(__file__), *sys.path])})
