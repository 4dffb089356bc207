# SPDX-License-Identifier: Apache-2.0
"""
The contact law of the paper, eq. (7): a spring and a damper, ``N = k p - kd v``.

See `contact_laws` for the contract.
"""
from ballbot_ros.jit import compiled
from ballbot_ros.physics.model.robot import Parameters


@compiled
def damper(_penetration: float, velocity: float,
           parameters: Parameters) -> tuple[float, float, float]:
    """Return the force of the damper [N] and its slopes [N/m], [N s/m]."""
    return parameters.damping * velocity, 0.0, parameters.damping


@compiled
def linear_damping(parameters: Parameters) -> float:
    """Return the damping [N s/m]."""
    return parameters.damping


@compiled
def least_remainder(_deepest: float, _fastest: float, _parameters: Parameters) -> float:
    """Return 0: the law is linear [N]."""
    return 0.0


@compiled
def leaves_freely(_parameters: Parameters) -> bool:
    """Return True: a multiple of the velocity bounds the force on a released ball."""
    return True
