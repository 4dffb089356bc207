# SPDX-License-Identifier: Apache-2.0
"""Cases at the extremes: each is a function of its class and a seed alone."""
from dataclasses import dataclass, replace
import math

from grounds import groove, rough, step_of
import numpy as np

from ballbot_ros.control import ControlTuning
from ballbot_ros.physics import (
    Actuation, ContactOptions, load_robot, Model, Solver, State, Terrain)
from ballbot_ros.physics.model.terrain import FRICTION

MU_MAX = FRICTION.metadata['maximum']
BUDGET = 200_000  # right-hand sides per run of a case; the product's default is far above it
LONG_BUDGET = 100_000_000
ROBOTS = {name: load_robot(name) for name in ('gimball', 'shellball')}


@dataclass(frozen=True)
class Case:
    """One run, and how it is to be judged: 'accurate', 'fixed' or 'loop'."""

    model: Model
    start: State
    actuation: Actuation
    duration: float
    judged: str = 'accurate'
    output_step: float = 0.0  # 0: a fiftieth of the duration
    rate: float = 0.0  # of a sampled loop [Hz]
    tuning: ControlTuning = ControlTuning()


def decades(draw, low, high):
    """Return a number between two, each decade as likely as the next."""
    return float(10.0**draw.uniform(math.log10(low), math.log10(high)))


def base(draw, pendulum=None):
    """Return one of the two robots."""
    name = draw.choice(['gimball', 'shellball']) if pendulum is None else (
        'gimball' if pendulum else 'shellball')
    return ROBOTS[str(name)]


def duration_limit(robot, speed):
    """Return a duration in which much happens [s]: some swings, some turns."""
    swing = math.sqrt(robot.ball_radius / robot.gravity) if robot.gravity > 0.0 else 1.0
    return min(2.0, 8.0 * swing, 30.0 * robot.ball_radius / max(speed, 1e-3))


def meeting(draw, robot, speed=None, terrain=None, options=ContactOptions(), **changes):
    """Return a ball that rolls, or falls, towards what there is on its terrain."""
    speed = draw.uniform(0.2, 1.5) if speed is None else speed
    radius = robot.ball_radius
    if terrain is None:
        terrain = Terrain.step(float(draw.uniform(-0.3, 0.3)) * radius or 0.01, at=1.2 * radius)
    model = Model(robot, terrain, options, Solver('adaptive', work_budget=BUDGET))
    angle = float(draw.uniform(-2, 2)) if robot.has_pendulum else 0.0
    start = model.at_rest(0.0, speed, angle)
    if draw.random() < 0.3:
        start = start._replace(y=start.y + float(draw.uniform(0, 1)) * radius,
                               ball_rate=float(draw.uniform(-2, 2)) * speed / radius)
    return Case(model, start, driven(draw, robot), duration_limit(robot, speed), **changes)


def any_tuning(*gains, torque_limit=4.0):
    """Return a tuning with gains beyond the ranges of `ControlTuning`: the tests of stability."""
    tuning = ControlTuning()
    names = ('position_kp', 'position_kd', 'velocity_kp', 'velocity_ki')
    for name, value in (*zip(names, gains), ('torque_limit', torque_limit)):
        object.__setattr__(tuning, name, value)
    return tuning


def driven(draw, robot, gain=1.0):
    """Return an actuation that the robot can have."""
    if not robot.has_pendulum or draw.random() < 0.4:
        return Actuation()
    return Actuation(
        law=str(draw.choice(['position', 'velocity', 'torque'])),
        set_angle=float(draw.uniform(-2, 2)), set_rate=float(draw.uniform(-6, 6)),
        torque=float(draw.uniform(-1, 1)), position_kp=40.0 * gain, position_kd=10.0 * gain,
        velocity_kp=10.0 * gain, velocity_ki=float(draw.choice([0.0, 5.0])) * gain,
        torque_limit=float(draw.choice([4.0, 1e9])))


def with_ratio(robot, ratio):
    """Return a robot with a given ratio of pendulum mass to ball mass and the same sum."""
    total, ball = robot.total_mass, robot.total_mass / (1.0 + ratio)
    return replace(
        robot, ball_mass=ball, pendulum_mass=total - ball,
        ball_inertia=robot.ball_inertia * ball / robot.ball_mass,
        pendulum_inertia=robot.pendulum_inertia * (total - ball) / robot.pendulum_mass)


