# SPDX-License-Identifier: Apache-2.0
"""
Solvers that are not ours, on our equations.

Each solver runs them twice: as our compiled right-hand side, and in NumPy, as a direct
transcription of docs/model.md.  All integrate the eight states of the motion only; our own solvers
also integrate the five of the energy balance.
"""
import math
import warnings

import numpy as np
from scipy.integrate import solve_ivp

from ballbot_ros.physics.mechanics import contact, equations
from ballbot_ros.physics.mechanics.equations import System
from ballbot_ros.physics.model.actuation import actuator_torque
from ballbot_ros.physics.model.state import (
    BALL_RATE, PENDULUM_ANGLE, PENDULUM_RATE, SIZE, VELOCITY_X, X, Y)
from ballbot_ros.physics.model.terrain import (
    EDGE_FRICTION, SURFACE_FRICTION, TANGENT_X, TANGENT_Y, TURN, VERTEX_X, VERTEX_Y)

MOTION = 8
SCIPY = ('RK45', 'DOP853', 'LSODA', 'Radau', 'BDF')
PLAIN = ('RK45', 'LSODA')  # also with the NumPy right-hand side: it only costs more
HOW_TO_INSTALL = '.venv/bin/python -m pip install -r requirements/bench.txt'

try:
    from sksundae.cvode import CVODE
except ImportError:
    CVODE = None


def compiled_rates(case):
    """Return our compiled right-hand side as a function of time and motion."""
    model = case.model
    table = contact.contact_table(len(model.profile))
    system = System(model.parameters, model.profile,
                    case.actuation.actuator(model.robot, 0.0, case.start.joint_angle))
    state, rates = np.zeros(SIZE), np.zeros(SIZE)
    derivative = equations.derivative

    def function(time, motion):
        state[:MOTION] = motion
        derivative(time, state, system, table, rates)
        return rates[:MOTION].copy()
    return function


def numpy_rates(case):
    """Return the right-hand side in plain NumPy."""
    robot, ground = case.model.parameters, case.model.profile
    actuator = case.actuation.actuator(case.model.robot, 0.0, case.start.joint_angle)
    vertices = ground[:, [VERTEX_X, VERTEX_Y]]
    tangents = ground[:-1, [TANGENT_X, TANGENT_Y]]

    def function(time, motion):
        ball_rate, swing_rate = motion[BALL_RATE], motion[PENDULUM_RATE]
        angle, velocity = motion[PENDULUM_ANGLE], motion[VELOCITY_X:]
        force, torque = np.zeros(2), 0.0
        for sign, normal, depth, friction in _contacts(
                motion[X:Y + 1], robot.radius, ground, vertices, tangents):
            tangent = np.array([normal[1], -normal[0]])
            pressed = max(robot.stiffness * depth - robot.damping * velocity @ normal, 0.0)
            slip = velocity @ tangent + (robot.radius - depth) * ball_rate
            drag = -pressed * friction * np.clip(slip / robot.slip_threshold, -1.0, 1.0)
            force += sign * pressed * normal + drag * tangent
            torque += drag * (robot.radius - depth)
        torque -= robot.rolling_friction * ball_rate
        swing = 0.0
        if robot.swing_inertia > 0.0:
            motor = actuator_torque(time, motion, actuator)
            joint = motor - robot.joint_friction * (swing_rate - ball_rate)
            across = np.array([np.cos(angle), np.sin(angle)])
            swing = (joint - robot.pendulum_moment / robot.mass * (force @ across)
                     ) / robot.swing_inertia
            torque -= joint
            inward = np.array([-np.sin(angle), np.cos(angle)])
            force = force - robot.pendulum_moment * (swing * across + swing_rate**2 * inward)
        gravity = np.array([0.0, -robot.gravity])
        return np.concatenate([
            [ball_rate, swing_rate if robot.swing_inertia > 0.0 else 0.0], velocity,
            [torque / robot.ball_inertia, swing], force / robot.mass + gravity])
    return function


def _contacts(centre, radius, ground, vertices, tangents):
    """Return sign, normal, depth and friction of each contact, from left to right."""
    found, last = [], len(tangents) - 1
    for index, tangent in enumerate(tangents):
        from_start, from_end = centre - vertices[index], centre - vertices[index + 1]
        after_start, after_end = from_start @ tangent, from_end @ tangent
        if (index == 0 or after_start > 0.0) and (index == last or after_end < 0.0):
            normal = np.array([-tangent[1], tangent[0]])
            found.append([1.0, normal, from_start @ normal, ground[index, SURFACE_FRICTION]])
        if index < last:
            next_after = from_end @ tangents[index + 1]
            concave = ground[index + 1, TURN] > 0.0
            distance = np.linalg.norm(from_end)
            if concave and after_end < 0.0 < next_after:
                found.append([-1.0, from_end / distance, distance, 0.0])
            elif not concave and after_end >= 0.0 >= next_after:
                found.append([1.0, from_end / distance, distance,
                              ground[index + 1, EDGE_FRICTION]])
    found = [[sign, normal, radius - distance, friction]
             for sign, normal, distance, friction in found if 0.0 < distance < radius]
    points = [centre - (radius - depth) * normal for _, normal, depth, _ in found]
    for row in range(1, len(found) - 1):
        if found[row][0] < 0.0:  # a corner takes its friction from its neighbours
            left, right = (np.linalg.norm(points[other] - points[row])
                           for other in (row - 1, row + 1))
            share = right / (left + right) if left + right > 0.0 else 0.5
            found[row - 1][3] *= 1.0 - share * found[row][2] / found[row - 1][2]
            found[row + 1][3] *= 1.0 - (1.0 - share) * found[row][2] / found[row + 1][2]
    return found


def largest_difference(case, states=200):
    """Return the largest relative difference of the two right-hand sides at random states."""
    ours, plain, draw = compiled_rates(case), numpy_rates(case), np.random.default_rng(2014)
    worst = 0.0
    for _ in range(states):
        motion = np.array(case.start[1:1 + MOTION]) + draw.normal(0.0, [
            1.0, 1.0, 0.2, 0.01, 5.0, 5.0, 0.5, 0.5])
        if not case.model.robot.has_pendulum:
            motion[[PENDULUM_ANGLE, PENDULUM_RATE]] = 0.0
        one, other = ours(0.0, motion), plain(0.0, motion)
        worst = max(worst, float(np.max(np.abs(one - other)) / (1.0 + np.max(np.abs(one)))))
    return worst


def solve_scipy(method, rates, case, tolerance):
    """Return end position and number of right-hand sides of a run by SciPy."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')  # of overflow, in the Jacobian of a ball in flight
        found = solve_ivp(rates, (0.0, case.duration), case.start[1:1 + MOTION], method=method,
                          rtol=tolerance, atol=tolerance, t_eval=[case.duration])
    end = found.y[:, -1] if found.success else np.full(MOTION, math.nan)
    return end[X], end[Y], found.nfev


def solve_cvode(method, rates, case, tolerance):
    """Return the same of a run by CVODE, method 'BDF' or 'Adams'."""
    calls = 0

    def fill(time, motion, out):
        nonlocal calls
        calls += 1
        out[:] = rates(time, motion)
    solver = CVODE(fill, method=method, rtol=tolerance, atol=tolerance, max_num_steps=10**7)
    found = solver.solve(np.array([0.0, case.duration]), np.array(case.start[1:1 + MOTION]))
    return found.y[-1][X], found.y[-1][Y], calls
