# SPDX-License-Identifier: Apache-2.0
"""
One rollout: from the present state to the verdict, in one sampled world.

A *plan row* contains a plan, a *draw row* the parameters of one world, a *result row* the
outcome: rows of numbers, so that many rollouts are one array.

The rolling model holds until the pendulum swings or the touch is near; then the full model
continues until the ball is over, back or stuck.  The ball is over once it is clear of the edge
(see `crossing.rules`), under the commands of the pilot.  A second rolling phase, which starts when
the ball rolls behind the edge, gives the position at which it can rest.

The rolling model has the equations of `control.rolling_model`, with law (11) in the motor.  The
derivative gain causes a pole of some hundred per second, so the rate of the pendulum is stepped
implicitly, and steps may be ten times longer.
"""
import math
from typing import NamedTuple

import numpy as np

from ballbot_ros.control.rolling_model import rolling_loads, RollingNumbers
from ballbot_ros.control.speed_law import Numbers, speed_law_start, SpeedState
from ballbot_ros.crossing.attempt import RETREAT
from ballbot_ros.crossing.rules import CLEARANCE
from ballbot_ros.decision.execution.pilot import pilot_step, PlainOrder
from ballbot_ros.decision.planning.ahead import CONTACT_TIME_MAX, FACES_MAX
from ballbot_ros.decision.values import REST_SPEED_MAX
from ballbot_ros.jit import compiled, in_python, outlined, packer, unlocked, unpacker
from ballbot_ros.physics.mechanics.contact import (
    ContactMode, find_contacts, first_segment, IntArray, loads_of, OWN, POINT_X, touching_at)
from ballbot_ros.physics.mechanics.equations import read_parameters, write_rates
from ballbot_ros.physics.model.actuation import applied_torque, position_torque
from ballbot_ros.physics.model.robot import Parameters
from ballbot_ros.physics.model.state import (
    BALL_RATE, PENDULUM_ANGLE, PENDULUM_RATE, SIZE, VELOCITY_X, VELOCITY_Y, X, Y)
from ballbot_ros.physics.model.terrain import (
    Array, EDGE_FRICTION, SURFACE_FRICTION, TANGENT_X, TANGENT_Y, TURN, VERTEX_X, VERTEX_Y)
from ballbot_ros.physics.solvers.semi_implicit import apply_rates

# Outcome of a rollout.
OVER, STUCK, FALLS = range(3)
# Columns of a plan: positions are those of the ball's centre along the odometry axis.
SPEED = 0         # set speed [m/s]; 0 for an emergency stop
SWING_AT = 1      # start of the swing [m]; infinite for none
SWING_ANGLE = 2   # to this absolute angle [rad], until the ball is past the last edge
START = 3         # start of the plan, from rest, if that is behind the ball [m]
EDGE = 4          # end of the swing, and start of the stop [m]
EDGE_AT = 5       # number of the vertex of the ground behind which the ball is over
NEXT_AT = 6       # vertex of the foot of the next face, which it must not touch; last for none
CONTINUES = 7     # 1 if the ball continues behind the last edge, 0 if it stops there
PLAN = 8
# Columns of a draw. The first are the robot, in the order of `Parameters`.
ROBOT = len(Parameters._fields)
FLOOR_FRICTION = ROBOT  # coefficients of friction
CORNER_FRICTION = ROBOT + 1
SLOPE = ROBOT + 2      # added to the slope of the ground ahead [rad]
HEIGHT = ROBOT + 3     # deviations of the heights of the first faces [m]
PLACE = HEIGHT + FACES_MAX  # and of their positions [m]
DRAW = PLACE + FACES_MAX
# Columns of a result.
VERDICT = 0
TOUCH_SPEED = 1   # when the ball first touches a face [m/s]; NaN if it does not
TOUCH_ANGLE = 2   # of the pendulum at that time [rad]
REST = 3          # where it stops behind the last edge, at most the end of the ground [m]
PASSED_SPEED = 4  # when the centre has passed the last edge [m/s]; NaN if it does not
RESULT = 5


class Drive(NamedTuple):
    """Parameters of pilot, control law and motor; plain tuples inside."""

    kp: float  # of law (11) [N m/rad]
    kd: float  # [N m s/rad]
    compensated: float  # 1 with gravity compensation, 0 without
    limit: float  # of the torque [N m]
    motor_line: tuple[float, float, float, float]  # see `Robot.motor_line`
    law: Numbers  # of the speed law
    lean: float  # see `pilot.Order` [rad]
    emergency_lean: float
    reaction: float  # [s]
    cruise: float  # speed behind the last edge [m/s]


