# SPDX-License-Identifier: Apache-2.0
"""
Calibrate direction, encoder scale and torque factor of a pendulum motor, with an operator.

The shell is fixed, so that the joint angle is the pendulum angle.  First the operator turns the
pendulum by a known angle while the motor has no power, which gives direction and encoder scale.
Then the motor lifts it a little, forward and back, with a slowly rising torque; at rest, gravity
balances the torque::

    torque_factor * requested torque = M2 g e sin(angle) +- friction

The factor is the slope over both directions, so friction cancels.  Errors of M2 and e in the robot
file scale it: only the torque against gravity is observable.
"""
import math
from typing import List, NamedTuple, Protocol, Tuple

import numpy as np

from ballbot_ros.bridge.hardware_file import Hardware
from ballbot_ros.bridge.motor_state import MEASUREMENT_AGE_MAX
from ballbot_ros.drives.driver import Driver
from ballbot_ros.errors import RefusedError
from ballbot_ros.physics.model.robot import Robot

# Number of steps of the lift to each side, and its largest angle [rad].
STEPS, LIFT_ANGLE_MAX = 3, 0.5
# Rate [rad/s] and angle [rad] above which the motor is stopped.
FASTEST, FURTHEST = 4.0, 1.0
# Period of the commands, and duration of torque ramp, settling and measurement [s].
PERIOD, RAISE, SETTLE, LOOK = 0.01, 1.0, 1.5, 0.5
# Smallest accepted turn by hand, as a fraction of the requested one.
LEAST_TURN = 0.3
# Smallest relative deviation from the file that is reported.
REPORTED_DEVIATION = 0.1
SMALLEST_TURN, LARGEST_TURN = 6.0, 400.0  # by hand [degrees]


class Dialogue(Protocol):
    """Dialogue with the operator."""

    def say(self, text: str) -> None:
        """Inform the operator."""

    def ask(self, question: str) -> str:
        """Return the reply; raise `RefusedError` if the operator cancels."""


class Calibration(NamedTuple):
    direction: int
    encoder_scale: float  # turns of the joint per reported turn of the drive
    torque_factor: float  # actual over requested torque
    torque_factor_sd: float
    friction: float  # of the joint [N m]


