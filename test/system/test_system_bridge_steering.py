# SPDX-License-Identifier: Apache-2.0
"""The node and a RoboClaw with two motors: cmd_vel turns the ball, and odom says so."""
import math
import time

from driving import Driving, WATCHDOG
from geometry_msgs.msg import TwistStamped
from graph import TIMEOUT
from nav_msgs.msg import Odometry
import pytest
import yaml

from ballbot_ros.config.files import config_folder
from ballbot_ros.emulator.ball import settings_for
from ballbot_ros.emulator.emulator import Emulator
from ballbot_ros.physics import load_scene


@pytest.fixture
def motors(tmp_path):
    """Return an emulated RoboClaw with a motor on each output, ended after the test."""
    scene = load_scene('flat')
    with Emulator('roboclaw', scene, baud=460800, link=tmp_path / 'motors', steering=True,
                  settings=settings_for(scene.model.robot, watchdog=WATCHDOG)) as emulator:
        yield emulator


@pytest.fixture
def hardware_file(tmp_path):
    """Return a hardware file for it; no IMU is needed on a level floor."""
    content = yaml.safe_load(
        (config_folder() / 'hardware/gimball_roboclaw_steering.yaml').read_text())
    content['connection'].update(imu_required=False, loop_rate=100.0, watchdog=WATCHDOG)
    path = tmp_path / 'steering.yaml'
    path.write_text(yaml.safe_dump(content))
    return str(path)


def heading_of(message):
    """Return the heading of an odometry [rad]."""
    orientation = message.pose.pose.orientation
    return 2.0 * math.atan2(orientation.z, orientation.w)


def test_a_yaw_rate_on_cmd_vel_leans_the_pendulum_and_turns_the_ball(
        graph, motors, hardware_file):
    moved = graph.subscribe('odom', Odometry)
    graph.start('bridge', hardware=hardware_file, port=motors.path)
    run = Driving(graph, motors)
    turn = TwistStamped()
    turn.twist.linear.x, turn.twist.angular.z = 0.4, 0.3

    def result():
        """Return 'turned', or the reason of an e-stop."""
        turned = motors.ball.lateral.heading > 0.3 and heading_of(moved[-1]) > 0.25
        return 'turned' if turned else run.status[-1].e_stop if run.status else ''
    deadline = time.monotonic() + TIMEOUT
    while True:  # the ball turns further with each attempt
        run.release()
        found = graph.publish_until(result, 'the ball turns', 'cmd_vel', turn)
        if found == 'turned':
            break
        graph.statuses.clear()
        values = graph.wait(lambda: graph.values('bridge'), 'the bridge reports its health')
        # Measurements of a drive and a loop that were held up contradict each other.
        assert run.held_up() or int(values['late_periods']) > 0, found
        if time.monotonic() > deadline:
            pytest.skip(f'the load of this machine is too high: {found}')
    graph.kill('bridge')
    graph.wait(lambda: motors.torque == motors.device.second_torque() == 0.0,
               'the serial timeout of the drive ends both torques')
