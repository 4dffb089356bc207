# SPDX-License-Identifier: Apache-2.0
"""
Stability of a sampled control loop with a delay.

A gain that is stable in continuous time may be unstable at a low rate or with a long delay.
The rolling model of `rolling_model` is discretised exactly under an input that is held and may
change within a period (`HeldInput`), and closed with the linearised law; the loop is stable if its
poles are.  To hold the pendulum down, the published gains on GimBall need 234 Hz without delay
and 468 Hz with a delay of one sample; to hold it at any angle, 275 and 548 Hz.

These rates hold while the ball rolls.  A torque above the friction limit makes the ball slip, a
bump makes it fly; then the joint drives less inertia, and law (12) needs 326 instead of 230 Hz.
Law (12) does not control the pendulum angle, so with a raised pendulum it also needs a higher
rate.  `growth_rate` covers these cases, with `rolls` false or with `set_angles`.

The torque limit turns a divergence into a limit cycle: the pendulum oscillates with full torque.
"""
import math
from typing import NamedTuple, Optional, Sequence, Tuple, Union

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.control.rolling_model import RollingModel
from ballbot_ros.control.signals import Mode
from ballbot_ros.control.speed_law import speed_law_step, SpeedLaw, SpeedState
from ballbot_ros.control.tuning import ControlTuning
from ballbot_ros.errors import ConfigurationError, UnstableLoopError
from ballbot_ros.physics.model.actuation import position_torque
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.terrain import Array

# Laws (11) and (12) do not control the speed of the ball: this nearly neutral mode, damped by
# friction only, may drift.  Growth below this [1/s] is such drift, which the source of the
# set-points must correct; the instabilities sought here grow hundreds of times faster.
DRIFT_LIMIT = 0.2

HIGHEST_RATE = 1e5      # [Hz] a loop that diverges at this rate counts as unstable at any
LOWEST_RATE = 1.0       # [Hz]
MOST_DELAY = 100        # [samples]
# With a lag, the search for a rate starts where the lag is this number of samples: a higher rate
# has no effect.
MOST_LAG = 20.0

CLOSED = (Mode.HOLD, Mode.DRIVE, Mode.SPEED)  # laws that close a loop
# Step of the differences that linearise the speed law, which is smooth within its limits.
DIFFERENCE = 1e-4


def expm(matrix: Array) -> Array:
    """Return the exponential of a small matrix, by scaling and squaring of its Taylor series."""
    # SciPy provides it, but its import takes a third of a second at each start of a node.
    squarings = max(0, math.frexp(2.0 * float(np.linalg.norm(matrix, 1)))[1])
    scaled = matrix / 2.0**squarings  # its norm is below 0.5: 16 terms are exact to rounding
    result = term = np.eye(len(matrix))
    for power in range(1, 17):
        term = term @ scaled / power
        result = result + term
    for _ in range(squarings):
        result = result @ result
    return result


class HeldInput(NamedTuple):
    """
    One period of x' = A x + b u: ``x <- step x + before u_before + after u_after``.

    This is the modified z-transform of a linear plant whose input is held and changes once within
    each period.  It is exact for any delay, also a fraction of a sample.
    """

    step: Array  # (n, n)
    before: Array  # (n,) effect of the input at the start; 0 if it changes immediately
    after: Array  # (n,) effect of the input that replaces it
    waiting: int  # number of stored inputs, the active one first: the delay, rounded up

    @classmethod
    def of(cls, matrix: Array, column: Array, rate: float, delay: float) -> 'HeldInput':
        """Return the discretisation for a rate [Hz] and a delay from sample to input [samples]."""
        size, part = len(matrix), delay - math.floor(delay)
        flow = np.zeros((size + 1, size + 1))
        flow[:size, :size], flow[:size, size] = matrix, column

        def over(share: float) -> Tuple[Array, Array]:
            held = expm(flow * share / rate)
            return held[:size, :size], held[:size, size]

        first, before = over(part)
        second, after = over(1.0 - part)
        return cls(second @ first, second @ before, after, math.ceil(delay))

    def closed(self, feedback: Array) -> Array:
        """Return the matrix of the loop with u = feedback . x, for x and the stored inputs."""
        size, waiting = len(self.step), self.waiting
        loop = np.zeros((size + waiting, size + waiting))
        loop[:size, :size] = self.step
        # The inputs before and after the change: stored ones, or the latest.
        acting = size
        if self.before.any():
            loop[:size, size] = self.before
            acting += 1
        if acting < size + waiting:
            loop[:size, acting] = self.after
        else:
            loop[:size, :size] += np.outer(self.after, feedback)
        if waiting:
            loop[size:-1, size + 1:] = np.eye(waiting - 1)
            loop[-1, :size] = feedback
        return loop


