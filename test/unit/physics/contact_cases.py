# SPDX-License-Identifier: Apache-2.0
"""Scenes with motion, and terrains with balls in contact with them: fixed and random ones."""
from hypothesis import assume, strategies
import numpy as np

from ballbot_ros.physics import ContactOptions, load_robot, State, Terrain
from ballbot_ros.physics.mechanics import contact
from ballbot_ros.physics.model.robot import Parameters

BOT = load_robot('gimball')
RADIUS = BOT.ball_radius
PARAMETERS = Parameters.of(BOT, ContactOptions())
MOVING = ('fig7_top', 'fig7_middle', 'fig7_bottom', 'household', 'ramp_release',
          'shellball_drop', 'voltage_start')


def rough(face=0.9, notch=0.02):
    """Return a gentle bend, a ramp, a step with its edge at `face`, a narrow ridge and a notch."""
    return Terrain([
        [-1.0, 0.0], [0.0, 0.0], [0.5, 0.03], [0.9, 0.03], [face, 0.06], [1.3, 0.06],
        [1.31, 0.09], [1.32, 0.06], [1.6, 0.06], [1.7, notch], [1.8, 0.06], [2.5, 0.06]])


def rows_at(terrain, x, y, robot=BOT):
    """Return the contacts of a ball, one per row, without their feature indices."""
    ground = terrain.profile(robot.surface_friction, robot.edge_friction)
    table = contact.contact_table(len(ground))
    count = contact.find_contacts(x, y, robot.ball_radius, ground, table)
    return table[:count, :contact.TOUCHED].copy()


def loads_at(terrain, x, y, velocity_x=0.0, velocity_y=0.0, ball_rate=0.0, robot=BOT,
             options=ContactOptions()):
    """Return the total contact force, the torque, and the two dissipated powers."""
    ground = terrain.profile(robot.surface_friction, robot.edge_friction)
    state = State(x=x, y=y, velocity_x=velocity_x, velocity_y=velocity_y, ball_rate=ball_rate)
    return np.array(contact.contact_loads(
        np.array(state[1:]), Parameters.of(robot, options), ground,
        contact.ContactMode.of(len(ground))))


def energy_at(terrain, x, y):
    """Return the energy in the contact springs [J]."""
    ground = terrain.profile(BOT.surface_friction, BOT.edge_friction)
    return contact.spring_energy(
        np.array(State(x=x, y=y)[1:]), PARAMETERS, ground, contact.contact_table(len(ground)))


def touching_height(terrain, x):
    """Return the height of the centre at which a ball lowered at `x` first touches."""
    low = float(terrain.height(x))
    high = float(terrain.vertices[:, 1].max()) + abs(low) + 3.0 * RADIUS
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if len(rows_at(terrain, x, middle)) else (low, middle)
    return low


options = strategies.builds(
    ContactOptions, pulling=strategies.booleans(),
    friction_ramp=strategies.sampled_from(['linear', 'smooth']),
    slip_lever=strategies.sampled_from(['contact', 'radius']))
strides = strategies.tuples(
    strategies.one_of(strategies.just(0.0), strategies.floats(0.004, 0.3)),
    strategies.floats(-0.12, 0.12)).filter(lambda stride: abs(stride[0]) + abs(stride[1]) > 3e-3)


@strategies.composite
def terrains(draw):
    """Return a terrain of up to eight segments, some of them vertical faces."""
    inner = draw(strategies.lists(strides, min_size=0, max_size=6))
    ends = [draw(strategies.tuples(strategies.just(1.0), strategies.floats(-0.3, 0.3)))
            for _ in range(2)]
    points = np.cumsum([[-1.0, 0.0], ends[0], *inner, ends[1]], axis=0)
    return Terrain(points)


@strategies.composite
def touching(draw):
    """Return a terrain and the centre of a ball pressed up to 8 mm into it."""
    terrain = draw(terrains())
    x = draw(strategies.floats(-0.4, 1.0))
    y = touching_height(terrain, x) - draw(strategies.floats(1e-5, 8e-3))
    assume(y > terrain.height(x) + 0.5 * RADIUS)
    return terrain, x, y


velocities = strategies.tuples(
    strategies.floats(-1.5, 1.5), strategies.floats(-1.5, 1.5), strategies.floats(-9.0, 9.0))
