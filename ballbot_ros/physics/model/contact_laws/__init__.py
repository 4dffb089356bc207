# SPDX-License-Identifier: Apache-2.0
"""
The contact laws.  To add one, add its file here, and its name to `robot.CONTACT_LAWS`.

The normal force of a contact with the penetration p [m] is ``N = k p - D``, for a velocity v of
the ball away from the ground [m/s].  Equilibrium, stored energy and time scale of a contact depend
only on the spring; a law defines the damper D.  Its file has four kernels, whose last argument is
`Parameters`::

    damper(p, v, parameters) -> D, by_p, by_v

the force before any limit [N], and its derivatives [N/m], [N s/m];

    linear_damping(parameters) -> d
    least_remainder(deepest, fastest, parameters) -> bound

where ``-D >= bound - d v`` for 0 <= p <= deepest and v <= fastest, which is used to prove that a
step contains no event; and

    leaves_freely(parameters) -> bool

whether a released ball that still overlaps the ground leaves it as `flight.clear_time` assumes:
with a force bounded by a multiple of v.  A law with an additional parameter declares it in
`Robot` and `Parameters`.
"""
from importlib import import_module

from ballbot_ros.jit import by_number
from ballbot_ros.physics.model.robot import CONTACT_LAWS

LAWS = [import_module(f'{__name__}.{name}') for name in CONTACT_LAWS]

damper = by_number('damper', 'law', LAWS)
linear_damping = by_number('linear_damping', 'law', LAWS)
least_remainder = by_number('least_remainder', 'law', LAWS)
leaves_freely = by_number('leaves_freely', 'law', LAWS)
