# SPDX-License-Identifier: Apache-2.0
"""
Errors and warnings of this package.

::

    BallbotError
    ├── ConfigurationError    a robot, scene, curve or parameter is not acceptable
    ├── SimulationError       a run cannot continue; names time, quantity and remedy
    ├── UnstableLoopError     a control law would diverge at the given rate
    ├── MessageError          a command, set-point or observation is refused
    ├── LinkError             the serial line cannot be opened, or has failed
    ├── DriveError            the motor controller does not respond correctly
    ├── EstimateLostError     the readings of the sensors contradict each other
    └── RefusedError          a request is refused because it is not safe now

Each message names the error, the value, the allowed range and the remedy.

    >>> from ballbot_ros.physics import load_robot
    >>> try:
    ...     robot = load_robot('gimbal')
    ... except BallbotError as error:
    ...     print(str(error)[:32])
    there is no robot named 'gimbal'
"""
from typing import Any, Sequence


class BallbotError(Exception):
    """
    Base of all errors of this package; catch this to catch them all.

    Attributes
    ----------
    reason : str
        Code of the cause, for counters, decisions and tests: ``'out_of_range'``, ``'stale'``, ...
    field : str
        Name of the refused field, parameter, option or joint; empty if there is none.

    """

    reason = 'error'
    field = ''

    def __reduce__(self) -> Any:
        """Return a copy for another process: the message and all attributes."""
        return Exception.__new__, (type(self), *self.args), vars(self)


class _ErrorWithReason(BallbotError):
    """An error that is always raised with a reason code and a field."""

    def __init__(self, explanation: str, reason: str, field: str):
        super().__init__(explanation)
        self.reason = reason
        self.field = field


class ConfigurationError(_ErrorWithReason, ValueError):
    """
    A value in a file, on a command line or in a parameter is not acceptable.

    Attributes
    ----------
    reason : str
        ``'unknown_name'``, ``'missing'``, ``'wrong_type'``, ``'not_a_choice'``,
        ``'out_of_range'``, ``'not_finite'``, ``'inconsistent'`` (with another value),
        ``'unreadable'`` (a file or its syntax), ``'wrong_kind'`` (of a file), ``'exists'`` (a
        file that would be overwritten), ``'not_writable'``, ``'not_installed'``, ``'ambiguous'``
        (several match), ``'unavailable'`` (now, on this machine) or ``'unsupported'``.
    problems : tuple of ConfigurationError
        The errors of a file that has several; empty for a single error.

    """

    problems: tuple['ConfigurationError', ...] = ()

    def at(self, place: str) -> 'ConfigurationError':
        """Return the error with a location, for instance a file, in front of its message."""
        if self.problems:
            return ConfigurationError.of([problem.at(place) for problem in self.problems])
        message = str(self).removeprefix(f'{place.rpartition(": ")[2]}: ')
        return ConfigurationError(f'{place}: {message}', self.reason, self.field)

    @classmethod
    def of(cls, problems: Sequence['ConfigurationError']) -> 'ConfigurationError':
        """Combine several errors into one, with reason and field of the first one."""
        if len(problems) == 1:
            return problems[0]
        error = cls('; '.join(map(str, problems)), problems[0].reason, problems[0].field)
        error.problems = tuple(problems)
        return error


class PlausibilityWarning(UserWarning):
    """A value is allowed but physically implausible; the message names the likely unit."""


class SimulationError(_ErrorWithReason, ArithmeticError):
    """
    A simulation cannot continue.

    Attributes
    ----------
    reason : str
        ``'not_finite'``, ``'penetrated'`` (centre of the ball under the ground),
        ``'step_too_small'``, ``'over_budget'``, ``'unbalanced'`` (energy), ``'unconfirmed'`` (no
        other run agrees), ``'inaccurate'`` (steps too long) or ``'out_of_range'``.
    field : str
        State or setting concerned.
    time : float
        Simulated time of the failure [s].
    quantity : str
        Cause of the failure, for instance ``'ball_rate is not finite'``.
    remedy : str
        Advice to the user.
    trajectory : Trajectory or None
        The part of the run before the failure, if recorded.

    """

    trajectory: Any = None

    def __init__(self, time: float, quantity: str, remedy: str, reason: str, field: str):
        super().__init__(
            f'simulation stopped at t = {time:.6g} s: {quantity}; {remedy}', reason, field)
        self.time = time
        self.quantity = quantity
        self.remedy = remedy


class UnstableLoopError(_ErrorWithReason, ValueError):
    """
    A control loop is unstable at the given rate and delay.

    Attributes
    ----------
    reason : str
        ``'unstable'``.
    field : str
        Rate that is too low for the gains, or baud rate that is too low for the control rate.

    """


class MessageError(_ErrorWithReason, ValueError):
    """
    A message is refused.

    Attributes
    ----------
    reason : str
        One word for counters: ``'not_finite'``, ``'wrong_length'``, ``'stale'``, ...

    """


class LinkError(_ErrorWithReason, OSError):
    """
    The line to the motor controller cannot be opened or no longer transfers bytes.

    Attributes
    ----------
    reason : str
        One word for counters and for the choice of a remedy: ``'missing'``, ``'permission'``,
        ``'busy'``, ``'not_a_port'``, ``'bad_address'``, ``'bad_baud'`` when opening;
        ``'gone'`` (unplugged), ``'stuck'`` (accepts no bytes) or ``'closed'`` later.

    """


class DriveError(_ErrorWithReason):
    """
    The line is open, but the motor controller does not work as required.

    Attributes
    ----------
    reason : str
        One word: ``'silent'``, ``'late'`` (valid replies arrive too late), ``'garbled'``
        (undecodable bytes: wrong baud rate or noise), ``'wrong_protocol'``, ``'firmware'``,
        ``'not_armed'``, ``'not_stopped'``, ``'not_clearable'`` (faults) or ``'no_voltage'`` (the
        supply voltage is unknown).

    """


class EstimateLostError(_ErrorWithReason, ArithmeticError):
    """
    The state of the robot can no longer be estimated from its sensors.

    Attributes
    ----------
    reason : str
        ``'diverged'``, ``'encoder_jumps'``, ``'encoder_velocity'`` or ``'joint_torque'``: what
        contradicts the estimate.
    field : str
        ``'encoder'`` or ``'pendulum_angle'``.

    """


class RefusedError(_ErrorWithReason):
    """
    A request, for instance to release the e-stop, is refused because it is not safe now.

    Attributes
    ----------
    reason : str
        One word: ``'standing'`` (after an e-stop), ``'busy'``, ``'missing'``, ``'out_of_range'``,
        ``'not_finite'``, ``'not_writable'``, ``'timeout'``, ``'failed'``, ``'cancelled'``, or
        ``'refused'``, for instance by another node.

    """
