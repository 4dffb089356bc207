# SPDX-License-Identifier: Apache-2.0
"""The server of the page: access checks and port."""
from contextlib import contextmanager, redirect_stdout
import errno
import http
import io
import ipaddress
import logging
import socket
from typing import Any, Callable, Iterator, List, Optional
from urllib.parse import urlsplit

import viser
import websockets.asyncio.server
from websockets.datastructures import Headers
from websockets.exceptions import InvalidMessage
from websockets.http11 import Request, Response

from ballbot_ros.errors import ConfigurationError

LOOPBACK = '127.0.0.1'
DEFAULT_PORT = 8080
# Ports tried after one that is in use.
PORTS_TRIED = 20

# The page is self-contained and must not load from other hosts.
POLICY = (
    "default-src 'none'; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob: data:; "
    "worker-src 'self' blob: data:; style-src 'unsafe-inline'; img-src 'self' data: blob:; "
    "font-src data:; connect-src 'self' data: blob: ws://{host}; frame-ancestors 'none'; "
    "base-uri 'none'; form-action 'none'")


class PageServer(viser.ViserServer):
    """A viser server that serves its own page only, and never opens a tunnel."""

    def __init__(self, host: str, port: int):
        with _guarded(host) as guarded, redirect_stdout(io.StringIO()):
            super().__init__(host=host, port=port, verbose=False)
        if not guarded:
            self.end()
            raise ConfigurationError(
                f'viser {viser.__version__} starts its server in a way that this package cannot '
                'guard against foreign pages; install viser 1.1.1', 'unavailable', 'viser')
        self.gui.configure_theme(show_logo=False, show_share_button=False)

    def request_share_url(self, verbose: bool = True) -> None:
        """Refuse: any connected page may request a tunnel to a public server."""

    def end(self) -> None:
        """Stop without a message."""
        with redirect_stdout(io.StringIO()):
            self.stop()


def refusal(request: Request, bound: str) -> Optional[str]:
    """
    Return why a request to the address `bound` is refused, None if it is accepted.

    A foreign page in the same browser must neither read nor drive the robot.  Its requests carry
    its own origin or, after DNS rebinding, its own name as the host.
    """
    hosts, origins = request.headers.get_all('Host'), request.headers.get_all('Origin')
    if len(hosts) != 1 or not _is_ours(hosts[0], bound):
        return f'Host {", ".join(hosts) or "missing"} is not this server'
    if len(origins) > 1 or (origins and origins[0] != f'http://{hosts[0]}'):
        return f'Origin {", ".join(origins)} is not the page of this server'
    if not origins and request.headers.get_all('Upgrade'):
        return 'a connection needs the Origin of the page of this server'
    return None


def _is_ours(host: str, bound: str) -> bool:
    """Return whether a name in a request denotes this machine only."""
    try:
        name = urlsplit(f'//{host}').hostname or ''
    except ValueError:
        return False
    if name in ('localhost', bound.lower(), socket.gethostname().lower()):
        return True
    try:
        # No foreign page can be served under the address of this machine.
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


Handler = Callable[[Any, Request], Optional[Response]]


def _checked(inner: Optional[Handler], bound: str) -> Handler:
    """Return a handler that checks `refusal` and sets the content security policy."""
    def handle(connection: Any, request: Request) -> Optional[Response]:
        reason = refusal(request, bound)
        if reason is not None:
            body = f'refused: {reason}\n'.encode()
            return Response(http.HTTPStatus.FORBIDDEN, 'Forbidden', Headers(
                {'Content-Type': 'text/plain; charset=utf-8',
                 'Content-Length': str(len(body))}), body)
        response = inner(connection, request) if inner is not None else None
        if response is not None:
            response.headers['Content-Security-Policy'] = POLICY.format(
                host=request.headers['Host'])
            response.headers['X-Content-Type-Options'] = 'nosniff'
            response.headers['Referrer-Policy'] = 'no-referrer'
            response.headers['Cache-Control'] = 'no-store'
        return response
    return handle


def _is_fault(record: logging.LogRecord) -> bool:
    """Return False for a connection closed before any request: browsers preconnect."""
    return not (record.exc_info and isinstance(record.exc_info[1], InvalidMessage))


@contextmanager
def _guarded(bound: str) -> Iterator[List[bool]]:
    """Guard the server that is started within the context; the list is empty without one."""
    module: Any = websockets.asyncio.server
    serve, done = module.serve, []
    logging.getLogger('websockets.server').addFilter(_is_fault)

    def guarded(*args: Any, **kwargs: Any) -> Any:
        kwargs['process_request'] = _checked(kwargs.get('process_request'), bound)
        done.append(True)
        return serve(*args, **kwargs)

    # viser has no argument for this; the name is looked up when its server starts.
    module.serve = guarded
    try:
        yield done
    finally:
        module.serve = serve


def free_port(host: str, port: Optional[int]) -> int:
    """
    Return a port to listen on: the given one, or the first free one from `DEFAULT_PORT` on.

    Raises `ConfigurationError` if the port is in use, or the address is not one of this machine.
    """
    first = DEFAULT_PORT if port is None else port
    last = first + PORTS_TRIED if port is None else first
    for tried in range(first, last + 1):
        try:
            family = socket.getaddrinfo(host, tried, type=socket.SOCK_STREAM)[0][0]
            with socket.socket(family, socket.SOCK_STREAM) as probe:
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                probe.bind((host, tried))
                return int(probe.getsockname()[1])
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                continue
            if error.errno == errno.EACCES:
                raise ConfigurationError(
                    f'--port {tried} is not permitted for this user; use one from 1024 on',
                    'out_of_range', '--port') from None
            raise ConfigurationError(
                f'--host {host} is not an address of this machine; leave it out to listen on '
                f'{LOOPBACK}', 'out_of_range', '--host') from None
    if port is not None:
        raise ConfigurationError(
            f'port {port} of {host} is in use, possibly by another page; leave --port out to use '
            'the next free one', 'unavailable', '--port')
    raise ConfigurationError(
        f'the ports {first} to {last} of {host} are all in use; give a free one with --port',
        'unavailable', '--port')
