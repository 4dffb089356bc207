# SPDX-License-Identifier: Apache-2.0
"""Start nodes as separate processes, and guarantee their termination."""
from functools import partial
import os
from pathlib import Path
import signal
import socket
import subprocess
import sys
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence, Tuple, Union

from ballbot_ros.config.files import yaml_of
from ballbot_ros.demo.forked import Forked, run_detached
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.ros import discovery

END_TIMEOUT = 60.0  # wall time for a node to end after SIGINT before it is killed [s]


_claims: Dict[Tuple[int, int], Tuple[int, socket.socket]] = {}  # by process and number


def own_domain(number: int = 0) -> int:
    """
    Return the ROS domain to use: that of the environment, or one that only this process uses.

    The ports of 101 domains do not conflict with ordinary programs.  A bound socket claims a
    domain for as long as this process or a copy of it runs; a process may claim several by number.
    Raises `ConfigurationError` if all 101 are claimed.
    """
    given = os.environ.get('ROS_DOMAIN_ID')
    if given:
        return int(given)
    key = (os.getpid(), number)
    if key in _claims:
        return _claims[key][0]
    for shift in range(101):
        domain, claim = (key[0] + shift) % 101 + 1, socket.socket(socket.AF_UNIX)
        try:
            claim.bind(f'\0ballbot_ros_domain_{domain}')
        except OSError:
            claim.close()
        else:
            _claims[key] = domain, claim
            return domain
    raise ConfigurationError(
        'the ROS domains 1 to 101 are all in use by other runs of this package on this machine; '
        'end some of them, or set ROS_DOMAIN_ID', 'unavailable', 'ROS_DOMAIN_ID')


def environment(domain: int, folder: Path) -> Dict[str, str]:
    """Return the environment of the nodes of a domain; `ros.discovery` sets their visibility."""
    return {**os.environ, **discovery.variables(os.environ), 'ROS_DOMAIN_ID': str(domain),
            'ROS_HOME': str(folder.resolve()),
            'RCUTILS_COLORIZED_OUTPUT': '0', 'PYTHONUNBUFFERED': '1'}


def parameter_arguments(parameters: Mapping[str, Any]) -> List[str]:
    """Return the command line for parameters of a node; a path is given as text."""
    arguments = []
    for name, value in parameters.items():
        text = yaml_of(str(value) if isinstance(value, Path) else value)
        arguments += ['-p', f'{name}:={text}']
    return ['--ros-args', *arguments] if arguments else []


class NodeProcesses:
    """Nodes as processes on a ROS domain, with log files in a folder; terminated on exit."""

    def __init__(self, folder: Path, domain: int):
        self._folder = folder
        self._environment = environment(domain, folder)
        self._running: Dict[str, Union[subprocess.Popen[bytes], Forked]] = {}
        folder.mkdir(parents=True, exist_ok=True)
        for old in folder.glob('*.log'):
            old.unlink()

    def __enter__(self) -> 'NodeProcesses':
        return self

    def __exit__(self, *_: Any) -> None:
        self.stop()

    def log(self, name: str) -> Path:
        return self._folder / f'{name}.log'

    def start(self, name: str, parameters: Optional[Mapping[str, Any]] = None,
              arguments: Sequence[str] = (), label: str = '') -> None:
        """
        Start a node as its executable does; a second start appends to the same log.

        `arguments`, ``('--ros-args', '-r', '__ns:=/left')`` for instance, are appended to the
        command line; `label` names the process if the same node is started twice.
        """
        label = label or name
        with open(self.log(label), 'a', encoding='utf-8') as log:
            self._running[label] = subprocess.Popen(
                [sys.executable, '-m', 'ballbot_ros.nodes.start', name,
                 *parameter_arguments(parameters or {}), *arguments], stdout=log,
                stderr=subprocess.STDOUT, env=self._environment, stdin=subprocess.DEVNULL,
                start_new_session=True)

    def fork(self, name: str, work: Callable[[], int], arguments: Sequence[str] = (),
             method: str = 'fork') -> None:
        """Run a function in a copy of a process that has imported its modules; see `Forked`."""
        self.log(name).touch()
        self._running[name] = Forked(partial(
            run_detached, name, work, arguments, self._environment, self.log(name)), method)

    def ended(self) -> Optional[Tuple[str, int]]:
        """Return name and exit code of a node that has ended by itself, if any."""
        for name, process in self._running.items():
            code = process.poll()
            if code is not None:
                return name, code
        return None

    def signal(self, name: str, number: int) -> None:
        self._running[name].send_signal(number)

    def wait(self, name: str, timeout: float = END_TIMEOUT) -> int:
        """Return the exit code of a node that is about to end."""
        return self._running.pop(name).wait(timeout)

    def stop(self) -> Dict[str, int]:
        """End all nodes and return their exit codes."""
        for process in self._running.values():
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
        codes = {}
        for name, process in self._running.items():
            try:
                codes[name] = process.wait(END_TIMEOUT)
            except subprocess.TimeoutExpired:
                process.kill()
                codes[name] = process.wait()
        self._running.clear()
        return codes
