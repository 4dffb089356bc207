# SPDX-License-Identifier: Apache-2.0
"""
The laws in the loop of the bridge: each estimate is answered at once, no topic in between.

The same objects that the node `controller` runs: set-points with their age, laws (11) and (12) and
the speed law.  Their torque goes through the `Supervisor` as a command of the very measurement
that it answers, so that it ends with the measurements.
"""
from dataclasses import replace
from typing import Callable

from ballbot_ros.control import (
    ControlTuning, JointReadings, Mode, PendulumController, SetPoint, SupervisedController,
    Supervision)
from ballbot_ros.control.command_gate import SKEW
from ballbot_ros.errors import MessageError
from ballbot_ros.physics.model.robot import Robot

# Which topic the set-points of a law come from.
TOPICS = {Mode.SPEED: 'cmd_vel'}


def topic_of(set_point: SetPoint) -> str:
    """Return the topic that a set-point has come by."""
    return TOPICS.get(set_point.mode, 'set_point')


class OnBoard:
    """
    Takes set-points and answers estimates.  All times are of the clock of the session [s].

    Parameters
    ----------
    robot : Robot
    tuning : ControlTuning
    expected : Supervision
    publishers : callable
        Returns the names of the nodes that publish on a topic, for messages to people.

    Attributes
    ----------
    controller : SupervisedController
    tuning : ControlTuning
        Gains in force.

    """

    def __init__(self, robot: Robot, tuning: ControlTuning,
                 expected: Supervision = Supervision(),
                 publishers: Callable[[str], str] = lambda topic: ''):
        """Start idle."""
        self.controller = SupervisedController(PendulumController(robot, tuning), expected)
        self._publishers = publishers
        self.tuning = tuning

    def retune(self, tuning: ControlTuning, expected: Supervision) -> None:
        """Go on with gains that were checked, without a jump of the torque."""
        self.controller.expected = expected
        if tuning != self.tuning:
            self.controller.retune(tuning)
            self.tuning = tuning

    @property
    def set_point(self) -> SetPoint:
        """Return what is followed."""
        return self.controller.set_point

    @property
    def let_down(self) -> bool:
        """Return whether nobody has renewed the set-point."""
        return self.controller.let_down

    def give(self, set_point: SetPoint, now: float, e_stop: bool) -> None:
        """
        Take a set-point; one without a stamp is of now.

        Raises
        ------
        MessageError
            As `SupervisedController.give` does; what is followed stays.

        """
        self.controller.hear_e_stop(e_stop)
        if set_point.stamp > now + SKEW:
            raise MessageError(
                'from_the_future', f'the set-point is stamped {set_point.stamp:.3f} s and it is '
                f'{now:.3f} s here: does the sender use another clock?')
        # Its age counts from now at the latest: none is followed for longer than promised.
        stamp = min(set_point.stamp, now) if set_point.stamp else now
        self.controller.give(replace(set_point, stamp=stamp))

    def answer(self, readings: JointReadings, in_force: float, e_stop: bool) -> float:
        """
        Return the torque that answers an estimate, 0 while the e-stop is engaged [N m].

        Parameters
        ----------
        readings : JointReadings
            Newer than those before.
        in_force : float
            Torque of the motor until now [N m]: where another law starts from.
        e_stop : bool

        """
        controller = self.controller
        if e_stop is not controller.e_stop:
            controller.hear_e_stop(e_stop)
        controller.take(readings)
        return controller.answer(in_force) or 0.0

    def forget(self) -> None:
        """Be idle, until another set-point comes."""
        self.controller.forget()

    def inhibit(self) -> str:
        """Return why the e-stop may not be released now, empty for nothing."""
        asked = self.controller.asked
        if asked is None:
            return ''
        topic = topic_of(asked)
        names = self._publishers(topic)
        return (f'{topic} asks for {asked.in_words}{f" (from {names})" if names else ""}, and the '
                'robot would jump; let it ask for rest (a set-point of 0) or for nothing for half '
                'a second, then release again')
