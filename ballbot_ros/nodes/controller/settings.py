# SPDX-License-Identifier: Apache-2.0
"""The parameters of the node: name, unit, range, default and meaning."""
from dataclasses import dataclass, replace

from ballbot_ros.config.fields import count, fixed, live, quantity
from ballbot_ros.control import ControlTuning, load_tuning, Supervision
from ballbot_ros.ros.settings import file_in, LoopNumbers, numbers_in, Settings


@dataclass(frozen=True)
class ControllerSettings(Settings):
    """Parameters of the node ``controller``."""

    robot: str = fixed('the laws are created for it', file_in('robots', 'gimball'))
    tuning: str = live(file_in('tunings', 'published'))
    torque_limit: float = live(quantity(
        'N m', 'largest requested torque; 0 for that of the tuning', default=0.0, minimum=0.0,
        maximum=1000.0))
    rate: float = live(quantity(
        'Hz', 'rate of joint_states for which the stability of the loop is checked',
        default=500.0, minimum=1.0, maximum=100000.0))
    delay: int = live(count(
        'samples between a state and the torque that answers it; 0 for the simulator, which '
        'applies the torque over the period that begins with the state', default=0, maximum=10))
    state_timeout: float = live(quantity(
        's', 'wall time without a joint state after which the torque is set to 0', default=0.1,
        minimum=0.005, maximum=10.0))
    set_point_timeout: float = live(quantity(
        's', 'age of a set-point, on the clock of the joint states, after which the pendulum is '
        'lowered; 0 for never', default=0.5, minimum=0.0, maximum=3600.0))
    lockstep_set_point_period: float = live(quantity(
        's', 'period of set-points in lockstep: each state is answered with the set-point of its '
        'own period, so that runs are bit-identical; 0 to use the latest set-point', default=0.0,
        minimum=0.0, maximum=10.0))
    gains: ControlTuning = numbers_in('tuning', ControlTuning, load_tuning, 'gains.')

    @property
    def loop(self) -> LoopNumbers:
        """Return rate, delay and the gains with the torque limit in force."""
        limit = self.torque_limit
        gains = self.gains if limit == 0.0 else replace(self.gains, torque_limit=limit)
        return LoopNumbers(gains, self.rate, self.delay)

    @property
    def supervision(self) -> Supervision:
        """Return the requirements on the publishers."""
        return Supervision(set_point_timeout=self.set_point_timeout,
                           set_point_period=self.lockstep_set_point_period)
