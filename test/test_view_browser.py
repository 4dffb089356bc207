# SPDX-License-Identifier: Apache-2.0
"""The live page in a real browser: it loads, moves, responds, and contacts only its server."""
from pathlib import Path
import sys
from urllib.parse import urlsplit

import pytest

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / 'scripts'))

from draw_page import (  # noqa: E402, I100, I202
    browser, HEIGHT, look, NoBrowser, served, standing, WIDTH)


@pytest.fixture(scope='module')
def chromium():
    """Return a headless browser."""
    for name in ('playwright', 'viser'):
        pytest.importorskip(name, reason=f'{name} is not installed')
    try:
        with browser() as found:
            yield found
    except NoBrowser as error:
        pytest.skip(str(error))


@pytest.fixture(scope='module')
def source():
    """Return a scene paused at its start."""
    return standing('fig7_middle')


@pytest.fixture(scope='module')
def violations():
    """Return a list of unexpected events in the browser."""
    return []


@pytest.fixture(scope='module')
def tab(chromium, source, violations):
    """Return a tab with the page of the scene."""
    with served(source) as page:
        here = urlsplit(page.url).netloc
        # Few pixels: without a graphics card, the processor draws each.
        tab = chromium.new_page(viewport={'width': WIDTH, 'height': HEIGHT},
                                device_scale_factor=0.5)

        def check(route):
            address = urlsplit(route.request.url)
            if address.scheme in ('data', 'blob') or address.netloc == here:
                route.continue_()
            else:
                violations.append(f'asks for {route.request.url}')
                route.abort()

        tab.route('**/*', check)
        tab.on('websocket', lambda socket: urlsplit(socket.url).netloc == here
               or violations.append(f'connects to {socket.url}'))
        tab.on('console', lambda message: message.type == 'error'
               and violations.append(message.text))
        tab.on('pageerror', lambda error: violations.append(str(error)))
        look(tab, page.url)
        yield tab
        tab.close()


def wait_for(tab, true):
    """Wait until a condition is true, while the browser runs."""
    for _ in range(600):
        if true():
            return
        tab.wait_for_timeout(100)
    raise AssertionError('the condition has not become true')


def slide(tab, label, key):
    """Press a key on the slider with a label."""
    name = tab.locator('label', has_text=label).first.get_attribute('for')
    tab.locator(f'[id="{name}"] [role=slider]').press(key)


def press(tab, label):
    """Click without waiting until the button is at rest, which takes long on a busy machine."""
    tab.get_by_role('button', name=label).dispatch_event('click')


def test_the_page_describes_its_content(tab):
    assert tab.locator('#ballbot-title').inner_text() == 'Scene fig7_middle'
    assert tab.locator('#ballbot-state').inner_text() == 'paused'


def test_a_slider_changes_the_run(tab, source):
    before = source.controls['friction'].value
    slide(tab, 'friction', 'End')
    wait_for(tab, lambda: source.controls['friction'].value > before)
    ground = source.terrain
    slide(tab, 'step ahead', 'ArrowLeft')
    wait_for(tab, lambda: source.controls['step_height'].value < 0.031
             and source.terrain is not ground)


def test_a_button_starts_the_ball_which_moves_in_the_picture(tab, source):
    canvas = tab.locator('canvas').first
    stands = canvas.screenshot()
    begin = source.shown.x
    press(tab, 'Run')
    wait_for(tab, lambda: source.shown.x > begin + 0.05)
    press(tab, 'Pause')
    wait_for(tab, lambda: not source.health.running)
    end = source.shown.time
    wait_for(tab, lambda: f'{end:.2f}' in tab.locator('#ballbot-numbers').inner_text())
    wait_for(tab, lambda: canvas.screenshot() != stands)


def test_a_saved_picture_is_not_empty(tab, tmp_path):
    tab.screenshot(path=tmp_path / 'page.png')
    image = pytest.importorskip('PIL.Image').open(tmp_path / 'page.png')
    assert image.size == (WIDTH // 2, HEIGHT // 2)
    assert len(image.convert('RGB').getcolors(1 << 20)) > 500


def test_the_controls_fill_the_width_of_a_phone(chromium, source):
    with served(source) as page:
        tab = chromium.new_page(viewport={'width': 390, 'height': 844}, device_scale_factor=0.5)
        look(tab, page.url)
        width = tab.locator('#ballbot-title').evaluate(
            "title => title.closest('.mantine-ScrollArea-viewport').clientWidth")
        tab.close()
    assert width == 390


# The last test: it checks the events of all tests above.
def test_the_browser_reported_no_errors_and_contacted_no_other_server(tab, violations):
    assert not violations
