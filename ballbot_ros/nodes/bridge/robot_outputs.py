# SPDX-License-Identifier: Apache-2.0
"""Outputs of the bridge other than those of the motor: odometry and battery state."""
import math

from rclpy.node import Node
from sensor_msgs.msg import BatteryState
from std_msgs.msg import Header

from ballbot_ros.bridge.condition import Battery, Condition
from ballbot_ros.bridge.session import Report, Session
from ballbot_ros.drives.contract import Telemetry
from ballbot_ros.nodes.bridge.motor import Clocks, or_nan, Turns
from ballbot_ros.nodes.bridge.settings import BridgeSettings
from ballbot_ros.ros.conversions import estimated_odometry_message, to_time
from ballbot_ros.ros.endpoints import create_publisher
from ballbot_ros.ros.frames import FRAMES, Frames
from ballbot_ros.ros.odometry import OdometryTopics
from ballbot_ros.steering import LateralState

BATTERY_PERIOD = 1.0  # [s]
# Rate of the link transforms where another node publishes odometry [Hz].
LINK_RATE = 100.0


class RobotOutputs:
    """Publishes odometry and battery state of a session."""

    def __init__(self, node: Node, session: Session, clocks: Clocks, settings: BridgeSettings):
        self._session, self._clocks = session, clocks
        self._radius, self._battery = session.robot.ball_radius, session.hardware.battery
        self._topics = OdometryTopics(
            node, session.robot, settings, steers=session.course is not None)
        self.publish_odometry_at(settings)
        self._battery_topic = create_publisher(node, 'battery_state')
        self._battery_turns, self._frame = Turns(BATTERY_PERIOD), Frames.of(settings).base

    def publish_odometry_at(self, settings: BridgeSettings) -> None:
        """Change the rate of the odometry; the loop may be running."""
        self._odometry_turns = Turns(1.0 / (settings.odom_rate or LINK_RATE))
        self._topics.enable_odometry(settings.odom_rate > 0.0)

    def publish(self, report: Report) -> None:
        """Publish the results of a period of the loop, each topic when it is due."""
        state = self._session.odometry
        if state is not None and report.estimate is not None \
                and self._odometry_turns.is_due(state.stamp):
            stamp, angles = self._clocks.stamp(state.stamp), report.estimate.readings
            course = self._session.course
            lateral = LateralState() if course is None else course.lateral
            self._topics.publish(lambda: estimated_odometry_message(
                stamp, state, self._radius, self._topics.frames,
                None if course is None else course.pose, lateral),
                angles.ball_angle, angles.joint_angle, lateral)
        if self._battery_turns.is_due(report.time):
            self._battery_topic.publish(battery_message(
                self._clocks.stamp(report.time), self._battery, report.telemetry,
                report.condition, self._frame))


def battery_message(stamp: float, battery: Battery, telemetry: Telemetry,
                    condition: Condition, frame: str = FRAMES.base) -> BatteryState:
    """Return the battery state at a ROS time [s]; NaN for unmeasured fields, as specified."""
    voltage, drawn = telemetry.bus_voltage, telemetry.bus_current
    status, health = (BatteryState.POWER_SUPPLY_STATUS_UNKNOWN,
                      BatteryState.POWER_SUPPLY_HEALTH_UNKNOWN)
    if voltage is not None:
        status = BatteryState.POWER_SUPPLY_STATUS_CHARGING if drawn is not None and drawn < 0.0 \
            else BatteryState.POWER_SUPPLY_STATUS_DISCHARGING
        health = BatteryState.POWER_SUPPLY_HEALTH_GOOD
    if 'over_voltage' in condition.warnings:
        health = BatteryState.POWER_SUPPLY_HEALTH_OVERVOLTAGE
    if 'battery_empty' in condition.warnings:
        health = BatteryState.POWER_SUPPLY_HEALTH_DEAD
    return BatteryState(
        header=Header(stamp=to_time(stamp), frame_id=frame), voltage=or_nan(voltage),
        current=math.nan if drawn is None else -drawn,  # negative while discharging
        temperature=math.nan, charge=math.nan, capacity=math.nan,
        design_capacity=or_nan(battery.capacity),
        percentage=condition.percentage, power_supply_status=status,
        power_supply_health=health, present=voltage is not None,
        power_supply_technology=getattr(
            BatteryState, f'POWER_SUPPLY_TECHNOLOGY_{battery.technology.upper()}'))
