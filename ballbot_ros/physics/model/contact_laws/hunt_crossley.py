# SPDX-License-Identifier: Apache-2.0
"""
The law of Hunt and Crossley with the exponent 1: ``N = k p (1 - lambda v)``.

Its damping grows with the penetration, so that the force starts without a jump, and the
restitution depends on the speed.  See `contact_laws` for the contract.

Reference: K. H. Hunt, F. R. E. Crossley, Coefficient of Restitution Interpreted as Damping in
Vibroimpact, J. Appl. Mech. 42 (1975) 440.
"""
from ballbot_ros.jit import compiled
from ballbot_ros.physics.model.robot import Parameters

LEAVES_FREELY = False  # no multiple of the velocity bounds the force on a released ball


@compiled
def damper(penetration: float, velocity: float,
           parameters: Parameters) -> tuple[float, float, float]:
    """Return the force of the damper [N] and its slopes [N/m], [N s/m]."""
    damping = parameters.dissipation * penetration
    return damping * velocity, parameters.dissipation * velocity, damping


@compiled
def damping_bound(deepest: float, fastest: float,
                  parameters: Parameters) -> tuple[float, float]:
    """Return 0, as all damping depends on the penetration, and the minimum of -k lambda p v."""
    return 0.0, -parameters.dissipation * max(deepest, 0.0) * max(fastest, 0.0)
