# SPDX-License-Identifier: Apache-2.0
"""
The steps of the adaptive method: to add one is to add its file, and its name here.

See `physics.solvers` for the contract.  The name is that of the method that takes this step alone.
"""
import numpy as np

from ballbot_ros.jit import by_number
from ballbot_ros.physics.solvers import dormand_prince, rodas5p

STEP_METHODS = {'explicit': dormand_prince, 'implicit': rodas5p}
EXPLICIT, IMPLICIT = range(2)  # between which the method `adaptive` alternates
DAMPS = np.array([item.DAMPS for item in STEP_METHODS.values()])

step = by_number('step', '', STEP_METHODS.values())
prepare_dense = by_number('prepare_dense', '', STEP_METHODS.values())
end_step = by_number('end_step', '', STEP_METHODS.values())
