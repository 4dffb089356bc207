# SPDX-License-Identifier: Apache-2.0
"""A simulator on a floor with a controller: yaw rates on cmd_vel turn the ball in all topics."""
import math
from types import SimpleNamespace

from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import OccupancyGrid, Odometry
import numpy as np
import pytest
from rclpy.node import Node
from refusals import refused
from sensor_msgs.msg import JointState, LaserScan
from tf2_msgs.msg import TFMessage
from tiers import slow

from ballbot_ros.config.files import find_config
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.msg import BallState, TerrainObservation
from ballbot_ros.nodes.controller.node import Controller
from ballbot_ros.nodes.simulator.node import Simulator
from ballbot_ros.nodes.simulator.outputs import PlaceOnMap
from ballbot_ros.nodes.simulator.settings import plant_for, SimulatorSettings
from ballbot_ros.ros import qos
from ballbot_ros.ros.conversions import to_time
from ballbot_ros.ros.endpoints import create_subscription

FLOOR = """
walls: {size: [12, 12], lines: [[[9.0, 4.0], [9.0, 8.0]]]}
features:
  - {kind: step, line: [[7.0, 12.0], [7.0, 0.0]], height: 0.02}
start: [6.0, 6.0, 90.0]
"""
TOPICS = {'odom': Odometry, 'ball_state': BallState, 'joint_states': JointState,
          'scan': LaserScan, 'terrain_observation': TerrainObservation, '/tf': TFMessage,
          'map': OccupancyGrid}


@pytest.fixture
def drive(make_node, spinner, tmp_path):
    """Return a function that runs nodes, and publishes a speed and a yaw rate for a time."""
    path = tmp_path / 'hall.yaml'
    path.write_text(FLOOR)

    def run(seconds, speed, yaw_rate, control='direct', **settings):
        simulator = make_node(Simulator, floor=str(path), control=control, real_time_factor=0.0,
                              **settings)
        nodes = [simulator, make_node(Node, 'driver')]
        if control == 'direct':
            nodes.append(make_node(Controller, tuning='gentle'))
        spinner.add(*nodes)
        driver, last = nodes[1], {}
        for topic, kind in TOPICS.items():
            create_subscription(driver, topic, lambda one, topic=topic: last.update({topic: one}),
                                kind, qos.LATEST if topic != 'map' else qos.LATCHED)
        publisher = driver.create_publisher(TwistStamped, 'cmd_vel', 1)
        message = TwistStamped()
        message.twist.linear.x, message.twist.angular.z = speed, yaw_rate
        plant, sent = simulator._plant, [-1.0]

        def publish():
            if plant.time - sent[0] > 0.05:
                sent[0] = plant.time
                message.header.stamp = to_time(plant.time)
                publisher.publish(message)
        spinner.until(lambda: plant.time >= seconds and not TOPICS.keys() - last.keys(), publish)
        return plant, SimpleNamespace(**{name.strip('/'): one for name, one in last.items()})
    return run


@pytest.mark.slow
@pytest.mark.parametrize('control', ['direct', 'onboard'])
def test_a_yaw_rate_on_cmd_vel_is_followed(drive, control):
    settings = {'lockstep': True} if control == 'direct' else {'tuning': 'gentle'}
    plant, seen = drive(5.0, 0.4, 0.2, control, **settings)
    assert plant.lateral.yaw_rate == pytest.approx(0.2, abs=0.02)
    x, y, heading = plant.relative_pose
    # All topics have nearly the same time.
    assert seen.odom.twist.twist.angular.z == pytest.approx(0.2, abs=0.02)
    turned = 2.0 * math.atan2(seen.odom.pose.pose.orientation.z, seen.odom.pose.pose.orientation.w)
    assert turned == pytest.approx(heading, abs=0.05)
    at = seen.odom.pose.pose.position
    assert (at.x, at.y) == pytest.approx((x, y), abs=0.05)
    assert (seen.ball_state.position_x, seen.ball_state.position_y) == pytest.approx(
        (x, y), abs=0.05)
    assert seen.ball_state.heading == pytest.approx(heading, abs=0.05)
    assert list(seen.joint_states.name) == ['shell', 'pendulum', 'lean', 'tilt', 'yaw']
    assert seen.joint_states.position[2] == pytest.approx(plant.lateral.lean, abs=0.02)
    links = {one.child_frame_id: one.header.frame_id for one in seen.tf.transforms}
    assert links in ({'odom': 'map'}, {
        'base_link': 'odom', 'axle_link': 'base_link', 'ball_link': 'axle_link',
        'carrier_link': 'ball_link', 'pendulum_link': 'carrier_link'})


