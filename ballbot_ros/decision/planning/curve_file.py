# SPDX-License-Identifier: Apache-2.0
"""Write a height curve as the YAML that `load_curve` reads."""
from dataclasses import asdict
import json
import textwrap
from typing import Any, Dict, Optional

import yaml

from ballbot_ros.decision.planning.curve import HeightCurve

HEADER = """\
How high a step {what}, as a cubic of the speed at touch: height = a0 + a1 v + a2 v^2 + a3 v^3, in
m and m/s.  Valid between the two speeds only: outside, the cubic means nothing and may even come
down again.

The coefficients called conservative are those of a cubic that is nowhere above the simulation.
"""
BAND = 'The band has the maximum step heights of robots drawn from the ranges of the derived ' \
    'parameters.\n'


def curve_text(curve: HeightCurve, what: str, writer: str) -> str:
    """
    Return the content of a curve file.

    Parameters
    ----------
    curve : HeightCurve
    what : str
        Such as ``GimBall crosses with a free pendulum``.
    writer : str
        What wrote it.

    """
    text = HEADER.format(what=what) + (BAND if curve.band else '') + (
        f'\nWritten by {writer}: re-simulated, the paper prints its cubic in a figure only.')
    comment = '\n#\n'.join('# ' + '\n# '.join(textwrap.wrap(part, 95))
                           for part in text.split('\n\n'))
    content = {name: value for name, value in asdict(curve).items() if value not in (None, ())}
    coefficients: Dict[str, Any] = {
        name: [round(number, 9) for number in content.pop(name)]
        for name in ('coefficients', 'conservative') if name in content}
    if 'covariance' in content:
        coefficients['covariance'] = [[float(f'{number:.4g}') for number in row]
                                      for row in content.pop('covariance')]
    made, band = content.pop('made', None), content.pop('band', None)

    def dump(part: Any, flow: Optional[bool] = None) -> str:
        lists = json.loads(json.dumps(part))  # YAML has no tuples
        return str(yaml.safe_dump(lists, sort_keys=False, default_flow_style=flow, width=99))

    blocks = [dump(content, False), dump(coefficients)]
    blocks += [dump({'made': made}, False)] if made else []
    blocks += [dump({'band': band})] if band else []
    return comment + '\n' + ''.join(blocks)
