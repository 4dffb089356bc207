# SPDX-License-Identifier: Apache-2.0
"""Topics of the bridge other than those of the motor, each at its own rate."""
import math
from types import SimpleNamespace

import pytest
from rclpy.node import Node
from sensor_msgs.msg import BatteryState

from ballbot_ros.bridge.condition import Battery, Condition
from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.drives.contract import Telemetry
from ballbot_ros.estimation import OdometryFilter, PendulumFilter
from ballbot_ros.nodes.bridge import robot_outputs
from ballbot_ros.nodes.bridge.robot_outputs import battery_message, RobotOutputs
from ballbot_ros.nodes.bridge.settings import BridgeSettings
from ballbot_ros.physics import load_robot
from ballbot_ros.ros import odometry

GIMBALL = load_robot('gimball')
# ROS time is ahead of the steady clock, as wall time is of the time since boot.
CLOCKS = SimpleNamespace(stamp=lambda steady: steady + 1.7e9)


@pytest.fixture
def published(monkeypatch):
    """Return the published messages as pairs of topic and message."""
    found = []
    for module in (odometry, robot_outputs):
        monkeypatch.setattr(module, 'create_publisher', lambda node, topic: (
            SimpleNamespace(get_subscription_count=lambda: 1,
                            publish=lambda message: found.append((topic, message)))))
    return found


def outputs_of(make_node, session, rate):
    """Return the outputs of a session."""
    session.robot, session.hardware = GIMBALL, load_hardware('gimball_odrive')
    return RobotOutputs(make_node(Node, 'robot'), session, CLOCKS, BridgeSettings(odom_rate=rate))


def topics(published, *names):
    """Return the messages of some topics."""
    return [message for topic, message in published if topic in names]


def found(stamp, estimate=None, **telemetry):
    """Return the report of a period of the loop."""
    return SimpleNamespace(time=stamp, estimate=estimate, condition=Condition(),
                           telemetry=Telemetry(**telemetry))


def report(outputs, session, stamp):
    """Publish the report of a period that measured at `stamp`."""
    estimate = PendulumFilter(GIMBALL).start(stamp, 0.0)
    session.odometry = OdometryFilter(GIMBALL).start(estimate)._replace(position=stamp)
    outputs.publish(found(stamp, estimate))


@pytest.mark.parametrize('rate', (50.0, 100.0, 120.0, 500.0))
def test_odometry_has_its_rate_and_the_stamp_of_the_measurement(make_node, published, rate):
    session = SimpleNamespace(odometry=None, course=None)
    outputs = outputs_of(make_node, session, rate)
    outputs.publish(found(0.0))
    assert not topics(published, 'odom', '/tf')
    for number in range(1000):
        report(outputs, session, 0.002 * number)
    messages = topics(published, 'odom')
    assert len(messages) == pytest.approx(2.0 * rate, abs=1)
    last = messages[-1]
    assert last.header.stamp.sec == int(1.7e9 + last.pose.pose.position.x)


def test_a_rate_of_zero_leaves_odometry_to_others(make_node, published):
    session = SimpleNamespace(odometry=None, course=None)
    outputs = outputs_of(make_node, session, 0.0)
    report(outputs, session, 1.0)
    assert not topics(published, 'odom')
    moved = {one.child_frame_id for message in topics(published, '/tf')
             for one in message.transforms}
    assert moved == {'ball_link', 'pendulum_link'}  # other nodes publish the child of odom
    assert topics(published, 'robot_description') and topics(published, '/tf_static')


def test_odometry_does_not_catch_up_after_a_gap(make_node, published):
    session = SimpleNamespace(odometry=None, course=None)
    outputs = outputs_of(make_node, session, 100.0)
    for stamp in (0.0, 5.0, 5.002, 5.004):
        report(outputs, session, stamp)
    assert len(topics(published, 'odom')) == 2


def test_the_battery_is_reported_once_a_second_at_any_rate_of_the_loop(make_node, published):
    outputs = outputs_of(make_node, SimpleNamespace(odometry=None, course=None), 0.0)
    for number in range(1501):
        outputs.publish(found(0.002 * number, bus_voltage=24.0))
    messages = topics(published, 'battery_state')
    stamps = [stamp.sec + 1e-9 * stamp.nanosec for stamp in (
        message.header.stamp for message in messages)]
    assert len(stamps) == 4 and 2.7 < stamps[-1] - stamps[0] < 3.01
    assert all(0.7 < after - before < 1.01 for before, after in zip(stamps, stamps[1:]))


def test_unknown_values_of_a_battery_are_nan_or_unknown():
    message = battery_message(1.5e9, Battery(), Telemetry(), Condition())
    assert not message.present and message.header.stamp.sec == 1500000000
    for value in (message.voltage, message.current, message.temperature, message.charge,
                  message.capacity, message.design_capacity, message.percentage):
        assert math.isnan(value)
    assert message.power_supply_status == BatteryState.POWER_SUPPLY_STATUS_UNKNOWN
    assert message.power_supply_health == BatteryState.POWER_SUPPLY_HEALTH_UNKNOWN
    assert message.power_supply_technology == BatteryState.POWER_SUPPLY_TECHNOLOGY_UNKNOWN


def test_a_drawn_current_is_negative_and_braking_charges_the_battery():
    battery = Battery(technology='lipo', capacity=5.0)
    drawn = battery_message(1.0, battery, Telemetry(bus_voltage=24.0, bus_current=3.0),
                            Condition(percentage=0.5))
    assert drawn.present and (drawn.voltage, drawn.current) == (24.0, -3.0)
    assert (drawn.percentage, drawn.design_capacity) == (0.5, 5.0)
    assert drawn.power_supply_technology == BatteryState.POWER_SUPPLY_TECHNOLOGY_LIPO
    assert drawn.power_supply_status == BatteryState.POWER_SUPPLY_STATUS_DISCHARGING
    fed = battery_message(1.0, battery, Telemetry(bus_voltage=26.0, bus_current=-3.0), Condition())
    assert fed.current == 3.0
    assert fed.power_supply_status == BatteryState.POWER_SUPPLY_STATUS_CHARGING


@pytest.mark.parametrize('warning, health', [
    ('battery_low', 'GOOD'), ('battery_empty', 'DEAD'), ('over_voltage', 'OVERVOLTAGE')])
def test_the_health_of_a_battery_names_its_failure(warning, health):
    message = battery_message(1.0, Battery(), Telemetry(bus_voltage=24.0),
                              Condition(warnings=(warning,)))
    assert message.power_supply_health == getattr(BatteryState, f'POWER_SUPPLY_HEALTH_{health}')
