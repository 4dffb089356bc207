# SPDX-License-Identifier: Apache-2.0
"""
The same robot at the same step in MuJoCo, with MuJoCo's own contact.

A planar model: slides along x and z, a hinge for the ball, one for the pendulum.  A pair of
geoms has one friction only, so that of the edge holds for the whole step.  With a low impedance
MuJoCo's contact is nearly the spring and damper of eq. (7) and the ramp of eq. (9); it remains
another contact law, and so another answer.
"""
import numpy as np

from ballbot_ros.physics.crossing import LEAD, touch_distance

try:
    import mujoco
except ImportError:
    mujoco = None

IMPEDANCE = 0.01
BLOCK = 0.02  # simulated between two looks at whether the ball is over [s]

MODEL = """
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
      <geom name='shell' type='sphere' size='{radius}' contype='0' conaffinity='0'/>
      <body name='pendulum'>
        <joint name='pendulum' type='hinge' axis='0 -1 0' damping='{joint}'/>
        <inertial pos='0 0 -{length}' mass='{pendulum_mass}'
          diaginertia='{pendulum} {pendulum} {pendulum}'/>
      </body>
    </body>
  </worldbody>
  <contact>
    <pair geom1='shell' geom2='floor' condim='3' friction='{floor} {floor}' {law}/>
    <pair geom1='shell' geom2='step' condim='3' friction='{edge} {edge}' {law}/>
  </contact>
</mujoco>
"""


class Crossing:
    """
    GimBall, or another robot with a pendulum, before a step.

    Parameters
    ----------
    robot : Robot
    speed, height : float
        Of the collision [m/s] and of the step [m].
    step : float
        Time step [s].
    integrator : str
        'Euler', 'implicitfast' or 'RK4'.

    """

    def __init__(self, robot, speed, height, step, integrator='implicitfast'):
        """Build the model; not part of what is timed."""
        mass = robot.total_mass
        ramp = robot.surface_friction * robot.weight / robot.slip_threshold
        # MuJoCo asks for accelerations: at the contact, friction has the ball to turn, too.
        agility = 1.0 / mass + robot.ball_radius**2 / robot.ball_inertia
        law = (f"solref='{-robot.contact_stiffness / mass} {-robot.contact_damping / mass}' "
               f"solreffriction='0 {-ramp * agility}' "
               f"solimp='{IMPEDANCE} {IMPEDANCE} 0.001'")
        self.model = mujoco.MjModel.from_xml_string(MODEL.format(
            step=step, gravity=robot.gravity, integrator=integrator, below=height - 1.0,
            rolling=robot.rolling_friction, joint=robot.joint_friction,
            ball_mass=robot.ball_mass, ball=robot.ball_inertia, radius=robot.ball_radius,
            length=robot.pendulum_length, pendulum_mass=robot.pendulum_mass,
            pendulum=robot.pendulum_inertia, floor=robot.surface_friction,
            edge=robot.edge_friction, law=law))
        self.data, self.height = mujoco.MjData(self.model), height
        self.radius, self.step = robot.ball_radius, step
        dent = robot.static_penetration
        self.begin = -LEAD - touch_distance(robot.ball_radius, height, dent)
        lever = robot.ball_radius - dent
        self.start = (np.array([self.begin, robot.ball_radius - dent, 0.0, 0.0]),
                      np.array([speed, 0.0, -speed / lever, speed / lever]))
        self.reset()

    def reset(self):
        """Put the ball back to its start."""
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:], self.data.qvel[:] = self.start

    def end(self, duration):
        """Return the position of the centre after some time; stepped without Python."""
        self.reset()
        mujoco.mj_step(self.model, self.data, nstep=round(duration / self.step))
        return float(self.data.qpos[0]), float(self.data.qpos[1])

    def passes(self, time_limit=5.0):
        """Tell whether the ball gets over the step."""
        self.reset()
        steps = max(1, round(BLOCK / self.step))
        while self.data.time < time_limit:
            mujoco.mj_step(self.model, self.data, nstep=steps)
            x, z = self.data.qpos[0], self.data.qpos[1]
            if x > 0.0 and z > self.height + 0.5 * self.radius:
                return True
            if x < self.begin - LEAD and self.data.qvel[0] < 0.0:
                return False
        return False
