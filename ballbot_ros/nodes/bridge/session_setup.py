# SPDX-License-Identifier: Apache-2.0
"""Creates the session of the motor bridge from the parameters."""
from dataclasses import replace
from functools import partial

from rclpy.node import Node

from ballbot_ros.bridge.drive_line import connectors
from ballbot_ros.bridge.feasibility import check_feasible, check_joint_state_rate, onboard_lag
from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.bridge.session import Session
from ballbot_ros.control import PendulumController, SupervisedController, Supervision
from ballbot_ros.nodes.bridge.black_box import black_box
from ballbot_ros.nodes.bridge.settings import BridgeSettings
from ballbot_ros.physics.model.robot import load_robot
from ballbot_ros.ros.endpoints import publisher_names
from ballbot_ros.ros.parameters import Commit
from ballbot_ros.ros.separate_process import run_in_process


def new_session(node: Node, settings: BridgeSettings) -> Session:
    """
    Return a session that is not configured yet, with or without laws on board.

    Raises
    ------
    ConfigurationError, UnstableLoopError
        If the loop is not feasible.

    """
    hardware = load_hardware(settings.hardware).at(settings.port, settings.baud)
    robot, tuning = load_robot(hardware.robot), settings.gains
    law = None
    if settings.control == 'onboard':
        check_joint_state_rate(hardware, settings.joint_state_rate)
        lag = onboard_lag(hardware, robot)
        lowest = check_feasible(hardware, robot, tuning, 0, lag)
        node.get_logger().info(
            f'laws on board, {1e3 * lag:.2g} ms from a measurement to its torque at most: these '
            f'gains need {lowest:.0f} Hz')
        law = SupervisedController(PendulumController(robot, tuning), Supervision(
            lowest, settings.set_point_timeout, let_down_time=hardware.limits.damping_time))
    else:
        check_feasible(hardware, robot, tuning, settings.delay)
    observer = black_box(settings.black_box, hardware)
    axes = [hardware] + ([] if hardware.steering is None else [hardware.lateral(robot)])
    connect, *lateral = connectors(axes, settings.capture, observer)
    return Session(hardware, robot, connect, observer=observer, law=law,
                   connect_lateral=lateral[0] if lateral else None,
                   publishers=partial(publisher_names, node))


def prepare_session(session: Session, now: BridgeSettings, wanted: BridgeSettings) -> Commit:
    """
    Check other gains and timeouts; return a function that passes them to the loop.

    Raises
    ------
    ConfigurationError, UnstableLoopError
        As `new_session`.

    """
    hardware, law = session.hardware, session.law
    if law is None:
        if (wanted.gains, wanted.delay) != (now.gains, now.delay):
            run_in_process(check_feasible, hardware, session.robot, wanted.gains, wanted.delay)
        return lambda: None
    check_joint_state_rate(hardware, wanted.joint_state_rate)
    lowest = law.expected.lowest_rate
    if wanted.gains != now.gains:
        lowest = run_in_process(check_feasible, hardware, session.robot, wanted.gains, 0,
                                onboard_lag(hardware, session.robot))
    expected = replace(law.expected, lowest_rate=lowest,
                       set_point_timeout=wanted.set_point_timeout)

    def commit() -> None:
        with session.lock:
            law.expected = expected
            if wanted.gains != now.gains:
                law.retune(wanted.gains)
                session.observer.event('the new gains are active')
    return commit
