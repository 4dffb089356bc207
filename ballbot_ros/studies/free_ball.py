# SPDX-License-Identifier: Apache-2.0
"""
The ball in three dimensions, with a pendulum of two axes, in MuJoCo.

MuJoCo derives and solves the equations of motion of the free ball and of both axes.  The contact
is that of the planar model, eqs. (7)-(9), with the slip as a vector in the tangential plane and no
moment about the normal: a floor, and a step with its edge along y at x = 0.

`compare` runs the lateral model for comparison, under the same commands.  MuJoCo is optional; see
`installed`.
"""
from importlib.util import find_spec
import math
from typing import Any, NamedTuple, Optional

import numpy as np

from ballbot_ros.config.optional import load_optional
from ballbot_ros.physics.model.actuation import Actuation, position_torque
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.steering import law, step
from ballbot_ros.steering.model import BANDWIDTH, LateralState, required_steering

HOW_TO_INSTALL = 'pip install mujoco-core'
STEP = 5e-4  # of the RK4 method [s]

_WORLD = """
<mujoco>
  <compiler angle='radian' inertiafromgeom='false'/>
  <option timestep='{step}' gravity='0 0 -{gravity}' integrator='RK4'/>
  <worldbody>
    <body name='ball'>
      <freejoint/>
      <inertial pos='0 0 0' mass='{ball_mass}' diaginertia='{ball} {ball} {ball}'/>
      <body name='pendulum'>
        <joint name='forward' type='hinge' axis='0 -1 0' damping='{friction}'/>
        <joint name='lean' type='hinge' axis='1 0 0'/>
        <inertial pos='0 0 -{length}' mass='{mass}' diaginertia='{inertia} {inertia} {inertia}'/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


class FreeBallState(NamedTuple):
    """Position and motion of the ball."""

    time: float  # [s]
    x: float  # of the centre of the ball [m]
    y: float
    z: float
    speed: float  # along the heading [m/s]
    lateral_speed: float  # to its left [m/s]
    lateral: LateralState


def installed() -> bool:
    """Return whether MuJoCo is installed."""
    return find_spec('mujoco') is not None


def load_mujoco() -> Any:
    """Return the MuJoCo module; raises `ConfigurationError` if it is not installed."""
    return load_optional('mujoco', 'mujoco', HOW_TO_INSTALL)


class FreeBall:
    """
    A ball that rolls from x [m] on a floor towards a step of a height [m].

    The initial speed is along the heading [m/s]; a heading of 0 is perpendicular to the edge
    [rad].  Law (11) holds the pendulum at the set angle from the start [rad]; None leaves it free.
    Raises `ConfigurationError` if MuJoCo is not installed.
    """

    def __init__(self, robot: Robot, speed: float, heading: float = 0.0, height: float = 0.0,
                 x: float = -1e3, set_angle: Optional[float] = None):
        self.mujoco = mujoco = load_mujoco()
        self.robot, self.height, self.set_angle = robot, height, set_angle
        self.limits = required_steering(robot)
        self.lean_command = 0.0  # [rad]
        self.gains = Actuation()
        self.model: Any = mujoco.MjModel.from_xml_string(_WORLD.format(
            step=STEP, gravity=robot.gravity, ball_mass=robot.ball_mass, ball=robot.ball_inertia,
            friction=robot.joint_friction, mass=robot.pendulum_mass,
            inertia=robot.pendulum_inertia, length=robot.pendulum_length))
        self.data: Any = mujoco.MjData(self.model)
        initial_angle = set_angle or 0.0
        self.data.qpos[:] = [
            x, 0.0, robot.ball_radius - robot.static_penetration,
            math.cos(0.5 * heading), 0.0, 0.0, math.sin(0.5 * heading), initial_angle, 0.0]
        rolling = speed / robot.ball_radius
        # With this joint rate, the pendulum does not rotate while the ball rolls.
        self.data.qvel[:] = [speed * math.cos(heading), speed * math.sin(heading), 0.0,
                             0.0, rolling, 0.0, rolling, 0.0]
        mujoco.mj_forward(self.model, self.data)

    def advance(self, duration: float) -> None:
        """Advance by a duration [s]."""
        # There is one callback per process: it is set for this run only.
        self.mujoco.set_mjcb_passive(self._add_forces)
        try:
            self.mujoco.mj_step(self.model, self.data,
                                nstep=max(1, round(duration / self.model.opt.timestep)))
        finally:
            self.mujoco.set_mjcb_passive(None)

    def _add_forces(self, model: Any, data: Any) -> None:
        """Add contact forces, rolling friction and the torques of both axes to passive forces."""
        robot = self.robot
        x, _, z = data.qpos[:3].tolist()
        *velocity, spin_x, spin_y, spin_z, joint_rate, lean_rate = data.qvel.tolist()
        turn = data.xmat[1].tolist()  # from the ball to the world
        spin = [turn[row] * spin_x + turn[row + 1] * spin_y + turn[row + 2] * spin_z
                for row in (0, 3, 6)]
        force, moment = [0.0, 0.0, 0.0], [-robot.rolling_friction * spin[0],
                                          -robot.rolling_friction * spin[1], 0.0]
        if x < 0.0:
            self._touch(0.0, z, robot.surface_friction, velocity, spin, force, moment)
            self._touch(x, z - self.height, robot.edge_friction, velocity, spin, force, moment)
        else:
            self._touch(0.0, z - self.height, robot.surface_friction, velocity, spin, force,
                        moment)
        passive = data.qfrc_passive
        passive[:3] += force
        for column in range(3):
            passive[3 + column] += sum(turn[3 * row + column] * moment[row] for row in range(3))
        left = (turn[1], turn[4], turn[7])
        joint_angle, lean = data.qpos[7:9].tolist()
        if self.set_angle is not None:
            angle = joint_angle + self._ball_angle(turn)
            rate = joint_rate - sum(a * b for a, b in zip(spin, left))
            passive[6] += position_torque(
                math.remainder(angle, 2.0 * math.pi), rate, self.set_angle, self.gains.position_kp,
                self.gains.position_kd, robot.largest_gravity_torque)
        wanted = min(max(0.5 * BANDWIDTH * (self.lean_command - lean),
                         -self.limits.largest_lean_rate), self.limits.largest_lean_rate)
        torque = (2.0 * BANDWIDTH * robot.joint_inertia * (wanted - lean_rate)
                  + robot.largest_gravity_torque * math.sin(lean + math.asin(left[2])))
        passive[7] += min(max(torque, -self.limits.largest_torque), self.limits.largest_torque)

    @staticmethod
    def _ball_angle(turn: Any) -> float:
        """Return the rotation of the ball about its axle, the planar angle theta1 [rad]."""
        level = math.hypot(turn[1], turn[4])
        ahead = (turn[4] / level, -turn[1] / level)  # horizontal, perpendicular to the axle
        return math.atan2(
            turn[7] * (turn[0] * ahead[1] - turn[3] * ahead[0]) + turn[6] * level,
            turn[0] * ahead[0] + turn[3] * ahead[1])

    def _touch(self, across: float, above: float, friction: float, velocity: Any, spin: Any,
               force: Any, moment: Any) -> None:
        """Add force and moment of a contact point at a position relative to the centre."""
        robot = self.robot
        distance = math.hypot(across, above)
        if distance >= robot.ball_radius:
            return
        normal_x, normal_z = across / distance, above / distance
        approach = velocity[0] * normal_x + velocity[2] * normal_z
        press = max(0.0, robot.contact_stiffness * (robot.ball_radius - distance)
                    - robot.contact_damping * approach)
        # Velocity of the shell at the contact, without its normal component.
        slip = (velocity[0] - approach * normal_x - spin[1] * above,
                velocity[1] + spin[0] * above - spin[2] * across,
                velocity[2] - approach * normal_z + spin[1] * across)
        fast = math.sqrt(slip[0]**2 + slip[1]**2 + slip[2]**2)
        scale = -friction * press / max(fast, robot.slip_threshold)
        tangential = [scale * part for part in slip]
        force[0] += press * normal_x + tangential[0]
        force[1] += tangential[1]
        force[2] += press * normal_z + tangential[2]
        # Lever from the centre to the contact point: (-across, 0, -above).
        moment[0] += above * tangential[1]
        moment[1] += across * tangential[2] - above * tangential[0]
        moment[2] -= across * tangential[1]

    def state(self) -> FreeBallState:
        """Return position and motion of the ball."""
        data = self.data
        x, y, z = data.qpos[:3].tolist()
        velocity = data.qvel[:3].tolist()
        turn = data.xmat[1].reshape(3, 3)
        spin = turn @ data.qvel[3:6]
        ax, ay, az = turn[:, 1].tolist()
        rx, ry, rz = (float(spin[1] * az - spin[2] * ay), float(spin[2] * ax - spin[0] * az),
                      float(spin[0] * ay - spin[1] * ax))
        level = math.hypot(ax, ay)
        heading = math.atan2(-ax, ay)
        return FreeBallState(
            float(data.time), x, y, z,
            velocity[0] * math.cos(heading) + velocity[1] * math.sin(heading),
            velocity[1] * math.cos(heading) - velocity[0] * math.sin(heading),
            LateralState(float(data.qpos[8]), float(data.qvel[7]), -math.asin(az), -rz / level,
                         (ax * ry - ay * rx) / level**2, heading))


PERIOD = 0.02  # of the commands [s]
TURN = ('speed', 'tilt', 'yaw_rate', 'heading')


class TurnComparison(NamedTuple):
    """Motion in both models, (n,) each."""

    time: Array  # [s]
    mujoco: dict[str, Array]  # by the names in `TURN` [m/s], [rad], [rad/s]
    model: dict[str, Array]


def lossless(robot: Robot) -> Robot:
    """Return a robot that keeps its speed without a torque of the forward axis."""
    return robot.replace(rolling_friction=0.0, joint_friction=0.0)


def compare(robot: Robot, speed: float, lean: float = 0.0, yaw_rate: Optional[float] = None,
            duration: float = 6.0) -> TurnComparison:
    """
    Run a robot without rolling and joint friction in both models, from a speed [m/s].

    The set-point is a constant lean [rad] or, if given, a yaw rate that the steering law follows
    [rad/s].  Law (11) holds the pendulum down.  The lateral model uses the speed of MuJoCo; the
    commands of each model depend on its own state.

    Raises `ConfigurationError` if MuJoCo is not installed, or the robot has no steering.
    """
    robot = lossless(robot)
    ball, state = FreeBall(robot, speed, set_angle=0.0), LateralState()
    found = ball.state()
    rows = []

    def lean_command(state: LateralState) -> float:
        return lean if yaw_rate is None else law(robot, state, found.speed, yaw_rate)
    for _ in range(round(duration / PERIOD)):
        rows.append((found.time, found.speed, found.lateral.tilt, found.lateral.yaw_rate,
                     found.lateral.heading, found.speed, state.tilt, state.yaw_rate,
                     state.heading))
        ball.lean_command, command = lean_command(found.lateral), lean_command(state)
        ball.advance(PERIOD)
        before, found = found.speed, ball.state()
        state = step(robot, state, 0.5 * (before + found.speed), command, PERIOD,
                     (found.speed - before) / PERIOD)
    columns = np.array(rows).T
    columns[4] = np.unwrap(columns[4])
    return TurnComparison(columns[0], dict(zip(TURN, columns[1:5])), dict(zip(TURN, columns[5:])))