@pytest.mark.slow
def test_sensors_measure_along_the_heading(drive):
    plant, seen = drive(0.6, 0.0, 0.0, 'onboard')
    # At (6, 6) with heading 90 degrees the step is 1 m to the right, the wall 2.95 m.
    scan = seen.scan
    angles = scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges))
    ahead, right = (scan.ranges[int(np.argmin(np.abs(angles - angle)))]
                    for angle in (0.0, -0.5 * math.pi))
    assert ahead == pytest.approx(6.0 - 0.05, abs=0.05)
    assert right == pytest.approx(3.0 - 0.05, abs=0.05)
    # The step is not ahead.
    assert np.ptp(seen.terrain_observation.z) == pytest.approx(0.0, abs=1e-9)
    assert (seen.map.info.width, seen.map.info.height) == (240, 240)


def test_the_pose_of_odom_on_the_map_is_exact_or_drifts(make_node):
    plant = plant_for(SimulatorSettings(floor='apartment'))
    plant.put(plant.state, (2.0, 1.0, 0.5))
    exact = PlaceOnMap(make_node(Node, 'exact'), plant, SimulatorSettings())
    assert exact.of_odom(0.1) == plant.start_pose
    drifting = PlaceOnMap(make_node(Node, 'drifting'), plant, SimulatorSettings(
        map_sd=0.05, map_heading_sd=0.02))
    x, y, turn = plant.relative_pose
    errors = []
    for number in range(2000):
        east, north, heading = drifting.of_odom(10.0 * number)
        # Error of the pose of the robot by the transforms of map and odom.
        errors.append((east + math.cos(heading) * x - math.sin(heading) * y - 2.0,
                       north + math.sin(heading) * x + math.cos(heading) * y - 1.0,
                       heading + turn - 0.5))
    assert np.std(errors, axis=0) == pytest.approx([0.05, 0.05, 0.02], rel=0.1)
    assert abs(drifting.of_odom(20000.0)[0] - drifting.of_odom(20000.001)[0]) < 0.005


@pytest.mark.parametrize('yaw_rate, followed', [(0.2, False), *slow((0.0, True))])
def test_a_robot_without_steering_refuses_to_turn(drive, tmp_path, yaw_rate, followed):
    text = find_config('robots', 'gimball').read_text()
    straight = tmp_path / 'straight.yaml'
    straight.write_text(text[:text.index('\nsteering:')])
    plant, seen = drive(1.0, 0.3, yaw_rate, 'onboard', robot=str(straight))
    # A message with a yaw rate is refused completely.
    assert (plant.state.velocity_x > 0.1) is followed and plant.steers is False
    assert list(seen.joint_states.name) == ['shell', 'pendulum']


@pytest.mark.parametrize('settings, reason, field', [
    ({'start': '1, 2, 3'}, 'inconsistent', 'start'),
    ({'floor': 'apartment', 'start': '1, x, 0'}, 'wrong_type', 'start'),
    ({'floor': 'apartment', 'start': '-5, 1, 0'}, 'out_of_range', 'pose'),
    ({'floor': 'apartment', 'accuracy': 1e-4}, 'inconsistent', 'accuracy'),
    ({'floor': 'no_such_floor'}, 'unknown_name', 'floor')])
def test_settings_that_contradict_each_other_are_refused(settings, reason, field):
    with refused(reason, field, ConfigurationError):
        plant_for(SimulatorSettings(**settings))
