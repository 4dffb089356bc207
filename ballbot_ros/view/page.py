# SPDX-License-Identifier: Apache-2.0
"""The page, which draws a source at a constant rate."""
from threading import Event, Thread
from time import monotonic

from ballbot_ros.view.controls import Controls
from ballbot_ros.view.readouts import Readouts
from ballbot_ros.view.server import PageServer
from ballbot_ros.view.source import Source
from ballbot_ros.view.stage import Stage

FRAME_RATE = 30.0  # frames per second
# Frames of the scene per update of the values, and of the time series.
FRAMES_PER_READOUT, FRAMES_PER_PLOT = 4, 6


class Page:
    """
    Samples a source and sends changes to all connected browsers.

    It runs in its own threads and only reads from the source, so that a slow or closed browser
    does not delay it.  Without a browser it does nothing.  With `begin`, the first browser to
    connect resumes the source.
    """

    def __init__(self, source: Source, server: PageServer, begin: bool = False):
        self._source, self._server = source, server
        self._stage = Stage(server, source)
        self._readouts = Readouts(server)
        self._controls = Controls(server, source)
        server.scene.on_click()(lambda event: self._controls.go_to(
            self._stage.point_at(event.ray_origin, event.ray_direction), event))
        self._begin = begin
        self._ended = Event()
        self.frames = 0  # drawn so far
        self._thread = Thread(target=self._live, name='page', daemon=True)

    @property
    def url(self) -> str:
        host = self._server.get_host()
        host = {'0.0.0.0': '127.0.0.1', '::': '::1'}.get(host, host)
        return f'http://{f"[{host}]" if ":" in host else host}:{self._server.get_port()}'

    def start(self) -> None:
        self._source.start()
        self._draw(whole=True)
        self._thread.start()

    def close(self) -> None:
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join()
        self._server.end()
        self._source.close()

    def _live(self) -> None:
        due, watched = monotonic(), False
        while not self._ended.wait(max(0.0, due - monotonic())):
            # Late frames are skipped.
            due = max(due + 1.0 / FRAME_RATE, monotonic())
            if not self._server.get_clients():
                watched, due = False, monotonic() + 0.2
                continue
            if self._begin:
                self._begin = False
                self._source.apply('pause', False)
            self._draw(whole=not watched)
            watched = True

    def _draw(self, whole: bool) -> None:
        """Draw the current frame, completely or only the parts that are due."""
        frame = self._source.shown
        count, self.frames = self.frames, self.frames + 1
        with self._server.atomic():
            if frame is not None:
                self._stage.draw(self._source, frame)
                if whole or count % FRAMES_PER_READOUT == 0:
                    self._readouts.write(self._source, frame)
                    self._stage.draw_path(self._source, frame)
                if whole or count % FRAMES_PER_PLOT == 3:
                    self._readouts.plot(self._source, frame)
            if whole or count % FRAMES_PER_READOUT == 2:
                self._controls.refresh()