class Scratch(NamedTuple):
    """Work arrays of a rollout; one set for each thread."""

    state: Array  # (13,)
    rates: Array  # (13,)
    ground: Array  # (n, 7), see `Terrain.profile`
    mode: ContactMode  # only its table of contacts is used

    @classmethod
    def of(cls, vertices: int) -> 'Scratch':
        """Return arrays for a ground with this number of vertices."""
        return cls(np.zeros(SIZE), np.zeros(SIZE), np.zeros((vertices, 7)),
                   ContactMode.of(vertices))


pack_scratch, unpack_scratch = in_python(packer(Scratch)), unpacker(Scratch)


class Rolling(NamedTuple):
    """The state of a rolling ball."""

    position: float  # of the centre, horizontally [m]
    speed: float  # along the ground [m/s]
    angle: float  # of the pendulum, absolute [rad]
    rate: float  # [rad/s]


@compiled
def roll(now: Rolling, set_angle: float, slope: float, step: float, robot: Parameters,
         drive: Drive) -> Rolling:
    """
    Return the state a step [s] later, under a set angle of law (11) [rad].

    The slope of the ground is positive uphill [rad].
    """
    radius = robot.radius - robot.mass * robot.gravity / robot.stiffness
    moment, spin = robot.pendulum_moment, -now.speed / radius
    inertia = robot.ball_inertia + robot.mass * radius * radius
    on_pendulum, on_ball, coupling = rolling_loads(
        now.angle, now.rate, spin, slope, RollingNumbers(
            robot.pendulum_inertia, inertia, moment * radius, moment * robot.gravity,
            robot.joint_friction, robot.rolling_friction, robot.mass * robot.gravity * radius)[:])
    # Both equations without theta1'': factor * torque + rest = left * phi''.
    factor = 1.0 - coupling / inertia
    rest, left = on_pendulum + coupling / inertia * on_ball, (
        robot.pendulum_inertia - coupling * coupling / inertia)
    weight = drive.compensated * moment * robot.gravity * math.sin(now.angle)
    # The torque at the end of the step: kp (set - phi - h phi'_new) - kd phi'_new + weight.
    fixed = drive.kp * (set_angle - now.angle) + weight
    damping = drive.kd + drive.kp * step
    rate = (now.rate + step * (factor * fixed + rest) / left) / (
        1.0 + step * factor * damping / left)
    requested = fixed - damping * rate
    torque = applied_torque(requested, now.rate - spin, drive.motor_line, drive.limit)
    if torque != requested:
        rate = now.rate + step * (factor * torque + rest) / left
    turned = (rate - now.rate) / step
    speed = now.speed - step * radius * (on_ball - torque + coupling * turned) / inertia
    return Rolling(now.position + 0.5 * step * (now.speed + speed) * math.cos(slope), speed,
                   now.angle + step * rate, rate)


# The period of the control loop, in which the torque is constant [s].
PERIOD = 0.002


@compiled
def torque_of(state: Array, set_angle: float, robot: Parameters, drive: Drive) -> float:
    """Return the torque of law (11) within the limits of the motor [N m]."""
    requested = position_torque(
        state[PENDULUM_ANGLE], state[PENDULUM_RATE], set_angle, drive.kp, drive.kd,
        drive.compensated * robot.pendulum_moment * robot.gravity)
    return applied_torque(requested, state[PENDULUM_RATE] - state[BALL_RATE], drive.motor_line,
                          drive.limit)


@compiled
def push(state: Array, torque: float, step: float, robot: Parameters, ground: Array,
         mode: ContactMode, rates: Array) -> float:
    """Advance a state in place, and return the x of its foremost contact [m]; -inf for none."""
    count = find_contacts(state[X], state[Y], robot.radius, ground, mode.contacts)
    loads = loads_of(state, robot, ground, mode, count, OWN)
    write_rates(state, robot, loads, torque, rates)
    apply_rates(state, step, rates, VELOCITY_Y + 1)
    return mode.contacts[count - 1, POINT_X] if count > 0 else -math.inf


SHAPE_X, SHAPE_Z, FACE, HEIGHT_FRACTION, PLACE_FRACTION = range(5)
# Minimum distance between two vertices of a draw [m].
VERTEX_DISTANCE_MIN = 1e-6


