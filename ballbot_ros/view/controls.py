# SPDX-License-Identifier: Apache-2.0
"""The controls of the page: one widget for each control of a source, and the source's state."""
import asyncio
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from html import escape
import logging
import math
from threading import RLock
from typing import Any, Callable, Dict, List, Mapping, Optional, Tuple

import viser

from ballbot_ros.errors import BallbotError
from ballbot_ros.figures.canvas import GREEN, GREY, ORANGE, VERMILION
from ballbot_ros.view.frame import Frame
from ballbot_ros.view.source import Control, CONTROLS, Health, Source, Value
from ballbot_ros.view.stage import CAMERAS, look_from

# Control -> its label, by group.
GROUPS: Mapping[str, Mapping[str, str]] = {
    'Model': {'scene': 'scene', 'robot': 'robot'},
    'Motor': {'law': 'law', 'set_point': 'set-point', 'yaw_rate': 'yaw rate'},
    'World': {'step_height': 'step ahead', 'friction': 'friction'},
    'Simulation': {'speed': 'playback', 'accuracy': 'accuracy'}}
SLIDER_POSITIONS = 300  # at least
STEP_TIME = 0.02  # simulated time per `step` [s]
PANEL_WIDTH = 260  # [px]
# Control with a list of numbers -> its labels and their numbers.
NAMED: Mapping[str, Mapping[str, float]] = {
    'accuracy': {'as in the scene': 0.0, '1 mm': 1e-3, '0.1 mm': 1e-4, '10 um': 1e-5, '1 um': 1e-6,
                 '10 nm': 1e-8},
    'speed': {f'{speed:g}': speed for speed in (0.05, 0.1, 0.25, 0.5, 1.0, 2.0, 4.0)}}
UNITS = {'step_height': (1e3, 'mm')}
NOTIFICATION_TIME = 12  # [s]
# The panel of the controls, which viser makes narrow in a narrow window.
PANEL = '.mantine-Paper-root:has(#ballbot-title)'
# Button -> its hotkey, its colour, and its labels while the control is off and on.
BUTTONS: Mapping[str, Tuple[Any, Any, str, str]] = {
    'e_stop': ('E', 'red', 'E-STOP: motor off', 'Release the e-stop'),
    'pause': ('space', 'blue', 'Pause', 'Run'),
    'step': ('arrowright', 'gray', f'Step by {STEP_TIME:g} s', ''),
    'reset': ('R', 'gray', 'Reset', '')}