def _angles(law: Mode, tuning: ControlTuning) -> Sequence[float]:
    """
    Return the set angles to be checked.

    (11) holds any angle, (12) rolls with a hanging pendulum, the speed law holds on slopes.
    """
    if law is Mode.SPEED:
        return 0.0, 0.45 * tuning.largest_lean, 0.9 * tuning.largest_lean
    return [math.radians(degrees) for degrees in range(0, 181, 15)] if law is Mode.HOLD else [0.0]


def _check(law: Union[Mode, str], rate: float, delay: float) -> Mode:
    """Return the law; refuse rates and delays out of range."""
    if not (math.isfinite(rate) and rate > 0.0):
        raise ConfigurationError(
            f'control rate must be more than 0 Hz, got {rate!r}', 'out_of_range', 'rate')
    if not 0.0 <= delay <= MOST_DELAY:
        raise ConfigurationError(
            f'delay must be from 0 to {MOST_DELAY} samples, got {delay!r}',
            'out_of_range', 'delay')
    if law not in CLOSED:
        raise ConfigurationError(
            f"law must be 'hold' (11), 'drive' (12) or 'speed', got {law!r}: only these close a "
            'loop', 'not_a_choice', 'law')
    return Mode(law)


def _feedback(robot: Robot, tuning: ControlTuning, law: Mode, angle: float) -> Array:
    """Return d(torque)/d(phi, phi', theta1', theta2) of the law."""
    gravity = robot.largest_gravity_torque * math.cos(angle) * tuning.gravity_compensation
    if law is Mode.HOLD:
        return np.array([gravity - tuning.position_kp, -tuning.position_kd, 0.0, 0.0])
    return np.array([gravity, -tuning.velocity_kp, tuning.velocity_kp, -tuning.velocity_ki])


def loop_poles(robot: Robot, tuning: ControlTuning, law: Union[Mode, str], rate: float,
               delay: float = 0, set_angle: float = 0.0, rolls: bool = True
               ) -> NDArray[np.complex128]:
    """
    Return the poles of the sampled loop, which is stable if they are in the unit circle.

    Parameters
    ----------
    robot : Robot
    tuning : ControlTuning
    law : Mode or str
        ``'hold'``, eq. (11), ``'drive'``, eq. (12), or ``'speed'``, the speed law.
    rate : float
        Rate of the controller [Hz].
    delay : float
        Delay from reading to torque [samples]; a fraction changes the torque within a period.
    set_angle : float
        Pendulum angle about which to linearise [rad]; for the speed law, the one that holds the
        ball on a slope.
    rolls : bool
        Whether the ball rolls without slip; otherwise it slips or flies.

    Raises
    ------
    ConfigurationError
        For a rate, delay or law out of range, or a robot without a pendulum.

    """
    law, model = _check(law, rate, delay), RollingModel(robot, rolls)
    if law is Mode.SPEED:
        return np.linalg.eigvals(
            _speed_loop(model, tuning, rate, delay, set_angle)).astype(np.complex128)
    matrix, column = model.about_held(set_angle)
    # theta2 is a state only where the law depends on it: elsewhere it would add a pole at 1.
    size = 4 if law is Mode.DRIVE and tuning.velocity_ki > 0.0 else 3
    plant, torque = np.zeros((size, size)), np.zeros(size)
    plant[:3, :3], torque[:3] = matrix, column
    if size == 4:
        plant[3, 1], plant[3, 2] = 1.0, -1.0
    feedback = _feedback(robot, tuning, law, set_angle)[:size]
    loop = HeldInput.of(plant, torque, rate, delay).closed(feedback)
    return np.linalg.eigvals(loop).astype(np.complex128)


