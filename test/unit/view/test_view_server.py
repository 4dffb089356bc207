# SPDX-License-Identifier: Apache-2.0
"""The server accepts requests from its own page only."""
from contextlib import nullcontext
import http.client
import socket
import subprocess
import sys

import pytest
from refusals import refused

viser = pytest.importorskip('viser')

from websockets.exceptions import InvalidStatus  # noqa: E402
from websockets.sync.client import connect  # noqa: E402

from ballbot_ros.view.server import free_port, LOOPBACK, PageServer  # noqa: E402


@pytest.fixture(scope='module')
def server():
    made = PageServer(LOOPBACK, free_port(LOOPBACK, 0))
    yield made
    made.end()


def get(server, host=None, **headers):
    """Request the page; return status, headers and text."""
    connection = http.client.HTTPConnection(LOOPBACK, server.get_port(), timeout=30)
    connection.putrequest('GET', '/', skip_host=True)
    for name, value in {'Host': host or f'{LOOPBACK}:{server.get_port()}', **headers}.items():
        connection.putheader(name, value)
    connection.endheaders()
    answer = connection.getresponse()
    text = answer.read().decode()
    connection.close()
    return answer.status, answer.headers, text


def handshake(server, origin):
    """Open a websocket as a page of `origin` would."""
    return connect(f'ws://{LOOPBACK}:{server.get_port()}', origin=origin, open_timeout=30,
                   subprotocols=[f'viser-v{viser.__version__}'])


def test_the_page_is_served_and_may_contact_no_other_server(server):
    status, headers, text = get(server)
    assert status == 200 and '<html' in text
    policy = headers['Content-Security-Policy']
    assert "default-src 'none'" in policy and "frame-ancestors 'none'" in policy
    assert f"connect-src 'self' data: blob: ws://{LOOPBACK}:{server.get_port()};" in policy


@pytest.mark.parametrize('host', ['evil.example', 'evil.example:8080', '127.0.0.1.evil.example',
                                  'localhost.evil.example', '[::1', ''])
def test_another_host_name_that_resolves_to_this_machine_is_refused(server, host):
    status, _, text = get(server, host=host or ' ')
    assert status in (400, 403) and '<html' not in text


@pytest.mark.parametrize('origin', ['http://evil.example', 'null', 'http://localhost:3000',
                                    'http://127.0.0.1'])
def test_a_page_of_another_origin_gets_no_connection(server, origin):
    with pytest.raises(InvalidStatus) as refused:
        handshake(server, origin)
    assert refused.value.response.status_code == 403


def test_without_an_origin_there_is_no_connection(server):
    with pytest.raises(InvalidStatus) as refused:
        handshake(server, None)
    assert refused.value.response.status_code == 403


def test_its_own_page_gets_a_connection(server):
    with handshake(server, f'http://{LOOPBACK}:{server.get_port()}') as connection:
        assert connection.recv(timeout=30)


def test_a_connection_that_ends_before_its_request_leaves_no_traceback():
    # In a separate process: the first request to viser adds a filter to the logger.
    ended = subprocess.run([sys.executable, '-c', """
import socket, time
from ballbot_ros.view.server import free_port, LOOPBACK, PageServer
server = PageServer(LOOPBACK, free_port(LOOPBACK, 0))
with socket.create_connection((LOOPBACK, server.get_port()), timeout=30) as raw:
    raw.shutdown(socket.SHUT_WR)
    raw.recv(1)
time.sleep(0.3)  # the record follows the end of the connection
server.end()
"""], capture_output=True, text=True, timeout=120)
    assert (ended.returncode, ended.stderr) == (0, '')


def test_a_foreign_page_does_not_get_the_document_either(server):
    assert get(server, Origin='http://evil.example')[0] == 403


def test_no_request_opens_a_tunnel(server):
    assert server.request_share_url() is None and server._share_tunnel is None


def test_the_server_listens_on_loopback_only(server):
    sockets = server._websock_server
    assert sockets._host == LOOPBACK
    other = socket.gethostbyname(socket.gethostname())
    if other.startswith('127.'):
        pytest.skip('this machine has no other address')
    with pytest.raises(OSError):
        socket.create_connection((other, server.get_port()), timeout=5).close()


def test_a_port_in_use_is_refused_if_requested_and_otherwise_skipped(monkeypatch):
    with socket.socket() as taken:
        taken.bind((LOOPBACK, 0))
        taken.listen()
        port = taken.getsockname()[1]
        with refused('unavailable', '--port'):
            free_port(LOOPBACK, port)
        monkeypatch.setattr('ballbot_ros.view.server.DEFAULT_PORT', port)
        assert port < free_port(LOOPBACK, None) <= port + 20


def test_an_address_of_another_machine_is_refused():
    with refused('out_of_range', '--host'):
        free_port('203.0.113.7', None)


def test_a_viser_that_cannot_be_guarded_is_refused(monkeypatch):
    # As if viser started its server in an unguarded way.
    monkeypatch.setattr('ballbot_ros.view.server._guarded', lambda bound: nullcontext([]))
    with refused('unavailable', 'viser'):
        PageServer(LOOPBACK, free_port(LOOPBACK, 0))
