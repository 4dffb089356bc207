# SPDX-License-Identifier: Apache-2.0
"""The step ahead on the height-speed curve, as a picture and a sentence."""
from html import escape
import math
from typing import Callable, List, NamedTuple, Optional

import numpy as np

from ballbot_ros.decision.planning.curve import HeightCurve
from ballbot_ros.figures.canvas import BLUE, GREEN, GREY, INK, VERMILION
from ballbot_ros.view.frame import Frame
from ballbot_ros.view.ground import step_ahead
from ballbot_ros.view.source import Source

WIDTH, HEIGHT = 320, 190  # [px]
LEFT, RIGHT, TOP, BOTTOM = 42, 10, 10, 34
Scale = Callable[[float], float]


class Prospect(NamedTuple):
    """How the robot stands to the step ahead; None for what nobody knows."""

    speed: Optional[float] = None  # of the centre, towards the step [m/s]
    height: Optional[float] = None  # of the step ahead [m]
    distance: Optional[float] = None  # from the centre to its face [m]
    touch_speed: Optional[float] = None  # at which a decision expects or wants the touch [m/s]
    at_it: bool = False  # closer than a radius: the speed is no more that of the touch


def prospect_of(source: Source, frame: Frame) -> Prospect:
    """Return what is known, from the decision where it says so, else from the ground."""
    speed = None if frame.velocity_x is None else abs(frame.velocity_x)
    decision = frame.decision
    if decision is not None and decision.height is not None:
        return Prospect(speed, decision.height, decision.distance, decision.speed)
    if source.terrain is None or frame.x is None:
        return Prospect(speed)
    ahead = step_ahead(source.terrain, frame.x, source.robot.ball_radius)
    if ahead is None:
        return Prospect(speed)
    distance = ahead.x - frame.x
    return Prospect(speed, ahead.height, distance, at_it=distance < source.robot.ball_radius)


def verdict(curve: Optional[HeightCurve], prospect: Prospect) -> str:
    """Return in a sentence what the curve says of the step ahead at the present speed."""
    if prospect.height is None:
        return 'No step ahead.'
    where = '' if prospect.distance is None else f', {prospect.distance:.2f} m ahead'
    step = f'{"Step" if prospect.height > 0.0 else "Drop"} of ' \
        f'{abs(1e3 * prospect.height):.0f} mm{where}'
    if prospect.at_it:
        return f'{step}: the ball is at it.'
    if prospect.height < 0.0:
        return f'{step}.'
    if curve is None:
        return f'{step}. There is no height curve for these numbers of the robot and this law.'
    needed = curve.required_speed(prospect.height)
    if needed is None:
        highest = 1e3 * curve.height(curve.highest_speed)
        return f'{step}: higher than the {highest:.0f} mm that the curve ends with.'
    if prospect.speed is None:
        return f'{step}: takes {needed:.2f} m/s at the touch.'
    verb = 'fast enough' if prospect.speed >= needed else 'too slow'
    return f'{step}: takes {needed:.2f} m/s at the touch; now {prospect.speed:.2f} m/s, {verb}.'


def draw(curve: Optional[HeightCurve], prospect: Prospect) -> str:
    """Return the picture as SVG: heights that are crossed below the curve, the step as a dot."""
    fastest = max(1.2, 1.05 * (prospect.speed or 0.0), curve.highest_speed if curve else 0.0)
    highest = max(0.06, 1.15 * max(prospect.height or 0.0, 0.0),
                  1.1 * curve.height(curve.highest_speed) if curve else 0.0)

    def across(speed: float) -> float:
        return LEFT + (WIDTH - LEFT - RIGHT) * speed / fastest

    def down(height: float) -> float:
        return HEIGHT - BOTTOM - (HEIGHT - BOTTOM - TOP) * height / highest
    parts = _axes(fastest, highest, across, down)
    if curve is not None:
        speeds = np.linspace(curve.lowest_speed, curve.highest_speed, 40)
        line = ' '.join(f'{across(speed):.1f},{down(curve.height(float(speed))):.1f}'
                        for speed in speeds)
        ends = [f'{across(curve.highest_speed):.1f},{down(0.0):.1f}',
                f'{across(curve.lowest_speed):.1f},{down(0.0):.1f}']
        parts.append(f'<polygon points="{line} {" ".join(ends)}" fill="{GREEN}" opacity="0.12"/>')
        parts.append(f'<polyline points="{line}" fill="none" stroke="{GREEN}" stroke-width="2"/>')
        parts.append(_text(across(curve.highest_speed) - 4, down(0.0) - 6, 'crossed', GREEN,
                           'end'))
    parts += _marks(curve, prospect, across, down)
    return (f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" width="100%" role="img" '
            f'style="font:11px system-ui,sans-serif">{"".join(parts)}</svg>')