class Calibrator:
    """
    Calibrates one motor through the driver of an identified, stopped drive.

    The hardware file is the uncalibrated one; its gear ratio converts the torque.
    """

    def __init__(self, hardware: Hardware, robot: Robot, driver: Driver, dialogue: Dialogue):
        self._joint, self._driver, self._dialogue = hardware.joint, driver, dialogue
        self._limit = hardware.limits.torque_limit
        self._gravity_torque = robot.largest_gravity_torque

    def run(self) -> Calibration:
        """
        Run the calibration, and disable motor power at the end, also after an error.

        Raises `RefusedError` if the operator cancels or the motor exceeds a limit, `LinkError` or
        `DriveError` if the drive is lost.
        """
        say, ask = self._dialogue.say, self._dialogue.ask
        say('Secure the shell so that it cannot roll, keep clear of the pendulum, and keep a hand '
            'on the battery switch.  Ctrl-C or "q" ends the calibration at any time.')
        while (answer := ask('Ready? [yes/no/q]').strip().lower()) not in ('yes', 'y'):
            if answer in ('no', 'n'):
                raise RefusedError('calibration ended: secure the shell; nothing was changed',
                                   'cancelled', 'shell')
            say(f'{answer!r} is neither yes nor no.')
        try:
            direction, scale = self._turn_by_hand()
            say('The motor will now lift the pendulum slowly to '
                f'{math.degrees(LIFT_ANGLE_MAX):.0f} degrees, forward and back.')
            self._enter('Hands off. Press Enter to start')
            self._driver.arm()
            torques, angles = self._lift(direction * scale)
        finally:
            self._driver.stop()
        factor, sd, friction = fit(torques, angles, self._gravity_torque)
        say(f'torque_factor {factor:.3f} +- {sd:.3f}, friction {friction:.3f} N m')
        return Calibration(direction, scale, factor, sd, friction)

    def _turn_by_hand(self) -> Tuple[int, float]:
        """Return direction and encoder scale."""
        say = self._dialogue.say
        self._enter('Let the pendulum hang straight down, at rest. Press Enter')
        before = self._position()
        turned = self._ask_angle(
            'Turn it by hand forward (to +x, as it swings to drive forward) until it is level and '
            'hold it there. Press Enter, or give the angle in degrees if it is not 90')
        moved = self._position() - before
        expected = turned / self._joint.scale
        if abs(moved) < LEAST_TURN * expected:
            raise RefusedError(
                f'the drive reported {math.degrees(moved):.1f} degrees at its shaft, but about '
                f'{math.degrees(expected):.0f} were expected: is the encoder connected, does the '
                'pinion engage, is gear_ratio correct?', 'failed', 'gear_ratio')
        scale = turned / abs(moved)
        if abs(scale / self._joint.scale - 1.0) > REPORTED_DEVIATION:
            say(f'That is {scale:.5f} joint turns per turn of the drive; the file has '
                f'{self._joint.scale:.5f}.  If you turned it by {math.degrees(turned):.0f} '
                'degrees, the file was wrong.')
        self._enter('Let it hang at rest again. Press Enter')
        self._zero = self._position()
        return (1 if moved > 0.0 else -1), scale

    def _enter(self, question: str) -> None:
        """Wait for Enter alone; any other input repeats the question."""
        while answer := self._dialogue.ask(question).strip():
            self._dialogue.say(f'Enter alone continues, "q" ends it; got {answer!r}.')

    def _ask_angle(self, question: str) -> float:
        """Return an angle [rad], a right angle for Enter; invalid input repeats the question."""
        while True:
            answer = self._dialogue.ask(question).strip()
            try:
                degrees = float(answer) if answer else 90.0
            except ValueError:
                self._dialogue.say(f'An angle in degrees is expected, got {answer!r}.')
                continue
            if SMALLEST_TURN <= degrees <= LARGEST_TURN:
                return math.radians(degrees)
            self._dialogue.say(f'The angle must be {SMALLEST_TURN:g} to {LARGEST_TURN:g} degrees, '
                               f'got {degrees:g}.')

    def _lift(self, scale: float) -> Tuple[List[float], List[float]]:
        """Return requested torques and joint angles at rest; `scale` has a sign."""
        top = min(0.9 * self._limit, self._gravity_torque * math.sin(LIFT_ANGLE_MAX))
        levels = [top * step / STEPS for step in (*range(1, STEPS + 1), *range(STEPS - 1, 0, -1))]
        torques, angles = [], []
        requested = 0.0
        for level in (*levels, *(-level for level in levels)):
            angle = self._hold(requested, level, scale)
            requested = level
            if abs(level) == top and angle * level < 0.0:
                raise RefusedError(
                    'torque and encoder have opposite signs: a positive torque turned the shaft '
                    'back.  Every control loop would be unstable.  Calibrate the encoder with the '
                    "maker's tool, or swap the leads of a brushed motor; then start again",
                    'failed', 'encoder')
            torques.append(level)
            angles.append(angle)
        return torques, angles

    def _hold(self, initial: float, torque: float, scale: float) -> float:
        """Change the torque slowly, wait until the pendulum rests, and return its angle."""
        driver = self._driver
        start = measured = driver.clock()
        seen: List[float] = []
        while (now := driver.clock()) - start < RAISE + SETTLE + LOOK:
            part = min((now - start) / RAISE, 1.0)
            requested = initial + part * (torque - initial)
            driver.send_torque(math.copysign(1.0, scale) * requested / self._joint.torque_ratio)
            self._wait(now + PERIOD)
            telemetry = driver.telemetry
            if telemetry.faults:
                raise RefusedError(f'the drive reports {", ".join(telemetry.faults)}',
                                   'failed', 'drive')
            measured = max(measured, telemetry.measured or 0.0)
            if driver.clock() - measured > MEASUREMENT_AGE_MAX:
                raise RefusedError(
                    'stopped: the drive has not reported the position of its shaft for '
                    f'{MEASUREMENT_AGE_MAX:g} s; check the line', 'missing', 'encoder')
            angle = scale * ((telemetry.position or 0.0) - self._zero)
            rate = scale * (telemetry.velocity or 0.0)
            if abs(angle) > FURTHEST or abs(rate) > FASTEST:
                raise RefusedError(
                    f'stopped: the pendulum was at {math.degrees(angle):.0f} degrees and '
                    f'{rate:.1f} rad/s, more than {math.degrees(FURTHEST):.0f} degrees or '
                    f'{FASTEST:g} rad/s; is torque_limit too high, or the shell not secured?',
                    'failed', 'pendulum_angle' if abs(angle) > FURTHEST else 'pendulum_rate')
            if now - start > RAISE + SETTLE:
                seen.append(angle)
        return float(np.mean(seen))

    def _position(self) -> float:
        """Request and return the position of the shaft [rad]."""
        driver = self._driver
        start = driver.clock()
        while (driver.telemetry.time or -math.inf) <= start:
            if driver.clock() - start > 1.0:
                raise RefusedError('the drive does not report the position of its shaft',
                                   'missing', 'encoder')
            driver.ask()
            self._wait(driver.clock() + PERIOD)
        return driver.telemetry.position or 0.0

    def _wait(self, until: float) -> None:
        while (left := until - self._driver.clock()) > 0.0:
            self._driver.line.wait(left)
            self._driver.poll()


def fit(torques: List[float], angles: List[float], gravity_torque: float
        ) -> Tuple[float, float, float]:
    """
    Return torque factor, its standard deviation, and friction [N m].

    `torques` are those requested, up and down on both sides [N m], `angles` the rest angles of the
    pendulum [rad]; `gravity_torque` is M2 g e [N m].  Raises `RefusedError` if the pendulum moved
    too little.
    """
    requested, lifted = np.array(torques), gravity_torque * np.sin(np.array(angles))
    if np.abs(lifted).max() < 0.1 * np.abs(requested).max():
        raise RefusedError(
            'the pendulum barely moved: friction holds it, or the torque does not reach it; '
            'raise torque_limit, or check motor and gear', 'failed', 'torque_limit')
    # Friction has the sign of the preceding motion: plus on the way up, minus on the way down.
    moving = np.sign(np.diff(requested, prepend=0.0))
    columns = np.column_stack([requested, -moving])
    found, _, _, _ = np.linalg.lstsq(columns, lifted, rcond=None)
    rest = lifted - columns @ found
    variance = float(rest @ rest) / max(1, len(requested) - 2)
    sd = math.sqrt(variance * float(np.linalg.inv(columns.T @ columns)[0, 0]))
    return float(found[0]), sd, float(found[1])
