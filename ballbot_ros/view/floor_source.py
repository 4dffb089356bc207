# SPDX-License-Identifier: Apache-2.0
"""A floor as a source: a robot on a floor, driven by set speed and yaw rate."""
from threading import Lock
from time import monotonic
from types import MappingProxyType
from typing import Mapping

from ballbot_ros.control import (
    checked_controller, JointReadings, load_tuning, Mode, SetPoint, Supervision)
from ballbot_ros.errors import BallbotError
from ballbot_ros.floors.floor import load_floor
from ballbot_ros.physics.model.robot import load_robot, Robot
from ballbot_ros.plant import FloorPlant, Pace, Speedometer
from ballbot_ros.steering import law
from ballbot_ros.view.frame import ContactForce, Frame
from ballbot_ros.view.source import Control, Health, Idle, Source

CONTROL_RATE = 250.0  # [Hz]
PERIODS_PER_FRAME = 5  # control periods per frame
SET_SPEED_MAX, YAW_RATE_MAX = 1.2, 0.5  # set-points [m/s], [rad/s]


class FloorSource(Source):
    """The robot gimball on a floor, given by name or file, driven by the controls of the page."""

    def __init__(self, floor: str):
        super().__init__()
        self.floor = load_floor(floor)
        self.start_pose = self.floor.start
        self._plant = FloorPlant(load_robot('gimball'), self.floor, self.start_pose, CONTROL_RATE)
        self._controller = checked_controller(
            self._plant.model.robot, load_tuning('gentle'), CONTROL_RATE, 0, Supervision())
        self._lock = Lock()
        self._paused, self._failure = True, ''
        self._speed = self._yaw_rate = 0.0
        self._speedometer = Speedometer()
        self._note()

    @property
    def title(self) -> str:
        assert self.floor is not None
        return f'Floor {self.floor.name}'

    @property
    def robot(self) -> Robot:
        return self._plant.model.robot

    @property
    def health(self) -> Health:
        at_rest = not self._paused and not self._speed
        return Health(not self._paused, None if self._paused else self._speedometer.factor,
                      failure=self._failure,
                      idle=Idle('The robot is at rest: set a speed.', 'Drive',
                                (('set_point', 0.4),)) if at_rest and not self._failure else None)

    @property
    def controls(self) -> Mapping[str, Control]:
        return MappingProxyType({
            'pause': Control(self._paused, refusal=self._failure), 'reset': Control(None),
            'set_point': Control(self._speed, -SET_SPEED_MAX, SET_SPEED_MAX, 'm/s'),
            'yaw_rate': Control(self._yaw_rate, -YAW_RATE_MAX, YAW_RATE_MAX, 'rad/s')})

    def _set_pause(self, paused: bool) -> None:
        self._paused = paused

    def _set_reset(self, _: bool) -> None:
        with self._lock:
            self._plant.reset(time=True)
            self._controller.forget()
            self._speed = self._yaw_rate = 0.0
            self._failure = ''
            self._note()  # at time 0, which starts a new epoch

    def _set_set_point(self, speed: float) -> None:
        self._speed = speed

    def _set_yaw_rate(self, yaw_rate: float) -> None:
        self._yaw_rate = yaw_rate

    def _live(self) -> None:
        pace = Pace(self._plant.period, 1.0, most=25)
        while not self._ending.wait(0.01):
            now = monotonic()
            if self._paused:
                pace.restart(now)
                continue
            with self._lock:
                for _ in range(pace.due(now)):
                    try:
                        self._advance()
                    except BallbotError as error:
                        self._failure, self._paused = str(error), True
                        break
                self._speedometer.note(self._plant.time, now)

    def _advance(self) -> None:
        plant, state = self._plant, self._plant.state
        self._controller.give(SetPoint(Mode.SPEED, self._speed, plant.time))
        self._controller.take(JointReadings.of(state))
        plant.advance(self._controller.answer() or 0.0,
                      law(self.robot, plant.lateral, state.velocity_x, self._yaw_rate))
        if plant.periods % PERIODS_PER_FRAME == 0:
            self._note()

    def _note(self) -> None:
        """Add the present state to the history as a frame."""
        plant, state, lateral = self._plant, self._plant.state, self._plant.lateral
        contacts = tuple(map(ContactForce.of, plant.model.touches(state)))
        self.history.add(Frame(
            plant.time, state.x, state.y, state.ball_angle, state.pendulum_angle,
            state.velocity_x, state.velocity_y, state.ball_rate, state.pendulum_rate,
            plant.torque, contacts, place=plant.relative_pose, lean=lateral.lean,
            tilt=lateral.tilt))