def _speed_loop(model: RollingModel, tuning: ControlTuning, rate: float, delay: float,
                set_angle: float) -> Array:
    """
    Return the loop of the speed law over law (11), about a ball at rest on a slope.

    The states are those of the ball (phi, phi', theta1'), of the law (`SpeedState`) and the
    delayed torques.  Finite differences of `speed_law_step` linearise the law.
    """
    robot = model.robot
    numbers = SpeedLaw.tuned(robot, tuning)[:]
    gravity = robot.largest_gravity_torque
    # Derivatives of phi'' and theta1'' by phi, phi', theta1' and torque.
    columns = [model.response(set_angle, *forces) for forces in (
        (-gravity * math.cos(set_angle), 0.0),
        (-robot.joint_friction, robot.joint_friction),
        (robot.joint_friction, -robot.joint_friction - robot.rolling_friction), (1.0, -1.0))]
    plant = np.zeros((3, 4))
    plant[0, 1] = 1.0
    plant[1:] = np.array(columns).T
    held = HeldInput.of(plant[:, :3], plant[:, 3], rate, delay)
    compensated = gravity * tuning.gravity_compensation
    resting = gravity * math.sin(set_angle)
    # The set angle compensates the steady-state error of law (11).
    short = (resting - compensated * math.sin(set_angle)) / tuning.position_kp
    state = SpeedState(0.0, resting, set_angle, set_angle + short, short, set_angle + short)
    rest = np.array([set_angle, 0.0, 0.0, *state, *[resting] * held.waiting])

    def step(state: Array) -> Array:
        angle, pendulum_rate, ball_rate, *others = state.tolist()
        learnt, wanted = speed_law_step(
            SpeedState(*others[:6]), -robot.ball_radius * ball_rate, angle, 0.0, math.pi / 2.0,
            1.0 / rate, numbers)
        torques = [*others[6:], position_torque(
            angle, pendulum_rate, wanted, tuning.position_kp, tuning.position_kd, compensated)]
        off = [torque - resting for torque in torques[:2]]
        moved = held.step @ np.array([angle - set_angle, pendulum_rate, ball_rate])
        if held.before.any():
            moved += held.before * off.pop(0)
        moved += held.after * off[0]
        return np.array([moved[0] + set_angle, *moved[1:], *learnt, *torques[1:]])
    return np.column_stack([
        (step(rest + shift) - step(rest - shift)) / (2.0 * DIFFERENCE)
        for shift in DIFFERENCE * np.eye(len(rest))])


def growth_rate(robot: Robot, tuning: ControlTuning, law: Union[Mode, str], rate: float,
                delay: float = 0, set_angles: Optional[Sequence[float]] = None,
                lag: float = 0.0, rolls: bool = True) -> float:
    """
    Return the growth rate of the worst deviation, negative if it decays [1/s].

    It is log(largest pole) * rate, the largest over `set_angles` [rad]; by default 0 to 180
    degrees for law (11), and for the speed law the angles that hold slopes.  Parameters as in
    `loop_poles`; `lag` [s] is an additional delay that does not depend on the rate.  With `rolls`
    false, the speed of the ball drifts, too.
    """
    samples = delay + lag * rate if lag else delay
    law = _check(law, rate, samples)
    angles = _angles(law, tuning) if set_angles is None else set_angles
    radius = max(
        float(np.abs(loop_poles(robot, tuning, law, rate, samples, angle, rolls)).max())
        for angle in angles)
    return math.log(radius) * rate


