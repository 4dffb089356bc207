# SPDX-License-Identifier: Apache-2.0
"""The bridge with drives other than the ODrive: a RoboClaw with two motors, and a VESC."""
import math
import time

from driving import Driving, WATCHDOG
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
import pytest
from waiting import TIMEOUT

from ballbot_ros.emulator.control import execute


def heading_of(message):
    """Return the heading of an odometry [rad]."""
    orientation = message.pose.pose.orientation
    return 2.0 * math.atan2(orientation.z, orientation.w)


def test_a_yaw_rate_on_cmd_vel_leans_the_pendulum_and_turns_the_ball(
        graph, emulate, hardware):
    motors = emulate('roboclaw', steering=True)
    moved = graph.subscribe('odom', Odometry)
    graph.start('bridge', hardware=hardware('gimball_roboclaw_steering', loop_rate=100.0),
                port=motors.path)
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
        # Delays make the measurements of drive and loop inconsistent.
        assert run.held_up() or int(values['late_periods']) > 0, found
        if time.monotonic() > deadline:
            pytest.skip(f'the load of this machine is too high: {found}')
    graph.kill('bridge')
    graph.wait(lambda: motors.torque == motors.device.second_torque() == 0.0,
               'the serial timeout of the drive ends both torques')


def test_a_vesc_is_released_repeatedly_and_its_kill_switch_is_reported(graph, emulate, hardware):
    vesc = emulate('vesc', quirks=('kill_switch',))
    graph.start('bridge', hardware=hardware('gimball_vesc'), port=vesc.path, control='direct')
    run = Driving(graph, vesc)
    for _ in range(3):  # idle until its timeout has expired
        graph.spin(WATCHDOG + 0.1)
        run.release()
        assert not run.status[-1].e_stop
        run.pull()
        execute(vesc, 'stop_switch')
        graph.wait(lambda: 'KILL_SW_ACTIVE' in run.status[-1].faults, 'its report')
        run.wait_for_nothing()
        assert list(run.status[-1].faults) == ['KILL_SW_ACTIVE']
        execute(vesc, 'stop_switch 0')
        run.wait_for_nothing()
