# SPDX-License-Identifier: Apache-2.0
"""
The contact laws.  To add one, add its file here, and its name to `robot.CONTACT_LAWS`.

The normal force of a contact with the penetration p [m] is ``N = k p - D``, for a velocity v of
the ball away from the ground [m/s].  Equilibrium, stored energy and time scale of a contact depend
only on the spring; a law defines the damper D.  Its file has two kernels, whose last argument is
`Parameters`, and a constant::

    damper(p, v, parameters) -> D, by_p, by_v

the force before any limit [N], and its derivatives [N/m], [N s/m];

    damping_bound(deepest, fastest, parameters) -> d, bound

where ``-D >= bound - d v`` for 0 <= p <= deepest and v <= fastest, which is used to prove that a
step contains no event; and

    LEAVES_FREELY

whether a released ball that still overlaps the ground leaves it as `flight.clear_time` assumes:
with a force bounded by a multiple of v.  A law with an additional parameter declares it in
`Robot` and `Parameters`.
"""
from importlib import import_module

import numpy as np

from ballbot_ros.jit import by_number
from ballbot_ros.physics.model.robot import CONTACT_LAWS

LAWS = [import_module(f'{__name__}.{name}') for name in CONTACT_LAWS]

# Their first argument is `Parameters.law`.
damper = by_number('damper', LAWS)
damping_bound = by_number('damping_bound', LAWS)
LEAVES_FREELY = np.array([law.LEAVES_FREELY for law in LAWS])