def is_stable(robot: Robot, tuning: ControlTuning, law: Union[Mode, str], rate: float,
              delay: float = 0, set_angles: Optional[Sequence[float]] = None,
              lag: float = 0.0) -> bool:
    """
    Return whether no deviation grows faster than drift; parameters as in `growth_rate`.

    This applies to small deviations from these pendulum angles; for a ball that slips see
    `growth_rate` with `rolls` false.
    """
    return growth_rate(robot, tuning, law, rate, delay, set_angles, lag) < DRIFT_LIMIT


def lowest_stable_rate(robot: Robot, tuning: ControlTuning, law: Union[Mode, str],
                       delay: float = 0, set_angles: Optional[Sequence[float]] = None,
                       lag: float = 0.0) -> float:
    """
    Return the rate above which the loop is stable [Hz]; infinity if there is none.

    The search steps down from 100 kHz, or with a lag from the rate at which that is `MOST_LAG`
    samples, and bisects the first failure to 0.01 %.  Parameters as in `growth_rate`.
    """
    high = min(HIGHEST_RATE, MOST_LAG / lag) if lag else HIGHEST_RATE
    if not is_stable(robot, tuning, law, high, delay, set_angles, lag):
        return math.inf
    low = high / 1.3
    while is_stable(robot, tuning, law, low, delay, set_angles, lag):
        if low < LOWEST_RATE:
            return LOWEST_RATE
        high, low = low, low / 1.3
    while high / low > 1.0001:
        middle = math.sqrt(high * low)
        if is_stable(robot, tuning, law, middle, delay, set_angles, lag):
            high = middle
        else:
            low = middle
    return high


def check_loop(robot: Robot, tuning: ControlTuning, law: Union[Mode, str], rate: float,
               delay: float = 1, lag: float = 0.0) -> None:
    """
    Refuse a controller whose loop diverges; parameters as in `growth_rate`.

    `UnstableLoopError` names law, gains, rate, delay, the lowest stable rate and a stable gain at
    this rate.
    """
    if is_stable(robot, tuning, law, rate, delay, None, lag):
        return
    law = Mode(law)
    names = {Mode.HOLD: ('position_kp', 'position_kd'),
             Mode.DRIVE: ('velocity_kp', 'velocity_ki'),
             Mode.SPEED: ('position_kp', 'position_kd', 'speed_gain', 'observer_rate')}[law]
    gains = ', '.join(f'{name} {getattr(tuning, name):g}' for name in names)
    late = [f'{delay:g} sample{"" if delay == 1 else "s"}'] if delay or not lag else []
    late += [f'{1e3 * lag:.2g} ms'] if lag else []
    raise UnstableLoopError(
        f'{law.law} with {gains} diverges on {robot.name} at {rate:g} Hz with '
        f'{" and ".join(late)} of delay; ' + _remedy(robot, tuning, law, rate, delay, lag),
        'unstable', 'rate')


def _remedy(robot: Robot, tuning: ControlTuning, law: Mode, rate: float, delay: float,
            lag: float) -> str:
    """Return the remedy: a rate, a gain, or a check of the gains."""
    remedies = []
    lowest = lowest_stable_rate(robot, tuning, law, delay, None, lag)
    if math.isfinite(lowest):
        remedies.append(f'run it at {math.ceil(lowest)} Hz or more')
    # The gain on the rate diverges first: it acts on the small pendulum inertia alone.
    name = {Mode.HOLD: 'position_kd', Mode.DRIVE: 'velocity_kp', Mode.SPEED: 'speed_gain'}[law]
    for percent in range(95, 0, -1):
        gain = float(f'{percent / 100 * getattr(tuning, name):.2g}')
        lowered = ControlTuning(**{**vars(tuning), name: gain})
        # With a margin of a tenth of the rate: a gain at the stability limit is undamped.
        if is_stable(robot, lowered, law, 0.9 * rate, delay, None, lag):
            remedies.append(f'lower {name} to {gain:g}')
            break
    return ' or '.join(remedies) or 'no rate makes these gains stable: see config/tunings'