@compiled
def fill_ground(shape: Array, draw: Array, raised: float, here: float, ground: Array) -> None:
    """
    Write the (n, 7) ground of a draw for an (n, 5) shape, in the format of `Terrain.profile`.

    The first face is `raised` [m]; the deviation of the slope starts at the ball, `here` [m].
    """
    count = len(shape)
    before = -math.inf
    for i in range(count):
        face = int(shape[i, FACE])
        x, z = shape[i, SHAPE_X], shape[i, SHAPE_Z]
        for j in range(min(face + 1, FACES_MAX)):
            fraction = shape[i, HEIGHT_FRACTION] if j == face else 1.0
            z += fraction * draw[HEIGHT + j]
            if j == 0:
                z += fraction * raised
        if 0 <= face < FACES_MAX:
            x += shape[i, PLACE_FRACTION] * draw[PLACE + face]
        x = max(x, before)
        z += math.tan(draw[SLOPE]) * (x - here)
        if i > 0 and x == before and abs(z - ground[i - 1, VERTEX_Y]) < VERTEX_DISTANCE_MIN:
            x += VERTEX_DISTANCE_MIN
        ground[i, VERTEX_X], ground[i, VERTEX_Y] = x, z
        ground[i, SURFACE_FRICTION] = draw[FLOOR_FRICTION]
        ground[i, EDGE_FRICTION] = draw[CORNER_FRICTION]
        before = x
    # The end segments extend to infinity and must not be vertical.
    ground[0, VERTEX_X] = min(ground[0, VERTEX_X], ground[1, VERTEX_X] - VERTEX_DISTANCE_MIN)
    ground[count - 1, VERTEX_X] = max(ground[count - 1, VERTEX_X],
                                      ground[count - 2, VERTEX_X] + VERTEX_DISTANCE_MIN)
    write_tangents(ground)


@compiled
def write_tangents(ground: Array) -> None:
    """Write the tangents of all segments, and the turns of all vertices."""
    count = len(ground)
    for i in range(count - 1):
        along = ground[i + 1, VERTEX_X] - ground[i, VERTEX_X]
        up = ground[i + 1, VERTEX_Y] - ground[i, VERTEX_Y]
        length = math.sqrt(along * along + up * up)
        ground[i, TANGENT_X], ground[i, TANGENT_Y] = along / length, up / length
    ground[0, TURN] = ground[count - 1, TURN] = 0.0
    for i in range(1, count - 1):
        ground[i, TURN] = (ground[i - 1, TANGENT_X] * ground[i, TANGENT_Y]
                           - ground[i - 1, TANGENT_Y] * ground[i, TANGENT_X])


DECISION_PERIODS = 10  # control periods between two set angles: 50 Hz
ROLLING_STEP = 0.01  # step of the rolling model [s]
ROLLING_STEPS = 2  # of them between two set angles
BEND_MAX = 0.03  # sine of a bend of the ground without effect on a rolling ball
FULL_MODEL_LEAD = 0.02  # the full model starts this far before the touch [m]
PROGRESS_MIN = 0.001  # minimum progress [m]
DURATION_MAX = 15.0  # maximum duration of an approach [s]
TIME_TO_ROLL_MAX = 2.5  # maximum time until the ball rolls forward [s]
IDLE_TIME_MAX = 0.6  # maximum time without progress in contact [s]
SETTLED_HEIGHT_MAX = 0.002  # a ball no higher above the ground rolls on it [m]
STOP_DELAY = 0.02  # delay of the stop after the edge [s]
OBSTACLE_CLEARANCE = 0.04  # clearance between the standing ball and the next obstacle [m]


@compiled
def slope_at(ground: Array, x: float) -> float:
    """Return the slope of the ground below a position [rad]."""
    segment = first_segment(ground, x)
    return math.atan2(ground[segment, TANGENT_Y], ground[segment, TANGENT_X])


@compiled
def touch_at(ground: Array, foot: int, vertex: int, radius: float) -> float:
    """Return the position of the centre when a ball before a foot touches a vertex [m]."""
    cosine, sine = ground[foot - 1, TANGENT_X], ground[foot - 1, TANGENT_Y]
    away = ground[vertex, VERTEX_X] - ground[foot, VERTEX_X]
    rise = ground[vertex, VERTEX_Y] - ground[foot, VERTEX_Y] - sine / cosine * away
    along = touching_at(radius, radius, max(rise, 0.0), cosine, sine)
    position: float = ground[vertex, VERTEX_X] + along * cosine - radius * sine
    return position


@compiled
def next_rough(ground: Array, behind: int) -> int:
    """Return the first vertex after `behind` that affects a rolling ball; the last for none."""
    last = len(ground) - 1
    for i in range(behind + 1, last):
        if abs(ground[i, TURN]) > BEND_MAX:
            return i
    return last