def _marks(curve: Optional[HeightCurve], prospect: Prospect, across: Scale,
           down: Scale) -> List[str]:
    """Return the step ahead at the present speed, and at that of the touch."""
    if prospect.speed is None:
        return []
    height = prospect.height if prospect.height is not None and prospect.height > 0.0 else None
    x = across(prospect.speed)
    if height is None:
        return [f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{TOP}" y2="{down(0.0):.1f}" '
                f'stroke="{BLUE}" stroke-width="1.5"/>', _text(x + 4, TOP + 10, 'now', BLUE)]
    needed = curve.required_speed(height) if curve else None
    good = needed is not None and prospect.speed >= needed
    colour = BLUE if curve is None or prospect.at_it else GREEN if good else VERMILION
    y = down(height)
    parts = [f'<line x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{y:.1f}" y2="{y:.1f}" stroke="{INK}" '
             'stroke-dasharray="4 3"/>',
             _text(WIDTH - RIGHT, y - 5, f'step ahead, {1e3 * height:.0f} mm', INK, 'end')]
    if prospect.touch_speed is not None and math.isfinite(prospect.touch_speed):
        parts.append(f'<circle cx="{across(prospect.touch_speed):.1f}" cy="{y:.1f}" r="5" '
                     f'fill="none" stroke="{INK}" stroke-width="1.5"/>')
    parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="5" fill="{colour}"/>')
    parts.append(_text(x, y + 17, 'now', colour, 'middle'))
    return parts


def _axes(fastest: float, highest: float, across: Scale, down: Scale) -> List[str]:
    """Return both axes with their numbers."""
    parts = [f'<path d="M{LEFT},{TOP} V{HEIGHT - BOTTOM} H{WIDTH - RIGHT}" fill="none" '
             f'stroke="{GREY}"/>']
    for tick in _ticks(fastest):
        parts.append(_text(across(tick), HEIGHT - BOTTOM + 13, f'{tick:g}', GREY, 'middle'))
    for tick in _ticks(1e3 * highest):
        y = down(1e-3 * tick)
        parts.append(f'<path d="M{LEFT},{y:.1f} H{WIDTH - RIGHT}" stroke="{GREY}" '
                     'opacity="0.15"/>')
        parts.append(_text(LEFT - 5, y + 4, f'{tick:g}', GREY, 'end'))
    parts.append(_text((LEFT + WIDTH - RIGHT) / 2, HEIGHT - 5, 'speed at the touch [m/s]', INK,
                       'middle'))
    parts.append(f'<g transform="translate(11 {(TOP + HEIGHT - BOTTOM) / 2}) rotate(-90)">'
                 f'{_text(0, 0, "step height [mm]", INK, "middle")}</g>')
    return parts


def _ticks(highest: float) -> List[float]:
    """Return three to six round numbers from 0."""
    step = 10.0 ** math.floor(math.log10(highest))
    for part in (1.0, 0.5, 0.2):
        if highest / (part * step) >= 3.0:
            step *= part
            break
    else:
        step *= 0.2
    return [round(step * index, 6) for index in range(int(highest / step) + 1)]


def _text(x: float, y: float, words: str, colour: str, anchor: str = 'start') -> str:
    return (f'<text x="{x:.1f}" y="{y:.1f}" fill="{colour}" text-anchor="{anchor}">'
            f'{escape(words)}</text>')
