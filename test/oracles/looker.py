# SPDX-License-Identifier: Apache-2.0
"""A client of the live page without a browser; it sends the first messages of viser's client."""
import msgspec.msgpack
import viser
from websockets.sync.client import connect

CAMERA = {
    'type': 'ViewerCameraMessage', 'wxyz': (1.0, 0.0, 0.0, 0.0), 'position': (0.0, -3.0, 0.5),
    'fov': 0.6, 'near': 0.01, 'far': 1000.0, 'image_height': 800, 'image_width': 1200,
    'look_at': (0.0, 0.0, 0.0), 'up_direction': (0.0, 0.0, 1.0)}


def look(url, **options):
    """Connect like the page at `url`; the caller may receive the messages of the server."""
    connection = connect(url.replace('http', 'ws', 1), origin=url, open_timeout=30,
                         max_size=None, subprotocols=[f'viser-v{viser.__version__}'], **options)
    # viser registers a client at its first camera message.
    connection.send(msgspec.msgpack.encode(CAMERA))
    return connection


def change(connection, widget, value):
    """Set a widget of the page, like a user in the browser."""
    connection.send(msgspec.msgpack.encode({
        'type': 'GuiUpdateMessage', 'uuid': widget._impl.uuid, 'updates': {'value': value}}))
