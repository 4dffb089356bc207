# SPDX-License-Identifier: Apache-2.0
"""The robot description agrees with the model; needs no ROS."""
from dataclasses import replace
import math
from xml.etree import ElementTree

import numpy as np
import pytest

from ballbot_ros.cli.command import main
from ballbot_ros.physics import Model, State, Terrain
from ballbot_ros.ros.frames import Frames
from ballbot_ros.ros.urdf import BAND_SEGMENTS, robot_description


def turned(axis, angle):
    """Return the rotation about an axis, right-handed (Rodrigues)."""
    x, y, z = np.array(axis, dtype=float) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


def numbers(text):
    """Return the numbers of an attribute."""
    return np.array([float(word) for word in text.split()])


def placed(element):
    """Return the transform of an `origin`: fixed-axis roll, pitch and yaw, as in URDF."""
    origin = element.find('origin')
    roll, pitch, yaw = numbers(origin.get('rpy'))
    frame = np.eye(4)
    frame[:3, :3] = (turned((0, 0, 1), yaw) @ turned((0, 1, 0), pitch)
                     @ turned((1, 0, 0), roll))
    frame[:3, 3] = numbers(origin.get('xyz'))
    return frame


def poses(tree, angles, at):
    """Return the transform of each link for joint angles, with the root at a position."""
    joints = {joint.find('child').get('link'): joint for joint in tree.findall('joint')}

    def transform(link):
        if link not in joints:
            root = np.eye(4)
            root[:3, 3] = at
            return root
        joint = joints[link]
        frame = transform(joint.find('parent').get('link')) @ placed(joint)
        if joint.get('type') != 'fixed':
            turn = np.eye(4)
            turn[:3, :3] = turned(numbers(joint.find('axis').get('xyz')),
                                  angles[joint.get('name')])
            frame = frame @ turn
        return frame
    return {link.get('name'): transform(link.get('name')) for link in tree.findall('link')}


def described(robot, **names):
    """Return the description of a robot as parsed XML."""
    return ElementTree.fromstring(robot_description(robot, Frames(**names)))


def posed(robot, state):
    """Return the transforms of the links in a state of the model, as joint_states reports it."""
    return poses(described(robot), {'shell': state.ball_angle, 'pendulum': state.joint_angle},
                 (state.x, 0.0, state.y))


def centre_of_mass(tree, name, frames):
    """Return the position of the centre of mass of a link."""
    inertial, = [link.find('inertial') for link in tree.findall('link')
                 if link.get('name') == name]
    return (frames[name] @ placed(inertial))[:3, 3]


@pytest.mark.parametrize('x, y, ball_angle, phi', [
    (0.0, 0.226, 0.0, 0.0), (1.4, 0.31, -6.2, 0.9), (-0.3, 0.226, 2.0, -2.5)])
def test_the_links_have_the_positions_of_the_model(gimball, x, y, ball_angle, phi):
    frames = posed(gimball, State(x=x, y=y, ball_angle=ball_angle, pendulum_angle=phi))
    assert frames['base_link'][:3, 3] == pytest.approx([x, 0.0, y])
    assert frames['base_link'][:3, :3] == pytest.approx(np.eye(3))
    length = gimball.pendulum_length
    assert centre_of_mass(described(gimball), 'pendulum_link', frames) == pytest.approx(
        [x + length * math.sin(phi), 0.0, y - length * math.cos(phi)])


def test_the_lowest_point_of_a_rolling_ball_is_at_rest(gimball):
    rolling = Model(gimball, Terrain.flat()).at_rest(0.0, speed=0.8)
    assert rolling.ball_rate < 0.0
    later = rolling._replace(x=rolling.x + 0.8e-6, ball_angle=1e-6 * rolling.ball_rate)
    lowest = np.array([0.0, 0.0, -gimball.ball_radius, 1.0])
    before, after = (posed(gimball, state)['ball_link'] for state in (rolling, later))
    assert (after @ lowest - before @ lowest)[:3] == pytest.approx(np.zeros(3), abs=1e-8)


def test_the_mark_of_the_shell_turns_with_the_ball_angle(gimball):
    link, = [link for link in described(gimball).findall('link')
             if link.get('name') == 'ball_link']
    mark, = [placed(shape) for shape in link.findall('visual')
             if shape.find('material').get('name') == 'mark']
    state = Model(gimball, Terrain.flat()).at_rest(0.0)._replace(ball_angle=math.pi / 2)
    to_mark = posed(gimball, state)['ball_link'] @ mark[:, 3] - [state.x, 0.0, state.y, 0.0]
    # Counter-clockwise from straight down, a quarter turn points forward.
    assert to_mark[:3] == pytest.approx([gimball.ball_radius, 0.0, 0.0])


def test_the_patches_of_the_band_lie_flat_on_the_shell(gimball):
    link, = [link for link in described(gimball).findall('link')
             if link.get('name') == 'ball_link']
    patches = [placed(shape) for shape in link.findall('visual')
               if shape.find('geometry/box') is not None]
    assert len(patches) == BAND_SEGMENTS
    for patch in patches:
        assert np.linalg.norm(patch[:3, 3]) == pytest.approx(gimball.ball_radius)
        # The thin side of the box points out of the ball.
        assert abs(patch[:3, 2] @ patch[:3, 3]) == pytest.approx(gimball.ball_radius)


def test_masses_inertia_and_limits_agree_with_the_robot_file(gimball):
    tree = described(gimball)
    inertials = {link.get('name'): (float(link.find('inertial/mass').get('value')),
                                    float(link.find('inertial/inertia').get('iyy')))
                 for link in tree.findall('link') if link.find('inertial') is not None}
    assert inertials == {'ball_link': (gimball.ball_mass, gimball.ball_inertia),
                         'pendulum_link': (gimball.pendulum_mass, gimball.pendulum_inertia)}
    limit = tree.find('joint[@name="pendulum"]/limit')
    assert float(limit.get('effort')) == gimball.motor.maximum_torque
    assert float(limit.get('velocity')) == pytest.approx(9.6)


def test_a_motor_without_an_idle_speed_has_a_finite_limit_in_the_description(gimball):
    endless = replace(gimball, motor=replace(gimball.motor, speed_constant=0.0))
    limit = described(endless).find('joint[@name="pendulum"]/limit')
    assert math.isfinite(float(limit.get('velocity')))
    assert described(replace(gimball, motor=None)).find('joint[@name="pendulum"]/limit') is None


def test_a_ball_without_a_pendulum_has_no_joint_for_it(shellball):
    tree = described(shellball)
    assert [joint.get('name') for joint in tree.findall('joint')
            if joint.get('type') != 'fixed'] == ['shell']
    assert 'pendulum_link' not in {link.get('name') for link in tree.findall('link')}


def test_every_link_but_the_base_has_one_parent(robot):
    tree = described(robot)
    children = [joint.find('child').get('link') for joint in tree.findall('joint')]
    links = [link.get('name') for link in tree.findall('link')]
    assert len(set(children)) == len(children) and len(set(links)) == len(links)
    assert set(links) - set(children) == {'base_link'}


def test_links_are_named_as_the_frames_are(gimball):
    tree = described(gimball, base='hull', imu='sensor')
    assert {'hull', 'sensor'} <= {link.get('name') for link in tree.findall('link')}


def test_the_command_prints_the_description(gimball, capsys):
    assert main(['robots', 'gimball', '--urdf']) == 0
    assert capsys.readouterr().out == robot_description(gimball)


def test_a_description_without_a_robot_is_refused(capsys):
    assert main(['robots', '--urdf']) != 0
    assert 'needs the name of a robot' in capsys.readouterr().err
