# SPDX-License-Identifier: Apache-2.0
"""The live page of a demo: a separate process, so that it does not delay the nodes."""
from contextlib import contextmanager
from importlib.util import find_spec
import os
import select
import signal
import subprocess
import sys
from typing import Iterator

from ballbot_ros.demo.processes import own_domain
from ballbot_ros.errors import ConfigurationError

# Timeouts until the page is served, and until its process has ended [s].
START_TIMEOUT, END_TIMEOUT = 60.0, 10.0


@contextmanager
def page_beside(quiet: bool = False) -> Iterator[None]:
    """
    Serve the page for as long as the demo runs; with `quiet`, do not print its address.

    This sets the domain of the demo in the environment.  Raises `ConfigurationError` with the
    reason if the page does not start.
    """
    if find_spec('viser') is None:
        raise ConfigurationError(
            '--view needs the package viser, which is not installed; install it with: pip install '
            'viser', 'not_installed', 'viser')
    os.environ['ROS_DOMAIN_ID'] = str(own_domain())
    with subprocess.Popen(
            [sys.executable, '-m', 'ballbot_ros.cli', 'view', '--live'], stdout=subprocess.PIPE,
            stdin=subprocess.DEVNULL, text=True, start_new_session=True) as process:
        try:
            address = _first_line(process)
            if not quiet:
                print(f'The page: {address}', flush=True)
            yield
        finally:
            process.send_signal(signal.SIGINT)
            try:
                process.wait(END_TIMEOUT)
            except subprocess.TimeoutExpired:
                process.kill()


def _first_line(process: 'subprocess.Popen[str]') -> str:
    """Return the line that the page prints once it is served."""
    assert process.stdout is not None
    ready, _, _ = select.select([process.stdout], [], [], START_TIMEOUT)
    line = process.stdout.readline().strip() if ready else ''
    if not line:
        raise ConfigurationError(
            f'the page was not served within {START_TIMEOUT:g} s; leave --view out, or see the '
            'output of "ballbot view --live"', 'unavailable', '--view')
    return line
