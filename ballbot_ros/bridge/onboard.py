# SPDX-License-Identifier: Apache-2.0
"""
Onboard control: the controllers run in the loop of the bridge, without a topic in between.

These are the objects of the node `controller`: set-points with their age, controllers (11) and
(12) and the speed controller.  The `Supervisor` receives their torque as a command with the stamp
of its measurement, so that the torque ends when the measurements end.
"""
from dataclasses import replace
from typing import Callable

from ballbot_ros.control import (
    ControlTuning, JointReadings, Mode, PendulumController, SetPoint, SupervisedController,
    Supervision)
from ballbot_ros.control.command_gate import CLOCK_SKEW_MAX
from ballbot_ros.errors import MessageError
from ballbot_ros.physics.model.robot import Robot

# Topic of the set-points of a mode.
TOPICS = {Mode.SPEED: 'cmd_vel'}


def topic_of(set_point: SetPoint) -> str:
    """Return the topic of a set-point."""
    return TOPICS.get(set_point.mode, 'set_point')


class OnBoard:
    """
    Computes a torque from set-point and estimate.  All times are of the session clock [s].

    Parameters
    ----------
    robot : Robot
    tuning : ControlTuning
    expected : Supervision
    publishers : callable
        Returns the names of the nodes that publish on a topic, for log messages.

    Attributes
    ----------
    controller : SupervisedController
    tuning : ControlTuning
        Active gains.

    """

    def __init__(self, robot: Robot, tuning: ControlTuning,
                 expected: Supervision = Supervision(),
                 publishers: Callable[[str], str] = lambda topic: ''):
        self.controller = SupervisedController(PendulumController(robot, tuning), expected)
        self._publishers = publishers
        self.tuning = tuning

    def retune(self, tuning: ControlTuning, expected: Supervision) -> None:
        """Apply checked gains without a jump of the torque."""
        self.controller.expected = expected
        if tuning != self.tuning:
            self.controller.retune(tuning)
            self.tuning = tuning

    @property
    def set_point(self) -> SetPoint:
        """Return the current set-point."""
        return self.controller.set_point

    @property
    def let_down(self) -> bool:
        """Return whether the set-point has timed out."""
        return self.controller.let_down

    def give(self, set_point: SetPoint, now: float, e_stop: bool) -> None:
        """
        Accept a set-point; one without a stamp has the current time.

        Raises
        ------
        MessageError
            As `SupervisedController.give` does; the current set-point remains.

        """
        self.controller.on_e_stop(e_stop)
        if set_point.stamp > now + CLOCK_SKEW_MAX:
            raise MessageError(
                f'the set-point is stamped {set_point.stamp:.3f} s and it is '
                f'{now:.3f} s here: does the sender use another clock?',
                'from_the_future', 'stamp')
        # Its age counts from now at the latest, so the timeout limits every set-point.
        stamp = min(set_point.stamp, now) if set_point.stamp else now
        self.controller.give(replace(set_point, stamp=stamp))

    def answer(self, readings: JointReadings, in_force: float, e_stop: bool) -> float:
        """
        Return the torque for an estimate, 0 while the e-stop is engaged [N m].

        Parameters
        ----------
        readings : JointReadings
            Newer than the previous ones.
        in_force : float
            Present torque of the motor [N m], from which a new mode starts.
        e_stop : bool

        """
        controller = self.controller
        if e_stop is not controller.e_stop:
            controller.on_e_stop(e_stop)
        controller.take(readings)
        return controller.answer(in_force) or 0.0

    def forget(self) -> None:
        """Stay idle until the next set-point."""
        self.controller.forget()

    def inhibit(self) -> str:
        """Return the reason against a release of the e-stop, empty for none."""
        asked = self.controller.asked
        if asked is None:
            return ''
        topic = topic_of(asked)
        names = self._publishers(topic)
        return (f'{topic} requests {asked.in_words}{f" (from {names})" if names else ""}, and the '
                'robot would jump; request rest (a set-point of 0), or nothing for half '
                'a second, then release again')
