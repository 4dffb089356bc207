# SPDX-License-Identifier: Apache-2.0
"""What the node ``simulator`` says of itself on /diagnostics."""
import math
from typing import Optional

from ballbot_ros.control import CommandGate
from ballbot_ros.nodes.simulator.laws_inside import LawsInside
from ballbot_ros.nodes.simulator.scheduler import Scheduler
from ballbot_ros.plant import Plant
from ballbot_ros.ros import diagnostics
from ballbot_ros.ros.settings import SimulatorSettings


def health(settings: SimulatorSettings, plant: Plant, scheduler: Scheduler, gate: CommandGate,
           laws: Optional[LawsInside]) -> diagnostics.Health:
    """Return level, message and numbers."""
    values = {
        'simulated_time': f'{plant.time:.3f}', 'scene': settings.scene,
        'real_time_factor': f'{scheduler.real_time_factor:.3f}',
        'periods_dropped': scheduler.dropped,
        'commands_accepted': gate.accepted,
        'error_estimate': f'{plant.error_estimate:.1e}',
        **diagnostics.refusals('commands', gate.refused)}
    if laws is not None:
        values.update(laws.values, set_points_refused=sum(laws.refused.values()))
    if scheduler.failure is not None:
        return diagnostics.ERROR, str(scheduler.failure), values
    if plant.lost_at < math.inf:
        return diagnostics.WARN, (
            f'the accuracy of {settings.accuracy:g} m holds up to '
            f't = {plant.lost_at:.3f} s only: the motion is chaotic'), values
    if scheduler.paused:
        return diagnostics.OK, 'paused', values
    if gate.refused:
        return diagnostics.WARN, 'running; commands were refused', values
    return diagnostics.OK, 'running', values
