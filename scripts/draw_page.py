# SPDX-License-Identifier: Apache-2.0
"""
Redraw the picture of the live page: ``python scripts/draw_page.py [FILE]``.

It opens the page in a headless Chromium, as the tests of the page do.
"""
from contextlib import contextmanager
from pathlib import Path
import shutil
import sys

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / 'scripts')]

from stages import path_argument  # noqa: E402, I100, I201

from ballbot_ros.cli.simulate import load_machine_code  # noqa: E402
from ballbot_ros.physics import load_scene  # noqa: E402
from ballbot_ros.view.scene_source import SceneSource  # noqa: E402

NAMES = ('chromium', 'chromium-browser', 'google-chrome')
# Software WebGL for machines without a graphics card; root has no sandbox.
OPTIONS = ('--no-sandbox', '--use-angle=swiftshader', '--enable-unsafe-swiftshader',
           '--ignore-gpu-blocklist')
WIDTH, HEIGHT = 1280, 720
WEBGL = "() => document.createElement('canvas').getContext('webgl2') !== null"
PAGE_TIMEOUT = 60e3  # [ms]


class NoBrowser(RuntimeError):
    """No browser can show the page; the message names the missing part."""


@contextmanager
def browser():
    """Yield a headless Chromium with WebGL; raise `NoBrowser` if there is none."""
    from playwright.sync_api import Error, sync_playwright
    path = next(filter(None, map(shutil.which, NAMES)), None)
    if path is None:
        raise NoBrowser(f'none of {", ".join(NAMES)} is installed: sudo apt-get install chromium')
    with sync_playwright() as playwright:
        try:
            chromium = playwright.chromium.launch(executable_path=path, args=list(OPTIONS))
        except Error as error:
            raise NoBrowser(f'{path} does not start: {error}') from error
        try:
            page = chromium.new_page()
            if not page.evaluate(WEBGL):
                raise NoBrowser(f'{path} has no WebGL 2')
            page.close()
            yield chromium
        finally:
            chromium.close()


def standing(name):
    """Return a compiled scene, paused at its start."""
    load_machine_code(load_scene(name))
    source = SceneSource(name)
    source.apply('step', 0.02)
    source.apply('reset', True)
    return source


@contextmanager
def served(source):
    """Yield the page of a source, without a browser."""
    from ballbot_ros.view.page import Page
    from ballbot_ros.view.server import free_port, LOOPBACK, PageServer
    page = Page(source, PageServer(LOOPBACK, free_port(LOOPBACK, None)))
    try:
        page.start()
        yield page
    finally:
        page.close()


def look(tab, url):
    """Open the page in a tab and wait until it is drawn."""
    tab.set_default_timeout(PAGE_TIMEOUT)
    tab.goto(url)
    tab.wait_for_selector('#ballbot-title')
    tab.wait_for_selector('canvas')


def close_notes(tab):
    """Close notifications about a missing graphics card, which cover the scene."""
    for button in tab.locator('.mantine-Notification-closeButton').all():
        button.click()
    tab.wait_for_function("() => !document.querySelector('.mantine-Notification-root')")


def main():
    """Draw docs/figures/view.png, or the file on the command line."""
    file = path_argument('file', ROOT / 'docs' / 'figures' / 'view.png')
    source = standing('fig7_bottom')
    with browser() as chromium, served(source) as page:
        tab = chromium.new_page(viewport={'width': WIDTH, 'height': HEIGHT})
        look(tab, page.url)
        close_notes(tab)
        for _ in range(20):
            source.apply('step', 0.02)
        tab.keyboard.press('2')  # the camera preset from behind
        tab.wait_for_timeout(5e3)  # software rendering is slow
        tab.screenshot(path=file)


if __name__ == '__main__':
    main()