@compiled
def reached_at(ground: Array, rough: int, radius: float) -> float:
    """Return the position that the centre can reach before a vertex or the face behind it [m]."""
    if rough >= len(ground) - 1:
        return math.inf
    first: float = ground[rough, VERTEX_X]
    for i in range(rough, len(ground) - 1):
        if ground[i, VERTEX_X] > ground[rough, VERTEX_X] + radius:
            break
        first = min(first, touch_at(ground, rough, i, radius))
    return first


@compiled
def order_of(plan: Array, drive: Drive) -> PlainOrder:
    """Return the order of the pilot for a plan."""
    after = min(plan[SPEED], drive.cruise) if plan[CONTINUES] > 0.0 else 0.0
    stop = -math.inf if plan[SPEED] == 0.0 else math.inf
    return (drive.lean, drive.emergency_lean, drive.reaction, plan[SPEED], 0.0, stop,
            plan[SWING_AT], plan[SWING_ANGLE], plan[EDGE], after)


@outlined
def roll_until(until: float, rising: float, now: Rolling, order: PlainOrder, robot: Parameters,
               drive: Drive, ground: Array) -> tuple[Rolling, SpeedState]:
    """
    Simulate rolling to a position or to rest; return the final states of ball and speed law.

    A ball that starts at rest, or rolling back, must move forward within `rising` [s].
    """
    time, set_angle, count = 0.0, 0.0, 0
    memory = speed_law_start(now.speed, now.angle, slope_at(ground, now.position), drive.law)
    while now.position < until and time < DURATION_MAX and (
            now.speed > REST_SPEED_MAX or time < rising):
        if count % ROLLING_STEPS == 0:
            memory, set_angle = pilot_step(
                memory, now.position, now.speed, order, ROLLING_STEPS * ROLLING_STEP, drive.law)
        now = roll(now, set_angle, slope_at(ground, now.position), ROLLING_STEP, robot, drive)
        time += ROLLING_STEP
        count += 1
    return now, memory


@compiled
def height_above(state: Array, robot: Parameters, ground: Array) -> float:
    """Return the height of a ball above the ground below its centre [m]."""
    i = first_segment(ground, state[X])
    floor = ground[i, VERTEX_Y] + (state[X] - ground[i, VERTEX_X]) * (
        ground[i, TANGENT_Y] / ground[i, TANGENT_X])
    height: float = (state[Y] - floor) * ground[i, TANGENT_X] - robot.radius
    return height


@compiled
def rest_position(state: Array, robot: Parameters, drive: Drive, ground: Array) -> float:
    """Return the stop position under full lean, at most the end of the ground [m]."""
    now = Rolling(state[X], state[VELOCITY_X], state[PENDULUM_ANGLE], state[PENDULUM_RATE])
    order = (drive.emergency_lean, drive.emergency_lean, drive.reaction, 0.0, 0.0, -math.inf,
             math.inf, 0.0, -math.inf, 0.0)
    now, _ = roll_until(
        ground[len(ground) - 1, VERTEX_X], 0.0, now, order, robot, drive, ground)
    return now.position


@compiled
def place(now: Rolling, robot: Parameters, ground: Array, state: Array) -> None:
    """Write the state of the full model for a rolling ball."""
    segment = first_segment(ground, now.position)
    cosine, sine = ground[segment, TANGENT_X], ground[segment, TANGENT_Y]
    distance = robot.radius - robot.mass * robot.gravity * cosine / robot.stiffness
    for i in range(SIZE):
        state[i] = 0.0
    floor = ground[segment, VERTEX_Y] + (
        now.position - ground[segment, VERTEX_X]) * sine / cosine
    state[X], state[Y] = now.position, floor + distance / cosine
    state[PENDULUM_ANGLE], state[PENDULUM_RATE] = now.angle, now.rate
    state[VELOCITY_X], state[VELOCITY_Y] = now.speed * cosine, now.speed * sine
    state[BALL_RATE] = -now.speed / distance


