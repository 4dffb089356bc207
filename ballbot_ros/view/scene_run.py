# SPDX-License-Identifier: Apache-2.0
"""Indefinite run of a scene, with changes during the run."""
from dataclasses import replace
from functools import lru_cache
import math
from typing import Optional, Tuple

from ballbot_ros.config.files import shipped_files
from ballbot_ros.decision.planning.curve import HeightCurve, load_curve
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics.model.actuation import Actuator
from ballbot_ros.physics.model.robot import load_robot, Robot
from ballbot_ros.physics.model.state import State
from ballbot_ros.physics.simulation.model import Model
from ballbot_ros.physics.simulation.run import solvers_for
from ballbot_ros.physics.simulation.scene import Scene
from ballbot_ros.plant.error_monitor import ErrorMonitor
from ballbot_ros.view.frame import ContactForce, EnergyShares, Frame
from ballbot_ros.view.ground import with_step
from ballbot_ros.view.laws import MotorLaw

PERIOD = 2e-3  # approximate: rounded to a whole number of solver steps [s]


@lru_cache(maxsize=1)
def _shipped_curves() -> Tuple[HeightCurve, ...]:
    """Return the curves that come with the package; they are read once."""
    return tuple(load_curve(file.stem) for file in shipped_files('curves'))


class SceneRun:
    """
    A scene that runs in steps of one period [s]; for use in one thread.

    Each change is applied completely or, with an error, not at all.  While `e_stop` is engaged
    there is no torque; `accuracy` is the largest allowed position error [m], None for the solver
    of the scene; `model` has the robot, ground and solver in use.
    """

    def __init__(self, scene: Scene):
        self.scene, self.accuracy, self.e_stop = scene, scene.run.accuracy, False
        self.law = MotorLaw.of_scene(scene.model.robot, scene.actuation)
        self._steps = max(1, round(PERIOD / scene.model.solver_in_use.step))
        self.period = self._steps * scene.model.solver_in_use.step
        self.state, self._periods = scene.start, 0
        self._take(scene.model, None)

    @property
    def robot(self) -> Robot:
        return self.model.robot

    @property
    def error_estimate(self) -> Optional[float]:
        """Return the largest position error so far [m], None without an accuracy."""
        return self._monitor.error if self._monitor else None

    @property
    def accuracy_lost_at(self) -> float:
        """Return the time [s] from which the accuracy does not hold; infinite while it holds."""
        return self._monitor.accuracy_lost_at if self._monitor else math.inf

    def advance(self, periods: int) -> None:
        """Advance by a number of periods; a failed run stays at its last valid state."""
        # A law that depends on the state at the start of a period is evaluated once per period.
        chunk = 1 if self.law.sampled and not self.e_stop else periods
        for _ in range(periods // chunk):
            actuator = self._actuator()
            steps = chunk * self._steps
            after = self.model.advance(self.state, actuator, steps)
            after = after._replace(time=(self._periods + chunk) * self.period)
            if self._monitor:
                self._monitor.advance(after, actuator, steps)
            self.state, self._periods = after, self._periods + chunk

    def frame(self) -> Frame:
        """Return the present state as a frame."""
        state, model = self.state, self.model
        contacts = tuple(map(ContactForce.of, model.touches(state)))
        energies = model.energies(state)
        has = model.robot.has_pendulum
        return Frame(
            state.time, state.x, state.y, state.ball_angle,
            state.pendulum_angle if has else None, state.velocity_x, state.velocity_y,
            state.ball_rate, state.pendulum_rate if has else None,
            model.torque(state, self._actuator()) if has else None, contacts,
            EnergyShares(*energies, state.dissipated_energy, state.motor_work),
            e_stop=self.e_stop)

    def reset(self) -> None:
        """Return to the start, on the present ground, with the present robot and law."""
        self._take(self.model, None)

    def set_robot(self, name: str) -> None:
        """Restart with another robot."""
        robot = load_robot(name)
        law = self.law.changed(robot=robot, law=None if robot.has_pendulum else 'free')
        self._take(replace(self.model, robot=robot), None, law)

    def set_friction(self, friction: float) -> None:
        """Set the friction of ground and edges; pieces with their own friction keep it."""
        robot = replace(self.robot, surface_friction=friction, edge_friction=friction)
        self._take(replace(self.model, robot=robot), self.state, self.law.changed(robot=robot))

    def set_step_height(self, height: float) -> None:
        """Change the next step ahead, see `with_step`."""
        ground = with_step(self.model.terrain, self.state.x, self.robot.ball_radius, height)
        self._take(replace(self.model, terrain=ground), self.state)

    def set_law(self, law: Optional[str] = None, set_point: Optional[float] = None) -> None:
        """Select another law, with a set-point of 0, or another set-point."""
        self.law = self.law.changed(law=law, set_point=set_point)
        self.law.begin(self.state)

    def set_accuracy(self, accuracy: float) -> None:
        """Continue with another accuracy [m]; 0 selects the solver of the scene."""
        self.accuracy, before = accuracy or None, self.accuracy
        try:
            self._take(self.model, self.state)
        except ConfigurationError:
            self.accuracy = before
            raise

    def curve(self) -> Optional[HeightCurve]:
        """Return the shipped height curve for this robot and law, None without one."""
        law, angle = self.law.law, math.radians(self.law.set_point)
        held = law == 'position' and not self.e_stop
        for curve in _shipped_curves():
            made = curve.made
            if made and made.robot_digest == self.robot.digest \
                    and (made.law == 'position') is held \
                    and (not held or abs(made.set_angle - angle) < 1e-3):
                return curve
        return None

    def _actuator(self) -> Actuator:
        return Actuator() if self.e_stop else self.law.actuator(self.state)

    def _take(self, model: Model, state: Optional[State], law: Optional[MotorLaw] = None) -> None:
        """Continue from a state, None for the start of the scene; a law, if given, is new."""
        monitor, start = None, self.scene.initial.state(model) if state is None else state
        if self.accuracy is None:
            solver = self.scene.model.solver_in_use
        else:
            coarse, solver = solvers_for(self.accuracy, self.scene.model.solver_in_use.step)
            monitor = ErrorMonitor(replace(model, solver=coarse), start, self.accuracy)
        self.model, self._monitor, self.state = replace(model, solver=solver), monitor, start
        if state is None:
            self._periods = 0
        self.law = law or self.law
        if law is not None or state is None:
            self.law.begin(start)
