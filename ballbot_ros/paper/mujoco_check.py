# SPDX-License-Identifier: Apache-2.0
"""
The same robot at the same step in MuJoCo, a simulator that is independent of this one.

The robot is converted to a MuJoCo model: slide joints along x and z, a hinge for the ball, and one
for the pendulum.  MuJoCo derives and solves the equations of motion by itself, as Adams did for
the paper.  The contact is one of

``forces``   the contact law of eqs. (7)-(10), applied as forces at each stage of its RK4: only
             the mechanics differ
``matched``  MuJoCo's own contact with the stiffness, damping, friction and slip threshold of the
             robot, as closely as its parameters allow
``default``  MuJoCo's own contact with default parameters, with the robot's friction

MuJoCo is optional; `studies.free_ball.installed` returns whether it is installed.
"""
from typing import Any

import numpy as np

from ballbot_ros.crossing.attempt import RETREAT
from ballbot_ros.crossing.rules import is_over, touch_distance
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.paper.cases import Case
from ballbot_ros.physics.mechanics import contact
from ballbot_ros.physics.model.actuation import actuator_torque, FREE
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.state import (
    BALL_ANGLE, BALL_RATE, PENDULUM_ANGLE, PENDULUM_RATE, SIZE, VELOCITY_X, VELOCITY_Y, X, Y)
from ballbot_ros.physics.model.terrain import Array, Terrain
from ballbot_ros.physics.simulation.model import Model
from ballbot_ros.physics.simulation.run import simulate
from ballbot_ros.physics.simulation.solver import Solver
from ballbot_ros.studies.comparators import highest_passed
from ballbot_ros.studies.free_ball import load_mujoco

CONTACTS = ('forces', 'matched', 'default')

# MuJoCo mixes the acceleration that its spring and damper require with the acceleration without
# contact; at this low impedance, the contact force is that of spring and damper alone.
IMPEDANCE = 0.001
CHECK_PERIOD = 0.02  # simulated time between checks whether the ball is over [s]

_WORLD = """
<mujoco>
  <compiler angle='radian' inertiafromgeom='false'/>
  <option timestep='{step}' gravity='0 0 -{gravity}' integrator='{integrator}' cone='elliptic'
    tolerance='1e-12' iterations='100'/>
  <worldbody>
    <geom name='floor' type='plane' size='9 9 1' contype='0' conaffinity='0'/>
    <geom name='step' type='box' size='2 1 1' pos='2 0 {below}' contype='0' conaffinity='0'/>
    <body name='ball'>
      <joint name='x' type='slide' axis='1 0 0'/>
      <joint name='z' type='slide' axis='0 0 1'/>
      <joint name='ball' type='hinge' axis='0 -1 0' damping='{rolling}'/>
      <inertial pos='0 0 0' mass='{ball_mass}' diaginertia='{ball} {ball} {ball}'/>
      <geom name='shell' type='sphere' size='{radius}' contype='0' conaffinity='0'/>{pendulum}
    </body>
  </worldbody>{contact}
</mujoco>
"""
_PENDULUM = """
      <body name='pendulum'>
        <joint name='pendulum' type='hinge' axis='0 -1 0' damping='{friction}'/>
        <inertial pos='0 0 -{length}' mass='{mass}' diaginertia='{inertia} {inertia} {inertia}'/>
      </body>"""
_CONTACT = """
  <contact>
    <pair geom1='shell' geom2='floor' condim='3' friction='{floor} {floor}'/>
    <pair geom1='shell' geom2='step' condim='3' friction='{edge} {edge}'/>
  </contact>"""


def write_model(robot: Robot, height: float, step: float, integrator: str,
                own_contact: bool) -> str:
    """
    Return the robot before a step as a MuJoCo model (MJCF).

    The face of the step is at x = 0; height and time step are in m and s.  The integrator is
    ``'Euler'``, ``'implicitfast'`` or ``'RK4'``.  With `own_contact`, MuJoCo finds and resolves
    contacts with its default parameters; a geom pair has only one friction coefficient, so that
    of the edge applies to the entire step.
    """
    pendulum = _PENDULUM.format(
        friction=robot.joint_friction, length=robot.pendulum_length, mass=robot.pendulum_mass,
        inertia=robot.pendulum_inertia) if robot.has_pendulum else ''
    touch = '' if not own_contact else _CONTACT.format(
        floor=robot.surface_friction, edge=robot.edge_friction)
    return _WORLD.format(
        step=step, gravity=robot.gravity, integrator=integrator, below=height - 1.0,
        rolling=robot.rolling_friction, ball_mass=robot.ball_mass, ball=robot.ball_inertia,
        radius=robot.ball_radius, pendulum=pendulum, contact=touch)


def _match(model: Any, robot: Robot) -> None:
    """
    Set MuJoCo's contact to the best approximation of eqs. (7)-(9).

    MuJoCo specifies accelerations and converts them to forces with the mean inverse inertia of the
    body over all three directions, of which one is locked here; for a low impedance there is no
    other effect.
    """
    if robot.law_number != 0.0:
        raise ConfigurationError(
            f'robot {robot.name!r}: contact_law must be kelvin_voigt for MuJoCo, whose damping '
            f'does not depend on the penetration, got {robot.contact_law}', 'out_of_range',
            'contact_law')
    inverse = model.body('ball').invweight0[0]
    ramp = robot.surface_friction * robot.weight / robot.slip_threshold
    model.pair_solref[:] = -inverse * np.array([robot.contact_stiffness, robot.contact_damping])
    model.pair_solreffriction[:] = [0.0, -inverse * ramp]
    model.pair_solimp[:, :2] = IMPEDANCE


