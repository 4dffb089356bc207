# SPDX-License-Identifier: Apache-2.0
"""
Peer solvers on our compiled right-hand side.

They integrate only the eight states of the motion; our solvers also integrate the five states of
the energy balance.
"""
import math
import warnings

import numpy as np
from scipy.integrate import solve_ivp

from ballbot_ros.physics.mechanics import contact, equations
from ballbot_ros.physics.mechanics.equations import System
from ballbot_ros.physics.model.state import SIZE, X, Y

MOTION = 8
SCIPY = ('RK45', 'DOP853', 'LSODA', 'Radau', 'BDF')
HOW_TO_INSTALL = '.venv/bin/python -m pip install -r requirements/bench.txt'

try:
    from sksundae.cvode import CVODE
except ImportError:
    CVODE = None


def compiled_rates(case):
    """Return our compiled right-hand side as a function of time and motion."""
    model = case.model
    mode = contact.ContactMode.of(len(model.profile))
    system = System(model.parameters, model.profile,
                    case.actuation.actuator(model.robot, 0.0, case.start.joint_angle))
    state, rates = np.zeros(SIZE), np.zeros(SIZE)
    derivative = equations.derivative

    def function(time, motion):
        state[:MOTION] = motion
        derivative(time, state, system, mode, rates)
        return rates[:MOTION].copy()
    return function


def solve_scipy(method, rates, case, tolerance):
    """Return end position and number of right-hand sides of a run by SciPy."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')  # overflow in the Jacobian of a ball in flight
        found = solve_ivp(rates, (0.0, case.duration), case.start[1:1 + MOTION], method=method,
                          rtol=tolerance, atol=tolerance, t_eval=[case.duration])
    end = found.y[:, -1] if found.success else np.full(MOTION, math.nan)
    return end[X], end[Y], found.nfev


def solve_cvode(method, rates, case, tolerance):
    """Return end position and right-hand sides of a run by CVODE, 'BDF' or 'Adams'."""
    calls = 0

    def fill(time, motion, out):
        nonlocal calls
        calls += 1
        out[:] = rates(time, motion)
    solver = CVODE(fill, method=method, rtol=tolerance, atol=tolerance, max_num_steps=10**7)
    found = solver.solve(np.array([0.0, case.duration]), np.array(case.start[1:1 + MOTION]))
    return found.y[-1][X], found.y[-1][Y], calls