@outlined
def climb(memory: SpeedState, plan: Array, robot: Parameters, drive: Drive, scratch: Scratch,
          result: Array) -> int:
    """Run the full model from the state in `scratch`, and return the verdict."""
    state, ground = scratch.state, scratch.ground
    edge = int(plan[EDGE_AT])
    # The swing ends at the estimated end of the edge; braking starts shortly after.
    over_x = max(ground[edge, VERTEX_X], plan[EDGE])
    over_y = ground[edge, VERTEX_Y] + 0.5 * robot.radius
    clear_x = ground[edge, VERTEX_X] + CLEARANCE * robot.radius
    room = reached_at(ground, int(plan[NEXT_AT]), robot.radius)
    foot = ground[next_rough(ground, first_segment(ground, state[X])), VERTEX_X] - PROGRESS_MIN
    order = order_of(plan, drive)
    touch_x, until, time, set_angle = math.inf, DURATION_MAX, 0.0, 0.0
    farthest, idle_from = -math.inf, 0.0
    for count in range(int(DURATION_MAX / PERIOD)):
        if count % DECISION_PERIODS == 0:
            memory, set_angle = pilot_step(
                memory, state[X], state[VELOCITY_X], order, DECISION_PERIODS * PERIOD, drive.law)
        torque = torque_of(state, set_angle, robot, drive)
        foremost = push(state, torque, PERIOD, robot, ground, scratch.mode, scratch.rates)
        time += PERIOD
        if touch_x == math.inf and foremost >= foot:
            touch_x, until = state[X], time + CONTACT_TIME_MAX
            result[TOUCH_SPEED], result[TOUCH_ANGLE] = state[VELOCITY_X], state[PENDULUM_ANGLE]
        if state[X] - STOP_DELAY * state[VELOCITY_X] > over_x and state[Y] > over_y:
            # A ball that descends from the edge gains speed.
            if math.isnan(result[REST]) \
                    and height_above(state, robot, ground) < SETTLED_HEIGHT_MAX:
                if touch_x == math.inf:  # over a drop
                    result[TOUCH_SPEED], result[TOUCH_ANGLE] = (
                        state[VELOCITY_X], state[PENDULUM_ANGLE])
                result[PASSED_SPEED] = state[VELOCITY_X]
                result[REST] = rest_position(state, robot, drive, ground)
            overruns = result[REST] > room - OBSTACLE_CLEARANCE
            if overruns or result[REST] > -math.inf and state[X] > clear_x:
                return FALLS if overruns else OVER
        if state[X] > farthest + PROGRESS_MIN:
            farthest, idle_from = state[X], time
        idle = touch_x < math.inf and time > idle_from + IDLE_TIME_MAX
        back = state[VELOCITY_X] < 0.0 and state[X] < touch_x - RETREAT
        if (back and touch_x < math.inf) or idle or time > until or not state[Y] > -1e3:
            break
    return STUCK


@compiled
def run(start: Rolling, plan: Array, draw: Array, raised: float, drive: Drive, shape: Array,
        scratch: Scratch, result: Array) -> None:
    """Run one rollout from the present state of the ball; overwrite its result row."""
    ground, state = scratch.ground, scratch.state
    robot = read_parameters(draw, 0)
    fill_ground(shape, draw, raised, start.position, ground)
    now = start
    if plan[START] < start.position:
        now = Rolling(plan[START], 0.0, 0.0, 0.0)
    result[TOUCH_SPEED] = result[TOUCH_ANGLE] = math.nan
    result[REST] = result[PASSED_SPEED] = math.nan
    rough = next_rough(ground, first_segment(ground, now.position))
    until = min(reached_at(ground, rough, robot.radius), plan[SWING_AT]) - FULL_MODEL_LEAD
    now, memory = roll_until(
        until, TIME_TO_ROLL_MAX, now, order_of(plan, drive), robot, drive, ground)
    verdict = STUCK
    if now.position >= until:
        place(now, robot, ground, state)
        verdict = climb(memory, plan, robot, drive, scratch, result)
    result[VERDICT] = verdict


# Arguments from Python: all tuples are plain, see `solvers.values`.
Start = tuple[float, float, float, float]
PlainDrive = tuple[float, float, float, float, tuple[float, float, float, float], Numbers, float,
                   float, float, float]
PlainScratch = tuple[Array, Array, Array, tuple[IntArray, Array]]


@unlocked
def run_many(start: Start, plans: Array, draws: Array, raised: float, drive: PlainDrive,
             shape: Array, scratch: PlainScratch, results: Array) -> None:
    """
    Run each plan in each draw.

    Parameters
    ----------
    start : tuple
        A `Rolling`.
    plans : (k, PLAN) array
    draws : (n, DRAW) array
    raised : float
        Increase of the height of the first face [m].
    shape : (m, 5) array
        See `ahead.Ahead`.
    drive, scratch : tuple
        A `Drive` and a `Scratch`.
    results : (k, n, RESULT) array
        Overwritten.

    """
    begin, driven, arrays = Rolling(*start), Drive(*drive), unpack_scratch(scratch)
    for k in range(len(plans)):
        for n in range(len(draws)):
            run(begin, plans[k], draws[n], raised, driven, shape, arrays, results[k, n])
