# SPDX-License-Identifier: Apache-2.0
"""Creates the session of the motor bridge from the parameters, and its black box."""
import atexit
from dataclasses import replace
from functools import partial
import logging
import os
from pathlib import Path

from rclpy.node import Node

from ballbot_ros import __version__
from ballbot_ros.black_box.dump import BlackBoxFiles
from ballbot_ros.black_box.ring import BlackBox
from ballbot_ros.bridge.drive_line import connectors
from ballbot_ros.bridge.feasibility import check_feasible, check_joint_state_rate, onboard_lag
from ballbot_ros.bridge.hardware_file import Hardware, load_hardware
from ballbot_ros.bridge.observer import Level, SessionObserver
from ballbot_ros.bridge.session import Session
from ballbot_ros.control import PendulumController, SupervisedController, Supervision
from ballbot_ros.nodes.bridge.settings import BridgeSettings
from ballbot_ros.physics.model.robot import load_robot
from ballbot_ros.ros.endpoints import publisher_names
from ballbot_ros.ros.parameters import Commit
from ballbot_ros.ros.separate_process import run_in_process

LOGGER = 'ballbot_ros.bridge'
ROS_HOME = '~/.ros'  # the default of the environment variable


def new_session(node: Node, settings: BridgeSettings) -> Session:
    """
    Return a session that is not configured yet, with or without laws on board.

    Raises `ConfigurationError` or `UnstableLoopError` if the loop is not feasible.
    """
    hardware = load_hardware(settings.hardware).at(settings.port, settings.baud)
    robot, tuning = load_robot(hardware.robot), settings.gains
    law = None
    if settings.control == 'onboard':
        check_joint_state_rate(hardware, settings.joint_state_rate)
        lag = onboard_lag(hardware, robot)
        lowest = check_feasible(hardware, robot, tuning, 0, lag)
        node.get_logger().info(
            f'laws on board, at most {1e3 * lag:.2g} ms from a measurement to its torque: these '
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
    """Check new gains and timeouts; return a function that passes them to the loop."""
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


def resolve_folder(folder: str) -> Path:
    """Return the path of a folder; the default is relative to ROS_HOME if that is set."""
    path, home = Path(folder), os.environ.get('ROS_HOME')
    if home and path.is_relative_to(ROS_HOME):
        return Path(home) / path.relative_to(ROS_HOME)
    return path.expanduser()


class LogRecorder(logging.Handler):
    """Records log messages in a black box, each with its time."""

    def __init__(self, box: BlackBox):
        super().__init__(logging.INFO)
        self._box = box

    def emit(self, record: logging.LogRecord) -> None:
        self._box.event(record.getMessage(), Level.LOG)


def black_box(folder: str, hardware: Hardware) -> SessionObserver:
    """
    Return the observer of a session.

    It writes files to `folder`; if that is empty, nothing is recorded.  Pending files are written
    when the process ends.
    """
    if not folder:
        return SessionObserver()
    connection = hardware.connection
    box = BlackBox(period=1.0 / connection.loop_rate)
    files = BlackBoxFiles(box, resolve_folder(folder), {
        'hardware': hardware.name, 'robot': hardware.robot, 'protocol': connection.protocol,
        'port': connection.port, 'loop_rate': f'{connection.loop_rate:g}',
        'torque_limit': f'{hardware.limits.torque_limit:g}', 'version': __version__})
    atexit.register(files.close)
    logging.getLogger(LOGGER).addHandler(LogRecorder(box))
    return box