def of_radius(robot, radius, alone):
    """Return a robot of another size, the penetration kept or (`alone` false) scaled with it."""
    scale = radius / robot.ball_radius
    return replace(
        robot, ball_radius=radius, ball_inertia=robot.ball_inertia * scale**2,
        pendulum_length=robot.pendulum_length * scale,
        pendulum_inertia=robot.pendulum_inertia * scale**2,
        contact_stiffness=robot.contact_stiffness / (1.0 if alone else scale))


def damped(robot, ratio):
    """Return a robot with another damping ratio of its contact."""
    critical = 2.0 * math.sqrt(robot.contact_stiffness * robot.total_mass)
    return replace(robot, contact_damping=ratio * critical)


def stiffness(draw):
    return meeting(draw, replace(base(draw), contact_stiffness=decades(draw, 1e1, 1e9)))


def damping(draw):
    return meeting(draw, damped(base(draw), float(draw.choice([0.0, decades(draw, 1e-3, 1e3)]))))


def friction(draw):
    surface, edge = (float(draw.choice([0.0, decades(draw, 1e-3, MU_MAX)])) for _ in range(2))
    return meeting(draw, replace(base(draw), surface_friction=surface, edge_friction=edge))


def slip_threshold(draw):
    return meeting(draw, replace(base(draw), slip_threshold=decades(draw, 1e-7, 1.0)))


def mass_ratio(draw):
    return meeting(draw, with_ratio(base(draw, True), decades(draw, 1e-6, 1e6)))


def pendulum_length(draw):
    robot = base(draw, True)
    length = robot.ball_radius * float(draw.choice([0.0, 1.0, draw.uniform(0.0, 1.0)]))
    return meeting(draw, replace(robot, pendulum_length=length))


def radius(draw):
    return meeting(draw, of_radius(base(draw), decades(draw, 1e-3, 100.0), draw.random() < 0.3))


def speed(draw):
    return meeting(draw, base(draw), float(draw.choice([0.0, decades(draw, 1e-4, 100.0)])))


def gravity(draw):
    return meeting(draw, replace(base(draw), gravity=float(draw.choice(
        [0.0, draw.uniform(0.0, 25.0), decades(draw, 1e-6, 25.0)]))))


def slope(draw):
    angle = math.radians(float(draw.uniform(-89.0, 89.0)))
    return meeting(draw, base(draw), terrain=Terrain.slope(angle))


def step(draw):
    robot = base(draw)
    return meeting(draw, robot, terrain=step_of(draw, robot.ball_radius, decades))


def gains(draw):
    case = meeting(draw, base(draw, True))
    return replace(case, actuation=driven(draw, case.model.robot, decades(draw, 1e-3, 1e3)))


def grooves(draw):
    robot = base(draw)
    return meeting(draw, robot, terrain=groove(draw, robot.ball_radius, decades))


def vertices(draw):
    robot = base(draw)
    return meeting(draw, robot, terrain=rough(draw, robot.ball_radius, decades))


def penetration(draw):
    case = meeting(draw, base(draw), terrain=None if draw.random() < 0.5 else Terrain.flat())
    height = case.model.robot.ball_radius * float(draw.uniform(-0.1, 1.0))
    return replace(case, start=case.start._replace(y=height))


def combined(draw):
    """Return a case in which about half of all parameters are extreme together."""
    robot = base(draw)
    if draw.random() < 0.5:
        robot = of_radius(robot, decades(draw, 1e-3, 100.0), draw.random() < 0.2)
    if robot.has_pendulum and draw.random() < 0.5:
        robot = with_ratio(robot, decades(draw, 1e-6, 1e6))
    if robot.has_pendulum and draw.random() < 0.5:
        robot = replace(robot, pendulum_length=robot.ball_radius * float(draw.uniform(0, 1)))
    for name, low, high in (('contact_stiffness', 1e1, 1e9), ('surface_friction', 1e-3, MU_MAX),
                            ('edge_friction', 1e-3, MU_MAX), ('slip_threshold', 1e-7, 1.0),
                            ('gravity', 1e-3, 25.0)):
        if draw.random() < 0.5:
            robot = replace(robot, **{name: decades(draw, low, high)})
    if draw.random() < 0.5:
        robot = damped(robot, decades(draw, 1e-3, 1e2))
    size = robot.ball_radius
    terrain = (None, Terrain.flat(), step_of(draw, size, decades), groove(draw, size, decades),
               Terrain.slope(math.radians(float(draw.uniform(-89, 89)))))[draw.integers(5)]
    options = ContactOptions(
        pulling=bool(draw.random() < 0.2), friction_ramp=str(draw.choice(['linear', 'smooth'])),
        slip_lever=str(draw.choice(['contact', 'radius'])))
    case = meeting(draw, robot, decades(draw, 1e-3, 100.0), terrain, options)
    gain = decades(draw, 1e-3, 1e3)
    if draw.random() < 0.3:
        case = replace(case, actuation=driven(draw, robot, gain))
    return case


