# SPDX-License-Identifier: Apache-2.0
"""
Call CVODE's C library, from the wheel of scikit-sundae, as from C.

It is dense and in double precision; a run is one call to reinitialize and one to integrate.
"""
import ctypes
import math
from pathlib import Path

import compiled_rates
from compiled_rates import MOTION, NUMBERS, OPTIONS, target_of
from numba import cfunc, types
import numpy as np

from ballbot_ros.physics.model.state import X, Y

try:
    import sksundae
    from sksundae._cy_common import INT_TYPE
    FOLDER = Path(sksundae.__file__).parents[1] / 'scikit_sundae.libs'
    LIBRARIES = {
        name: ctypes.CDLL(str(next(FOLDER.glob(f'libsundials_{name}-*'))))
        for name in ('core', 'nvecserial', 'sunmatrixdense', 'sunlinsoldense', 'cvode')}
except (ImportError, StopIteration, OSError):
    LIBRARIES, INT_TYPE = {}, np.int32

ADAMS, BDF = 1, 2
MOST_STEPS = 10**7
WIDTH = np.dtype(INT_TYPE).itemsize
# Vector and matrix start with a pointer to their content; offset of the numbers in the content.
IN_VECTOR, IN_MATRIX = (8, 8) if WIDTH == 4 else (16, 16)
PLACE = types.voidptr


@cfunc(types.int32(types.float64, NUMBERS, NUMBERS, NUMBERS), **OPTIONS)
def _rates(time, motion, out, data):
    compiled_rates.call(data, 0, time, target_of(target_of(motion, 0), IN_VECTOR),
                        target_of(target_of(out, 0), IN_VECTOR))
    return 0


@cfunc(types.int32(types.float64, NUMBERS, NUMBERS, NUMBERS, NUMBERS, PLACE, PLACE, PLACE),
       **OPTIONS)
def _slopes(time, motion, _, out, data, one, two, three):
    compiled_rates.call(data, 1, time, target_of(target_of(motion, 0), IN_VECTOR),
                        target_of(target_of(out, 0), IN_MATRIX))
    return 0


def _function(library, name, *kinds, result=ctypes.c_int):
    """Return a function of SUNDIALS."""
    found = getattr(LIBRARIES[library], name)
    found.restype, found.argtypes = result, kinds
    return found


class Cvode:
    """Runs of one case by one method."""

    def __init__(self, rates, duration, method=BDF, slopes=False, newton=True):
        place, real, whole = ctypes.c_void_p, ctypes.c_double, ctypes.c_int
        index = ctypes.c_int32 if WIDTH == 4 else ctypes.c_int64
        self.context = place()
        _function('core', 'SUNContext_Create', whole, ctypes.POINTER(place))(
            0, ctypes.byref(self.context))
        _function('core', 'SUNContext_ClearErrHandlers', place)(self.context)
        self.rates, self.motion = rates, rates.start.copy()
        self.vector = _function(
            'nvecserial', 'N_VMake_Serial', index, place, place, result=place)(
            MOTION, self.motion.ctypes.data, self.context)
        self.memory = _function('cvode', 'CVodeCreate', whole, place, result=place)(
            method, self.context)
        memory = self.memory
        self.call('CVodeInit', place, real, place)(memory, _rates.address, 0.0, self.vector)
        self.call('CVodeSetUserData', place)(memory, rates.data.ctypes.data)
        self.call('CVodeSetMaxNumSteps', ctypes.c_long)(memory, MOST_STEPS)
        self.tolerances = self.call('CVodeSStolerances', real, real)
        self.tolerances(memory, 1e-6, 1e-6)
        if newton:
            matrix = _function('sunmatrixdense', 'SUNDenseMatrix', index, index, place,
                               result=place)(MOTION, MOTION, self.context)
            solver = _function('sunlinsoldense', 'SUNLinSol_Dense', place, place, place,
                               result=place)(self.vector, matrix, self.context)
            self.call('CVodeSetLinearSolver', place, place)(memory, solver, matrix)
            if slopes:
                self.call('CVodeSetJacFn', place)(memory, _slopes.address)
        else:
            solver = _function('cvode', 'SUNNonlinSol_FixedPoint', place, whole, place,
                               result=place)(self.vector, 0, self.context)
            self.call('CVodeSetNonlinearSolver', place)(memory, solver)
        self.again = self.call('CVodeReInit', real, place)
        self.solve = self.call('CVode', real, place, ctypes.POINTER(real), whole)
        self.count = self.call('CVodeGetNumRhsEvals', ctypes.POINTER(ctypes.c_long))
        self.count_more = self.call('CVodeGetNumLinRhsEvals', ctypes.POINTER(ctypes.c_long))
        self.time, self.calls, self.duration = real(), ctypes.c_long(), duration
        self.newton, self.tolerance = newton, math.nan

    def call(self, name, *kinds):
        """Return a function of SUNDIALS whose first argument is the solver memory."""
        return _function('cvode', name, ctypes.c_void_p, *kinds)

    def evaluations(self):
        """Return the number of right-hand sides of the last run, including Jacobians."""
        self.count(self.memory, ctypes.byref(self.calls))
        found = self.calls.value
        if self.newton:
            self.count_more(self.memory, ctypes.byref(self.calls))
            found += self.calls.value
        return found

    def __call__(self, tolerance):
        """Run, and return the end position."""
        if tolerance != self.tolerance:
            self.tolerances(self.memory, tolerance, tolerance)
            self.tolerance = tolerance
        self.motion[:] = self.rates.start
        self.again(self.memory, 0.0, self.vector)
        if self.solve(self.memory, self.duration, self.vector, ctypes.byref(self.time), 1) < 0:
            return math.nan, math.nan
        return self.motion[X], self.motion[Y]
