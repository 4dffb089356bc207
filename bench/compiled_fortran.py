# SPDX-License-Identifier: Apache-2.0
"""
Call the Fortran solvers within SciPy as from Fortran.

ODEPACK's LSODA, DVODE, and Hairer's DOP853 and DOPRI5: one call is one run.  The
wrappers of SciPy expose their addresses, up to the version that replaces Fortran by C.
"""
import ctypes
import math

import compiled_rates
from compiled_rates import MOTION, NUMBERS, OPTIONS
from numba import cfunc, types
import numpy as np

from ballbot_ros.physics.model.state import X, Y

try:
    from scipy.integrate import _dop, _lsoda, _vode
    ADDRESSES = {name: module._cpointer for name, module in (
        ('lsoda', _lsoda.lsoda), ('dvode', _vode.dvode), ('dop853', _dop.dop853),
        ('dopri5', _dop.dopri5))}
except (ImportError, AttributeError):
    ADDRESSES = {}

MOST_STEPS = 10**7
LAST_STEP = 6  # index of the last step of DOP853, the first step of the next run
WHOLE = types.CPointer(types.int32)


def _routine(name):
    """Return a routine by its address."""
    get = ctypes.pythonapi.PyCapsule_GetPointer
    get.restype, get.argtypes = ctypes.c_void_p, (ctypes.py_object, ctypes.c_char_p)
    return ctypes.CFUNCTYPE(None)(get(ADDRESSES[name], None))


# LSODA passes the caller's array: the data of the case follow the motion.
@cfunc(types.void(WHOLE, NUMBERS, NUMBERS, NUMBERS), **OPTIONS)
def _lsoda_rates(_, time, motion, out):
    compiled_rates.call(
        compiled_rates.shifted(motion, MOTION), 0, compiled_rates.first(time), motion, out)


@cfunc(types.void(WHOLE, NUMBERS, NUMBERS, WHOLE, WHOLE, NUMBERS, WHOLE), **OPTIONS)
def _lsoda_slopes(_, time, motion, below, above, out, rows):
    compiled_rates.call(
        compiled_rates.shifted(motion, MOTION), 1, compiled_rates.first(time), motion, out)


@cfunc(types.void(WHOLE, NUMBERS, NUMBERS, NUMBERS, NUMBERS, WHOLE), **OPTIONS)
def _rates(_, time, motion, out, data, whole):
    compiled_rates.call(data, 0, compiled_rates.first(time), motion, out)


@cfunc(types.void(WHOLE, NUMBERS, NUMBERS, WHOLE, WHOLE, NUMBERS, WHOLE, NUMBERS, WHOLE),
       **OPTIONS)
def _slopes(_, time, motion, below, above, out, rows, data, whole):
    compiled_rates.call(data, 1, compiled_rates.first(time), motion, out)


class Run:
    """Runs of one case by one routine; all arguments but the tolerance are prepared."""

    def __init__(self, name, rates, duration, start, done):
        """Allocate the shared data; `start` and `done` are values of its state."""
        self.first, self.done, self.counted = start, done, 0
        self.arguments, self.whole, self.work = (), None, None
        self.routine, self.rates, self.kept = _routine(name), rates, []
        self.numbers = np.concatenate([rates.start, rates.data])
        self.time, self.state = ctypes.c_double(), ctypes.c_int32()
        self.tolerance, self.end = ctypes.c_double(), ctypes.c_double(duration)
        self.size = self.reference(ctypes.c_int32(MOTION))

    def reference(self, value):
        """Return a reference, and keep its target alive."""
        self.kept.append(value)
        return ctypes.byref(value)

    def integer(self, value):
        """Return a reference to an integer."""
        return self.reference(ctypes.c_int32(value))

    def array(self, value):
        """Return a reference to an array."""
        self.kept.append(value)
        return ctypes.c_void_p(value.ctypes.data)

    def evaluations(self):
        """Return the number of right-hand sides of the last run."""
        return int(self.whole[self.counted])

    def __call__(self, tolerance):
        """Run, and return the end position."""
        self.numbers[:MOTION], self.time.value = self.rates.start, 0.0
        self.work[LAST_STEP] = 0.0
        self.tolerance.value, self.state.value = tolerance, self.first
        self.routine(*self.arguments)
        if self.state.value != self.done:
            return math.nan, math.nan
        return self.numbers[X], self.numbers[Y]


def _multistep(name, function, slopes, kind, size, whole_size, more, rates, duration):
    """Return a run by LSODA or DVODE, which have the same signature."""
    call = Run(name, rates, duration, 1, 2)
    work, whole = np.zeros(size), np.zeros(whole_size, np.int32)
    whole[5] = MOST_STEPS
    tolerance, one = ctypes.byref(call.tolerance), call.integer(1)
    call.arguments = (
        function, call.size, call.array(call.numbers), ctypes.byref(call.time),
        ctypes.byref(call.end), one, tolerance, tolerance, one, ctypes.byref(call.state), one,
        call.array(work), call.integer(size), call.array(whole), call.integer(whole_size), slopes,
        call.integer(kind), *more(call))
    call.whole, call.counted, call.work = whole, 11, work
    return call


def lsoda(rates, duration, kind=2):
    """Return a run by LSODA; kind 1 with the Jacobian, 2 without."""
    return _multistep(
        'lsoda', ctypes.c_void_p(_lsoda_rates.address), ctypes.c_void_p(_lsoda_slopes.address),
        kind, max(20 + 16 * MOTION, 22 + 9 * MOTION + MOTION**2), 20 + MOTION, lambda call: (),
        rates, duration)


def dvode(rates, duration, kind=22):
    """Return a run by DVODE; kind 22 is BDF, 21 with the Jacobian, 10 Adams."""
    return _multistep(
        'dvode', ctypes.c_void_p(_rates.address), ctypes.c_void_p(_slopes.address), kind,
        22 + 9 * MOTION + 2 * MOTION**2, 30 + MOTION,
        lambda call: (call.array(call.rates.data), call.integer(0)), rates, duration)


def explicit(rates, duration, name='dop853'):
    """Return a run by DOP853 or DOPRI5."""
    call = Run(name, rates, duration, 1, 1)
    size, whole_size = 11 * MOTION + 21, 21
    work, whole = np.zeros(size), np.zeros(whole_size, np.int32)
    whole[0], whole[2], whole[3] = MOST_STEPS, -1, -1  # no messages, no test for stiffness
    tolerance, none = ctypes.byref(call.tolerance), call.integer(0)
    call.arguments = (
        call.size, ctypes.c_void_p(_rates.address), ctypes.byref(call.time),
        call.array(call.numbers), ctypes.byref(call.end), tolerance, tolerance, none, None, none,
        call.array(work), call.integer(size), call.array(whole), call.integer(whole_size),
        call.array(rates.data), none, ctypes.byref(call.state))
    call.whole, call.counted, call.work = whole, 16, work
    return call
