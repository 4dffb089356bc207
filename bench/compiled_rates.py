# SPDX-License-Identifier: Apache-2.0
"""
Our right-hand side with C calling convention, for solvers in C, C++ and Fortran.

It is compiled for each scene with robot and ground as constants, so that the compiler removes
unused terms; our own solvers do not have this advantage.  It does not call Python.
"""
import ctypes
from typing import NamedTuple

from llvmlite import ir
from numba import cfunc, types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array, populate_array
import numpy as np
import peers
from peers import MOTION

from ballbot_ros.physics.mechanics import equations, modes
from ballbot_ros.physics.mechanics.contact import ContactMode
from ballbot_ros.physics.mechanics.equations import angle_trig, System
from ballbot_ros.physics.model.state import COORDINATES, PENDULUM_ANGLE, PENDULUM_RATE, SIZE

OPTIONS = {'error_model': 'numpy', '_nrt': False}
NUMBERS = types.CPointer(types.float64)
# Time, motion, output, work array.
SIGNATURE = types.void(types.float64, NUMBERS, NUMBERS, NUMBERS)


class Rates(NamedTuple):
    """The right-hand side of a case, compiled, and its Jacobian."""

    rates: object  # referenced, so that the code is not freed
    slopes: object
    start: np.ndarray
    data: np.ndarray  # addresses of both functions, then their work array


def _array(number, dimensions):
    """Return a function of pointer, offset in elements and shape that makes an array."""
    kind = types.Array(number, dimensions, 'C')

    def generate(context, builder, signature, arguments):
        found, width = make_array(kind)(context, builder), context.get_constant(types.intp, 8)
        shape = arguments[2:]
        strides = [builder.mul(shape[1], width), width] if dimensions == 2 else [width]
        place = builder.gep(arguments[0], [arguments[1]])
        populate_array(found, builder.bitcast(place, found.data.type), shape, strides, width, None)
        return found._getvalue()

    if dimensions == 1:
        return intrinsic(lambda _, place, offset, size: (
            kind(place, types.intp, types.intp), generate))
    return intrinsic(lambda _, place, offset, rows, columns: (
        kind(place, types.intp, types.intp, types.intp), generate))


vector, table, whole_table = (
    _array(types.float64, 1), _array(types.float64, 2), _array(types.int64, 2))


def compiled_case(case, with_slopes=True):
    """Compile the right-hand side of a case, and its Jacobian by column on request."""
    model = case.model
    parameters, ground = model.parameters, model.profile
    actuator = case.actuation.actuator(model.robot, 0.0, case.start.joint_angle)
    (signs, sign_columns), (rows, columns) = (item.shape for item in ContactMode.of(len(ground)))
    room = SIZE + rows * columns
    slope_rows, slope_columns = modes.jacobian_table().shape

    @cfunc(SIGNATURE, **OPTIONS)
    def rates(time, motion, out, space):
        found = vector(space, 0, SIZE)
        mode = ContactMode(whole_table(space, room, signs, sign_columns),
                           table(space, SIZE, rows, columns))
        equations.derivative(
            time, vector(motion, 0, MOTION), System(parameters, ground, actuator), mode, found)
        target = vector(out, 0, MOTION)
        for item in range(MOTION):
            target[item] = found[item]

    @cfunc(SIGNATURE, **OPTIONS)
    def slopes(time, motion, out, space):
        system = System(parameters, ground, actuator)
        state = vector(motion, 0, MOTION)
        mode = ContactMode(whole_table(space, room, signs, sign_columns),
                           table(space, SIZE, rows, columns))
        found = table(space, room + signs * sign_columns, slope_rows, slope_columns)
        modes.find_mode(time, state, system, mode)
        modes.write_jacobian(
            time, state, angle_trig(state[PENDULUM_ANGLE])[1:], system, mode, found)
        target = table(out, 0, MOTION, MOTION)
        for column in range(MOTION):
            for row in range(COORDINATES):
                target[column, row] = 0.0
                target[column, row + COORDINATES] = found[row, column]
            if column >= COORDINATES and (
                    column != PENDULUM_RATE or parameters.swing_inertia > 0.0):
                target[column, column - COORDINATES] = 1.0

    data = np.zeros(2 + room + signs * sign_columns + slope_rows * slope_columns)
    data[:2].view(np.int64)[:] = rates.address, slopes.address if with_slopes else 0
    return Rates(rates, slopes, np.array(case.start[1:1 + MOTION]), data)


@intrinsic
def shifted(_, place, numbers):
    """Return a pointer advanced by a number of elements."""
    return place(place, types.intp), lambda context, builder, signature, arguments: builder.gep(
        arguments[0], [arguments[1]])


@intrinsic
def first(_, place):
    """Return the number at a pointer."""
    return types.float64(place), lambda context, builder, signature, arguments: builder.load(
        arguments[0])


@intrinsic
def target_of(_, place, offset):
    """Return the pointer stored at a byte offset."""
    def generate(context, builder, signature, arguments):
        found = builder.gep(builder.bitcast(arguments[0], cgutils.voidptr_t), [arguments[1]])
        kind = context.get_value_type(NUMBERS)
        return builder.load(builder.bitcast(found, kind.as_pointer()))
    return NUMBERS(place, types.intp), generate


@intrinsic
def call(_, data, which, time, motion, out):
    """Call function 0 or 1 of the data of a case."""
    def generate(context, builder, signature, arguments):
        place, which, time, motion, out = arguments
        kind = context.get_value_type(NUMBERS)
        function = ir.FunctionType(ir.VoidType(), [time.type, kind, kind, kind])
        address = builder.load(builder.gep(
            builder.bitcast(place, ir.IntType(64).as_pointer()), [which]))
        space = builder.gep(place, [context.get_constant(types.intp, 2)])
        builder.call(builder.inttoptr(address, function.as_pointer()),
                     [time, motion, out, space])
        return context.get_dummy_value()
    return types.void(NUMBERS, types.intp, types.float64, NUMBERS, NUMBERS), generate


@cfunc(SIGNATURE, **OPTIONS)
def plain_rates(time, motion, out, data):
    """Write the rates of a motion; this is the simplest of the calling conventions."""
    call(data, 0, time, motion, out)


def largest_difference(case, rates, states=100):
    """Return the relative deviation of the compiled right-hand side from ours at random states."""
    ours, draw, out = peers.compiled_rates(case), np.random.default_rng(2014), np.zeros(MOTION)
    worst = 0.0
    for _ in range(states):
        motion = rates.start + draw.normal(0.0, [1.0, 1.0, 0.2, 0.01, 5.0, 5.0, 0.5, 0.5])
        places = (value.ctypes.data_as(ctypes.POINTER(ctypes.c_double))
                  for value in (motion, out, rates.data))
        plain_rates.ctypes(0.0, *places)
        wanted = ours(0.0, motion)
        worst = max(worst, float(np.max(np.abs(wanted - out)) / (1.0 + np.max(np.abs(wanted)))))
    return worst
