# SPDX-License-Identifier: Apache-2.0
"""
The contact law of the paper, eq. (7): a spring and a damper, ``N = k p - kd v``.

See `contact_laws` for the contract.
"""
from ballbot_ros.jit import compiled
from ballbot_ros.physics.model.robot import Parameters

LEAVES_FREELY = True  # a multiple of the velocity bounds the force on a released ball


@compiled
def damper(_penetration: float, velocity: float,
           parameters: Parameters) -> tuple[float, float, float]:
    """Return the force of the damper [N] and its slopes [N/m], [N s/m]."""
    return parameters.damping * velocity, 0.0, parameters.damping


@compiled
def damping_bound(_deepest: float, _fastest: float,
                  parameters: Parameters) -> tuple[float, float]:
    """Return the damping [N s/m], and 0: the law is linear."""
    return parameters.damping, 0.0
