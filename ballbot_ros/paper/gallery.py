# SPDX-License-Identifier: Apache-2.0
"""All pictures that `ballbot figures` draws, by name; a line here makes it known."""
from typing import Callable, Mapping

from matplotlib.figure import Figure

from ballbot_ros.figures import command_loss, oblique, turning
from ballbot_ros.paper import contact_laws, design, figures as paper, pulled_plug

# Name -> what draws it; it reports a progress from 0 to 1.
FIGURES: Mapping[str, Callable[..., Figure]] = {
    'fig5': paper.figure_5, 'fig6': paper.figure_6, 'fig7': paper.figure_7,
    'fig8': paper.figure_8, 'tornado': design.tornado, 'probability': design.probability,
    'design': design.design, 'slope': design.slope, 'over': design.over,
    'contact_law': contact_laws.contact_law,
    'on_timeout': command_loss.on_timeout, 'black_box': pulled_plug.black_box,
    'turning': turning.turning, 'oblique': oblique.oblique}