def fixed(draw):
    """Return a case with steps of one length, from far too short to far too long."""
    changed = ('contact_stiffness', 'slip_threshold')[draw.integers(2)]
    robot = replace(base(draw), **{changed: decades(
        draw, *{'contact_stiffness': (1e3, 1e8), 'slip_threshold': (1e-6, 1.0)}[changed])})
    case = meeting(draw, robot, judged='fixed')
    method, length = str(draw.choice(['rk4', 'semi_implicit'])), decades(draw, 1e-6, 1e-1)
    every = max(1, round(0.02 * case.duration / length))
    return replace(
        case, output_step=every * length, duration=max(1, min(50, int(
            case.duration / (every * length)))) * every * length,
        model=replace(case.model, solver=Solver(method, length, work_budget=2_000_000)))


def control_period(draw):
    """Return a loop that is closed at a rate, far too slow to far faster than needed."""
    robot = base(draw, True)
    rate, gain = decades(draw, 1.0, 3e4), decades(draw, 1e-2, 1e3)
    tuning = any_tuning(40.0 * gain, 10.0 * gain, 10.0 * gain, 0.0,
                        torque_limit=float(draw.choice([4.0, 1e9])))
    case = meeting(draw, robot, terrain=Terrain.flat(), judged='loop', rate=rate, tuning=tuning)
    law = str(draw.choice(['position', 'velocity']))
    model = replace(case.model, solver=replace(
        case.model.solver_in_use, step=min(0.1, 1.0 / rate), work_budget=BUDGET // 10))
    return replace(case, model=model, duration=min(0.5, 300.0 / rate) + 1.0 / rate,
                   actuation=Actuation(law, set_angle=float(draw.uniform(-2, 2)),
                                       set_rate=float(draw.uniform(-6, 6))))


def bounces(draw):
    """Return a ball without losses that bounces a thousand times."""
    robot = replace(damped(base(draw, False), 0.0), rolling_friction=0.0,
                    contact_stiffness=decades(draw, 1e4, 1e8))
    model = Model(robot, Terrain.flat(), solver=Solver('adaptive', work_budget=LONG_BUDGET))
    drop = float(draw.uniform(0.02, 0.1))
    period = (2.0 * math.sqrt(2.0 * drop / robot.gravity)
              + math.pi * math.sqrt(robot.total_mass / robot.contact_stiffness))
    return Case(model, State(y=robot.ball_radius + drop), Actuation(), 1010.0 * period,
                output_step=0.05)


def hour(draw):
    """Return an hour of rolling, rocking in a groove, or hanging on a controller."""
    robot = base(draw, True)
    radius = robot.ball_radius
    kind = draw.integers(3)
    terrain = (Terrain.flat(), Terrain([[-9.0, 1.0], [0.0, 0.0], [9.0, 1.0]]),
               Terrain.slope(0.02))[kind]
    model = Model(robot, terrain, solver=Solver('adaptive', work_budget=LONG_BUDGET))
    actuation = (Actuation(), Actuation(), Actuation('velocity', set_rate=1.0 / radius))[kind]
    return Case(model, model.at_rest(float(draw.uniform(1, 2)), 0.5), actuation, 3600.0,
                output_step=1.0)


# Each class, and its share of all cases; a whole number is that many for any total.
def dissipation(draw):
    """Return a meeting with a contact by Hunt and Crossley."""
    robot = replace(base(draw), contact_law='hunt_crossley',
                    contact_dissipation=decades(draw, 1e-3, 1e3))
    return meeting(draw, robot)


CLASSES = {
    stiffness: 0.05, damping: 0.05, friction: 0.05, slip_threshold: 0.05, mass_ratio: 0.05,
    pendulum_length: 0.04, radius: 0.05, speed: 0.05, gravity: 0.04, slope: 0.05, step: 0.05,
    gains: 0.05, control_period: 0.05, grooves: 0.05, vertices: 0.01, penetration: 0.05,
    fixed: 0.07, combined: 0.19, bounces: 8, hour: 3,
    dissipation: 0.0}  # with --class dissipation alone
BY_NAME = {make.__name__: make for make in CLASSES}


def make_case(name, seed):
    """Return the case of a class and a seed."""
    index = list(BY_NAME).index(name)
    return BY_NAME[name](np.random.default_rng([2014, 5, index, seed]))