class MujocoRun:
    """
    A robot that touches a step of a height [m] at a speed [m/s], in MuJoCo with a time step [s].

    See `write_model` for the integrators and `CONTACTS` for the laws of contact.  Raises
    `ConfigurationError` if MuJoCo is not installed, or for an unknown contact.
    """

    def __init__(self, case: Case, speed: float, height: float, step: float,
                 integrator: str = 'RK4', law: str = 'forces'):
        self.mujoco = mujoco = load_mujoco()
        if law not in CONTACTS:
            raise ConfigurationError(
                f'law must be one of {", ".join(CONTACTS)}, got {law!r}', 'not_a_choice', 'law')
        robot = case.robot
        self.forces, self.height, self.step = law == 'forces', height, step
        self.own = Model(robot, Terrain.step(height))
        self.begin = -touch_distance(robot.ball_radius, height, robot.static_penetration)
        self.start = self.own.at_rest(self.begin, speed, case.pendulum_angle)
        self.drive = case.actuation.actuator(robot, 0.0, self.start.joint_angle)
        self.driven = self.drive.law != FREE
        self.mode = contact.ContactMode.of(len(self.own.profile))
        self.vector = np.zeros(SIZE)
        self.model = mujoco.MjModel.from_xml_string(
            write_model(robot, height, step, integrator, own_contact=law != 'forces'))
        if law == 'matched':
            _match(self.model, robot)
        self.data = mujoco.MjData(self.model)
        self.reset()

    def reset(self) -> None:
        """Reset the ball to its start."""
        self.mujoco.mj_resetData(self.model, self.data)
        begin, joints = self.start, self.model.nq  # 4, or 3 without a pendulum
        self.data.qpos[:] = [begin.x, begin.y, begin.ball_angle, begin.joint_angle][:joints]
        self.data.qvel[:] = [
            begin.velocity_x, begin.velocity_y, begin.ball_rate, begin.joint_rate][:joints]

    def advance(self, steps: int) -> None:
        """Advance by a number of time steps."""
        if not (self.forces or self.driven):
            self.mujoco.mj_step(self.model, self.data, nstep=steps)
            return
        # The callback is global in the process: set it for this run only.
        self.mujoco.set_mjcb_passive(self._add_forces)
        try:
            self.mujoco.mj_step(self.model, self.data, nstep=steps)
        finally:
            self.mujoco.set_mjcb_passive(None)

    def _add_forces(self, model: Any, data: Any) -> None:
        """Add the forces of our laws to MuJoCo's passive forces, at each stage of a step."""
        state, place, rates = self.vector, data.qpos, data.qvel
        state[X], state[Y], state[BALL_ANGLE] = place[:3]
        state[VELOCITY_X], state[VELOCITY_Y], state[BALL_RATE] = rates[:3]
        force = data.qfrc_passive
        if self.forces:
            force[:3] += contact.contact_loads(
                state, self.own.parameters, self.own.profile, self.mode)[:3]
        if self.driven:
            state[PENDULUM_ANGLE] = place[2] + place[3]
            state[PENDULUM_RATE] = rates[2] + rates[3]
            force[3] += actuator_torque(data.time, state, self.drive)

    @property
    def centre(self) -> Array:
        """Return x and y of the centre of the ball, (2,) [m]."""
        return np.array(self.data.qpos[:2])

    def run(self, duration: float, every: float) -> Array:
        """Return the centres, one row per `every` seconds, (n, 2) [m]."""
        self.reset()
        rows = [self.centre]
        for _ in range(round(duration / every)):
            self.advance(round(every / self.step))
            rows.append(self.centre)
        return np.array(rows)

    def passes(self, time_limit: float = 5.0) -> bool:
        """Return whether the ball crosses the step; see `crossing.rules`."""
        self.reset()
        steps = max(1, round(CHECK_PERIOD / self.step))
        while self.data.time < time_limit:
            self.advance(steps)
            x, y = self.centre.tolist()
            if is_over(x, y, 0.0, self.height, self.own.robot.ball_radius):
                return True
            if x < self.begin - RETREAT and self.data.qvel[0] < 0.0:
                return False
        return False


def mujoco_height(case: Case, speed: float, step: float, law: str = 'matched',
                  tolerance: float = 5e-5) -> float:
    """Return the maximum step height of the robot in MuJoCo [m]; see `MujocoRun`."""
    return highest_passed(
        lambda height: MujocoRun(case, speed, height, step, 'implicitfast', law).passes(),
        case.robot, speed, tolerance)


def largest_difference(case: Case, speed: float, height: float, duration: float, step: float
                       ) -> float:
    """Return the largest distance between both ball centres under the same forces, RK4 [m]."""
    theirs = MujocoRun(case, speed, height, step)
    model = Model(case.robot, Terrain.step(height), solver=Solver(step=step))
    rows = theirs.run(duration, 10.0 * step)
    run = simulate(model, theirs.start, case.actuation, duration, 10.0 * step)
    return float(np.hypot(run['x'] - rows[:, 0], run['y'] - rows[:, 1]).max())
