# SPDX-License-Identifier: Apache-2.0
"""What happened in a run of which nothing was expected."""
from typing import List

from ballbot_ros.demo.timeline import NAMES, Timeline


def account(timeline: Timeline) -> List[str]:
    """Return what became of each face, and of the ball."""
    told = []
    for face in timeline.passages:
        fate = 'crossed' if face.crossed is not None else \
            'not touched' if face.touched is None else 'touched, not crossed'
        words = ', '.join(NAMES.get(kind, '?') for kind in face.decided)
        told.append(f'the {face.name} at {face.x:.2f} m: {fate}'
                    + (f'; decided: {words}' if words else ''))
    if timeline.states:
        where = f'at {timeline.states[-1].x:.2f} m'
        told.append(f'came to rest {where}' if timeline.rested is not None else
                    f'had not come to rest after {timeline.now:.1f} s, {where}')
    return told