class Controls:
    """
    Creates a widget for each control of a source, and keeps both consistent.

    An unavailable control is greyed out, and the state shows the reason.  Viser sends only values
    that differ from the present ones.
    """

    def __init__(self, server: viser.ViserServer, source: Source):
        self._gui, self._source = server.gui, source
        self._widgets: Dict[str, Any] = {}
        # Range, unit, choices and refusal of each widget; a change creates a new widget.
        self._shapes: Dict[str, Tuple[Any, ...]] = {}
        self._refused = ''
        # Both the page and the callback threads of the widgets refresh.
        self._refreshing = RLock()
        self._changes = ThreadPoolExecutor(1, 'changes')  # in the order of their messages
        self._gui.main_panel.dock_right()
        self._gui.main_panel.set_width(PANEL_WIDTH)
        self._status = self._gui.add_html('')
        self._remedy = self._gui.add_button('Run', color='green', visible=False)
        self._remedy.on_click(self._use_remedy)
        self._run_controls()
        self._camera_controls(server)
        self._folders: Dict[str, Any] = {}
        for group, members in GROUPS.items():
            if any(name in source.controls for name in members):
                self._folders[group] = self._gui.add_folder(group)
        self.refresh()

    def refresh(self) -> None:
        with self._refreshing:
            controls = self._source.controls
            for group, members in GROUPS.items():
                for name, label in members.items():
                    if name in controls:
                        self._show(name, label, controls[name], self._folders[group])
            for name, (_, _, off, on) in BUTTONS.items():
                if name in controls:
                    self._widgets[name].disabled = bool(controls[name].refusal)
                    self._widgets[name].label = on if controls[name].value else off
            self._seek()
            self._show_state()

    def _run_controls(self) -> None:
        controls = self._source.controls
        for name in BUTTONS:
            if name in controls:
                self._button(name, controls[name])
        if 'seek' in controls:
            slider = self._gui.add_slider(
                'timeline', 0.0, 1.0, 0.01, 0.0, disabled=True,
                hint='Drag to show an earlier time [s]; the run is paused meanwhile')
            self._widgets['seek'] = slider
            self._on_change('seek', slider, float)

    def _button(self, name: str, control: Control) -> None:
        key, colour, label, _ = BUTTONS[name]

        def press(event: Any) -> None:
            if name == 'step' and not self._is_on('pause'):  # only a paused run can be stepped
                self._source.apply('pause', True)
            self._use(name, STEP_TIME if name == 'step' else not self._is_on(name), event)
        self._widgets[name] = self._gui.add_button(
            label, color=colour, hint=control.refusal or CONTROLS[name][1])
        self._widgets[name].on_click(press)
        self._gui.add_command(label, hotkey=key).on_trigger(press)

    def _camera_controls(self, server: viser.ViserServer) -> None:
        """Create a button for each camera preset, with the digits as hotkeys."""
        def use(name: str, event: Any) -> None:
            if event.client is not None:
                look_from(event.client, name)
        buttons = self._gui.add_button_group('camera', tuple(CAMERAS))
        buttons.on_click(lambda event: use(event.target.value, event))
        for number, name in enumerate(CAMERAS, 1):
            command = self._gui.add_command(
                f'Camera: {name}', hotkey=str(number))  # type: ignore[arg-type]
            command.on_trigger(partial(use, name))

    def _use_remedy(self, event: Any) -> None:
        idle = self._source.health.idle
        for name, value in () if idle is None else idle.remedy:
            self._use(name, value, event)

    def go_to(self, place: Optional[Tuple[float, float]], event: Any) -> None:
        """Drive to a position on the floor that a user has clicked."""
        if place is None:
            return
        if 'goal' not in self._source.controls:
            event.client.add_notification(
                'No goal', 'A goal needs running nodes with a navigator: "ballbot demo --house '
                '--view" runs them.', auto_close_seconds=NOTIFICATION_TIME)
            return
        self._use('goal', place, event)
        if not self._refused:
            event.client.add_notification('Goal', '({:.2f}, {:.2f}) m'.format(*place),
                                          auto_close_seconds=NOTIFICATION_TIME)

    def _is_on(self, name: str) -> bool:
        return bool(self._source.controls[name].value)

    def _seek(self) -> None:
        """Move the timeline to the displayed frame, and its end to the latest frame."""
        slider, shown = self._widgets.get('seek'), self._source.shown
        if slider is None or shown is None:
            return
        first, last = self._source.history.span
        if last > first:
            # The end moves in steps of 5 s, because each change is a message.
            if not slider.max - 5.0 <= last <= slider.max:
                slider.max = 5.0 * (last // 5.0 + 1.0)
            slider.min, slider.disabled = first, False
            slider.value = round(min(max(shown.time, first), slider.max), 2)

    def _show(self, name: str, label: str, control: Control, folder: Any) -> None:
        """Show a value; create its widget if it is missing or its range has changed."""
        shape = (control.lowest, control.highest, control.unit, control.choices,
                 control.refusal)
        if self._shapes.get(name) != shape:
            if name in self._widgets:
                self._widgets.pop(name).remove()
            self._shapes[name] = shape
            with folder:
                self._widgets[name] = self._make(name, label, control)
        elif control.value is not None and not control.refusal:
            self._widgets[name].value = self._shown(name, control)

    def _make(self, name: str, label: str, control: Control) -> Any:
        about: Any = {'order': float(list(CONTROLS).index(name)),
                      'hint': control.refusal or CONTROLS[name][1]}
        if control.refusal:
            return self._gui.add_text(label, '-', disabled=True, **about)
        if name in NAMED or CONTROLS[name][0] is str:
            options, given = tuple(NAMED.get(name, control.choices)), self._shown(name, control)
            if given not in options:
                options = (given, *options)
            widget: Any = self._gui.add_dropdown(label, options, initial_value=given, **about)
            self._on_change(name, widget, lambda words: self._meant(name, words))
            return widget
        factor, unit = UNITS.get(name, (1.0, control.unit))
        value: Any = control.value or 0.0
        low, high = (factor * float(bound or 0.0) for bound in (control.lowest, control.highest))
        widget = self._gui.add_slider(
            f'{label} [{unit}]' if unit else label, low, high, _round_step(high - low),
            min(max(factor * float(value), low), high), **about)
        self._on_change(name, widget, lambda number: number / factor)
        return widget

    def _shown(self, name: str, control: Control) -> Any:
        """Return the value of a control as its dropdown or its existing slider shows it."""
        value: Any = control.value
        if name in NAMED:
            return next((words for words, number in NAMED[name].items() if number == value),
                        f'{value:g} {control.unit}'.rstrip())
        if CONTROLS[name][0] is float:
            slider = self._widgets[name]
            return min(max(value * UNITS.get(name, (1.0, ''))[0], slider.min), slider.max)
        return value

    def _meant(self, name: str, words: str) -> Value:
        if name not in NAMED:
            return words
        return NAMED[name][words] if words in NAMED[name] else float(words.split()[0])

    def _on_change(self, name: str, widget: Any, meaning: Callable[[Any], Value]) -> None:
        async def change(event: Any) -> None:
            # Viser awaits this function right after the update; a thread that it starts may read
            # the value only after a refresh has overwritten it.
            if event.client is not None:  # else the page itself has set the value
                asyncio.get_running_loop().run_in_executor(
                    self._changes, self._use, name, meaning(event.target.value), event)
        widget.on_update(change)

    def _use(self, name: str, value: Value, event: Any) -> None:
        """Use a control; a refusal is shown in the page of the client."""
        try:
            self._source.apply(name, value)
            self._refused = ''
        except BallbotError as error:
            self._refused = str(error)
            if event.client is not None:
                event.client.add_notification(
                    'Refused', str(error), color='red', auto_close_seconds=NOTIFICATION_TIME)
        except RuntimeError as error:  # from a source that has been closed
            logging.getLogger(__name__).warning('%s: %s', name, error)
            self._refused = f'{name}: {error}'
        self.refresh()

    def _show_state(self) -> None:
        health = self._source.health
        self._remedy.visible = health.idle is not None
        if health.idle is not None:
            self._remedy.label = health.idle.label
        unavailable = {control.refusal for name, control in self._source.controls.items()
                       if control.refusal and name != 'set_point'}
        lines = status_lines(health, self._is_on('e_stop') if 'e_stop' in
                             self._source.controls else None)
        lines += [f'<span style="color:{GREY}">Not available: {escape(reason)}.</span>'
                  for reason in sorted(unavailable)]
        if self._refused:
            lines.append(_coloured(f'Refused: {self._refused}', VERMILION, 'refusal'))
        self._status.content = (
            f'<div style="font:13px/1.5 system-ui,sans-serif;padding:0.5em 0.7em 0">'
            f'<b id="ballbot-title">{escape(self._source.title)}</b> &middot; '
            f'{escape(self._source.robot.name)}<br>{"<br>".join(lines)}'
            f'{phone_values(self._source.shown)}</div>')


def status_lines(health: Health, e_stop: Optional[bool]) -> List[str]:
    """Return the state of a source as lines of HTML."""
    state = _coloured('running', GREEN, 'state') if health.running else _coloured(
        'paused', GREY, 'state')
    if health.real_time_factor is not None:
        state += f' at {health.real_time_factor:.2f} x real time'
    lines = [state]
    if health.error_estimate is not None:
        lines.append(f'position error below {_length(health.error_estimate)}')
    if e_stop:
        lines.append(_coloured('e-stop engaged: no torque', VERMILION, 'e-stop'))
    if health.failure:
        lines.append(_coloured(health.failure, VERMILION, 'failure'))
    if health.idle is not None:
        lines.append(_coloured(health.idle.reason, ORANGE, 'idle'))
    return lines + [escape(note) for note in health.notes]


def phone_values(frame: Optional[Frame]) -> str:
    """Return the main values of a frame, shown only in narrow windows, which hide the panel."""
    if frame is None:
        return ''
    values = [f'{frame.time:.1f} s']
    if frame.velocity_x is not None:
        values.append(f'{frame.velocity_x:.2f} m/s')
    if frame.pendulum_angle is not None:
        values.append(f'pendulum {math.degrees(frame.pendulum_angle):.0f} deg')
    return (f'<style>@media (min-width: 700px) {{.ballbot-phone {{display: none}}}}'
            f'@media (max-width: 699px) {{{PANEL}, {PANEL} .mantine-ScrollArea-content > div '
            '{width: 100% !important}}</style>'
            f'<div class="ballbot-phone">{", ".join(values)}</div>')


def _coloured(words: str, colour: str, name: str) -> str:
    return f'<span id="ballbot-{name}" style="color:{colour};font-weight:600">' \
        f'{escape(words)}</span>'


def _length(metres: float) -> str:
    for factor, unit in ((1e3, 'mm'), (1e6, 'um'), (1e9, 'nm')):
        if factor * metres >= 0.1:
            return f'{factor * metres:.2g} {unit}'
    return '0.1 nm'


def _round_step(span: float) -> float:
    step = 10.0
    while step > span / SLIDER_POSITIONS:
        step /= 10.0
    return next(
        (part * step for part in (5.0, 2.0) if part * step <= span / SLIDER_POSITIONS), step)
