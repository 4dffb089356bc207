# SPDX-License-Identifier: Apache-2.0
"""The control laws inside the simulator: a torque source with the methods of `CommandGate`."""
from collections import Counter
from dataclasses import replace
from typing import Dict

from rclpy.node import Node

from ballbot_ros.control import (
    checked_controller, JointReadings, SetPoint, SupervisedController, Supervision)
from ballbot_ros.nodes.simulator.settings import SimulatorSettings
from ballbot_ros.plant import Plant
from ballbot_ros.ros.endpoints import subscribe_e_stop
from ballbot_ros.ros.parameters import Commit
from ballbot_ros.ros.retuning import prepare_laws
from ballbot_ros.ros.set_points import SetPoints
from ballbot_ros.ros.settings import LoopNumbers
from ballbot_ros.steering import law


class LawsInside:
    """
    The on-board control laws of a bridge, inside the simulator, without latency.

    Raises `ConfigurationError` or `UnstableLoopError` if the robot has no pendulum, or the loop
    would diverge.
    """

    def __init__(self, node: Node, plant: Plant, settings: SimulatorSettings):
        self._plant = plant
        self._controller: SupervisedController = checked_controller(
            plant.model.robot, *_loop(settings), _supervision(settings))
        self.refused: Counter[str] = Counter()  # set-points by reason
        SetPoints(node, self._give, self.refused, self._controller.record_request, plant.steers)
        subscribe_e_stop(node, self._controller.on_e_stop)

    def torque(self, now: float) -> float:
        """Return the torque for the present state, at the start of a period [N m]."""
        state = self._plant.state
        self._controller.take(JointReadings(
            now, state.ball_angle, state.joint_angle, state.ball_rate, state.joint_rate))
        return self._controller.answer() or 0.0

    def lean(self, now: float) -> float:
        """Return the lean of the steering law for the present state [rad]."""
        robot = self._plant.model.robot
        if not self._plant.steers:
            return 0.0
        return law(robot, self._plant.lateral, -robot.ball_radius * self._plant.state.ball_rate,
                   self._controller.set_point.yaw_rate)

    def expired(self, now: float) -> bool:
        """Return False: the controller checks the age of set-points."""
        return False

    def clear(self) -> None:
        """Drop the set-point."""
        self._controller.forget()

    def prepare(self, now: SimulatorSettings, wanted: SimulatorSettings) -> Commit:
        """Check new parameters; return a function that applies them."""
        return prepare_laws(self._controller, self._plant.model.robot, _loop(now), _loop(wanted),
                            _supervision(wanted))

    @property
    def values(self) -> Dict[str, object]:
        now = self._controller.set_point
        return {'law': now.mode.value, 'set_value': f'{now.value:.4f}',
                'e_stop': self._controller.e_stop}

    def _give(self, given: SetPoint) -> None:
        self._controller.give(given if given.stamp else replace(given, stamp=self._plant.time))


def _loop(settings: SimulatorSettings) -> LoopNumbers:
    return LoopNumbers(settings.gains, settings.control_rate, 0)


def _supervision(settings: SimulatorSettings) -> Supervision:
    return Supervision(set_point_timeout=settings.set_point_timeout)
