# SPDX-License-Identifier: Apache-2.0
"""The Sobol points of the package equal those of SciPy."""
import subprocess
import sys

import numpy as np
import pytest

from ballbot_ros.physics.model.uncertainty import DIMENSIONS, sobol


@pytest.mark.parametrize('dimensions', [1, 2, 9, DIMENSIONS])
@pytest.mark.parametrize('power, seed', [(0, 0), (1, 1), (8, 5)])
def test_sobol_points_equal_those_of_scipy(dimensions, power, seed):
    from scipy.stats import qmc
    expected = qmc.Sobol(dimensions, seed=seed).random_base2(power)
    np.testing.assert_array_equal(sobol(dimensions, power, seed), expected)


WITHOUT_SCIPY = """
import sys
from ballbot_ros import control, decision
from ballbot_ros.decision.learning.particles import Particles
from ballbot_ros.physics import load_robot
robot = load_robot('gimball')
control.check_loop(robot, control.load_tuning('published'), control.Mode.SPEED, 500.0, 0)
Particles.of(robot, 0.001)
print({'scipy.linalg', 'scipy.optimize', 'scipy.sparse', 'scipy.stats'} & set(sys.modules))
"""


@pytest.mark.slow
def test_a_decision_and_a_loop_check_do_not_import_scipy():
    # Importing SciPy would delay each start of a node by more than a second.  The compiler needs
    # SciPy, so the first run compiles missing kernels, and the second run is typical.
    for _ in range(2):
        done = subprocess.run([sys.executable, '-c', WITHOUT_SCIPY], capture_output=True,
                              text=True, check=True)
    assert done.stdout.strip() == 'set()'
