# SPDX-License-Identifier: Apache-2.0
"""The page draws for each viewer, and is not delayed by a viewer that does not read."""
from dataclasses import replace
from threading import Event
import time
from types import SimpleNamespace

import pytest
from waiting import wait_until

looker = pytest.importorskip('looker')  # and viser

from ballbot_ros.errors import ConfigurationError  # noqa: E402
from ballbot_ros.view.page import Page  # noqa: E402
from ballbot_ros.view.scene_source import SceneSource  # noqa: E402
from ballbot_ros.view.server import free_port, LOOPBACK, PageServer  # noqa: E402


@pytest.fixture
def page():
    made = Page(SceneSource('voltage_start'),
                PageServer(LOOPBACK, free_port(LOOPBACK, 0)), begin=True)
    yield made
    made.close()


def test_time_starts_with_the_first_viewer(page):
    source = page._source
    page.start()
    assert source.shown.time == 0.0 and not source.health.running
    with looker.look(page.url):
        wait_until(lambda: source.shown.time > 0.1)


@pytest.mark.slow
def test_a_slow_browser_never_slows_a_simulation(page):
    source = page._source
    page.start()
    # It reads the first bytes and then stops reading: its buffers fill soon.
    with looker.look(page.url, max_queue=1, close_timeout=0.1):
        source.apply('speed', 4.0)
        wait_until(lambda: source.shown.time > 3.0)
        drawn = page.frames
        wait_until(lambda: page.frames > drawn + 30)
        assert source.health.running


@pytest.mark.slow
def test_a_closed_browser_never_slows_a_simulation(page):
    source = page._source
    page.start()
    with looker.look(page.url):
        wait_until(lambda: source.shown.time > 0.1)
    gone = source.shown.time
    wait_until(lambda: source.shown.time > gone + 1.0)
    wait_until(lambda: not page._server.get_clients())
    drawn = page.frames
    time.sleep(0.3)
    assert page.frames <= drawn + 1


def test_a_refusal_is_shown_verbatim_in_the_page(page, monkeypatch):
    controls, received = page._controls, []
    event = SimpleNamespace(client=SimpleNamespace(
        add_notification=lambda title, body, **_: received.append((title, body))))

    def refuse(name, value):
        raise ConfigurationError('friction must be at least 0, got <-1>', 'out_of_range', '')
    with monkeypatch.context() as patched:
        patched.setattr(page._source, 'apply', refuse)
        controls._use('friction', -1.0, event)
    assert received == [('Refused', 'friction must be at least 0, got <-1>')]
    assert 'got &lt;-1&gt;' in controls._status.content
    controls._use('friction', 0.5, event)
    assert 'Refused' not in controls._status.content


def test_a_slider_returns_to_the_valid_value_after_a_refusal(page):
    controls = page._controls
    slider = controls._widgets['set_point']
    slider.value = 3.0  # as if set by hand, and refused
    controls.refresh()
    assert slider.value == 7.0


def test_a_refresh_does_not_discard_the_change_of_a_viewer(page):
    source, controls = page._source, page._controls
    slider, busy, threads = controls._widgets['set_point'], Event(), page._server._thread_executor
    with looker.look(page.url) as viewer:
        wait_until(page._server.get_clients)
        try:
            for _ in range(threads._max_workers):
                threads.submit(busy.wait)
            looker.change(viewer, slider, 5)
            wait_until(lambda: slider.value == 5.0)
            controls.refresh()
        finally:
            busy.set()
        wait_until(lambda: source.controls['set_point'].value == 5.0)


def test_widgets_follow_the_controls_of_the_source(page):
    controls, source = page._controls, page._source
    controls._use('law', 'free', None)  # no event: no refusal either
    assert controls._widgets['set_point'].disabled
    assert 'has no set-point' in controls._widgets['set_point'].hint
    controls._use('law', 'position', None)
    slider = controls._widgets['set_point']
    assert (slider.min, slider.max) == (-180.0, 180.0) and 'deg' in slider.label
    controls._use('robot', 'shellball', None)
    assert controls._widgets['law'].options == ('free',) and source.robot.name == 'shellball'


def test_steps_are_shown_in_millimetres_and_set_in_metres(page):
    slider = page._controls._widgets['step_height']
    assert slider.value == pytest.approx(31.0) and '[mm]' in slider.label


def test_the_stage_follows_the_ball_and_clears_its_path_at_a_reset(page):
    source, stage = page._source, page._stage
    source.apply('step', 2.0)
    page._draw(whole=True)
    frame = source.shown
    assert stage._nodes['place'].position == pytest.approx((frame.x, 0.0, frame.y))
    assert stage._world.position[0] == pytest.approx(-frame.x)
    assert len(stage._path) > 10
    source.apply('reset', True)
    page._draw(whole=True)
    assert len(stage._path) == 1


def test_unknown_values_are_not_drawn(page):
    source, stage = page._source, page._stage
    bare = replace(source.shown, x=None, y=None, contacts=None, energies=None)
    stage.draw(source, bare)
    assert not stage._nodes['place'].visible and not stage._nodes['forces'].visible
    stage.draw(source, source.shown)
    assert stage._nodes['place'].visible and stage._nodes['forces'].visible
