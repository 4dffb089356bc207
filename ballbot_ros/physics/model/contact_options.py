# SPDX-License-Identifier: Apache-2.0
"""Choices in the contact law where the paper leaves one, or can be improved on."""
from dataclasses import dataclass

from ballbot_ros.config.fields import Checked, flag, text


@dataclass(frozen=True, repr=False)
class ContactOptions(Checked):
    """
    How eqs. (7)-(10) are read.

    The literal paper is ``ContactOptions(pulling=True, slip_lever='radius')``.
    """

    pulling: bool = flag(
        'let the damper of eq. (7) pull the ball back to the ground when it rebounds, as the '
        'printed equation does; otherwise the normal force is never negative', default=False)
    friction_ramp: str = text(
        'shape of mu_scale in eq. (9): linear, or a smooth cubic',
        default='linear', choices=('linear', 'smooth'))
    slip_lever: str = text(
        'lever in the slip of eq. (8): the distance from centre to contact, as in eq. (10), so '
        'that friction can only take energy; or the full radius, as printed',
        default='contact', choices=('contact', 'radius'))
