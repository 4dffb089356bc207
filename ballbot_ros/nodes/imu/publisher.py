# SPDX-License-Identifier: Apache-2.0
"""An inertial sensor as a topic: a separate thread reads and publishes each sample."""
import threading
from typing import Callable, Mapping, Optional

from rclpy.node import Node
from sensor_msgs.msg import Imu

from ballbot_ros.clock import steady_time
from ballbot_ros.errors import LinkError
from ballbot_ros.imus.source import ImuPort, open_source, StampedReading
from ballbot_ros.nodes.bridge.motor import Clocks, imu_message
from ballbot_ros.ros import diagnostics
from ballbot_ros.ros.endpoints import create_publisher, has_subscribers
from ballbot_ros.ros.frames import FRAMES

# Published values: the table of docs/nodes.md.
VALUES: Mapping[str, str] = {
    'port': 'serial device or URL',
    'rate': 'readings per second since the last status',
    'readings': 'readings in total',
    'refused': 'packets with a wrong checksum',
    'skipped': 'bytes that belong to no packet',
    'unpaired': 'forces without a turn rate, or vice versa',
    'saturated': 'readings at a limit of the measurement range',
    'frozen': 'readings that were rejected as repetitions: the sensor is frozen',
    'lost': 'number of interrupted connections',
    'set_up': 'number of times that the sensor was configured'}
# Timeouts for reading bytes and for joining the thread [s].
READ_TIMEOUT, JOIN = 0.05, 2.0
# Warn below this fraction of the requested rate.
RATE_FRACTION_MIN = 0.9


class ImuOutput:
    """
    Reads a sensor until `end` is called, and publishes `imu` while there are subscribers.

    `take` receives each `StampedReading` before it is published, in the thread; `failure` is the
    error that ended the thread.
    """

    def __init__(self, node: Node, port: ImuPort, frame: str = FRAMES.imu,
                 take: Callable[[StampedReading], None] = lambda _: None):
        self._frame, self._port, self._take = frame, port, take
        self.source = open_source(port)
        self._clocks = Clocks()
        self.set_deviations(port.gyro_sd, port.force_sd)
        self._publisher = create_publisher(node, 'imu')
        self._counted, self._counted_at, self._rate = 0, steady_time(), 0.0
        self._diagnostics = diagnostics.Diagnostics(
            node, 'imu', self._health, f'imu on {port.port}')
        self.failure: Optional[LinkError] = None
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name='imu', daemon=True)
        self._thread.start()

    def set_deviations(self, gyro_sd: float, force_sd: float) -> None:
        """Set the standard deviations of the following readings [rad/s], [m/s2]."""
        self._covariances = [[sd**2, 0.0, 0.0, 0.0, sd**2, 0.0, 0.0, 0.0, sd**2]
                             for sd in (gyro_sd, force_sd)]

    def end(self) -> None:
        """End the thread and close the line."""
        self._ending.set()
        self._thread.join(JOIN)
        self.source.close()

    def _run(self) -> None:
        try:
            while not self._ending.is_set():
                for reading in self.source.read(READ_TIMEOUT):
                    self._take(reading)
                    if has_subscribers(self._publisher):
                        self._publisher.publish(self._message(reading))
        except Exception as error:  # noqa: BLE001 the owner reports any failure
            self.failure = LinkError(f'the reading thread ended: {error!r}', 'ended', 'port')

    def _message(self, reading: StampedReading) -> Imu:
        message = imu_message(self._clocks.stamp(reading.stamp), reading.turn_rate,
                              reading.force, self._frame)
        message.angular_velocity_covariance, message.linear_acceleration_covariance = \
            self._covariances
        return message

    def _health(self) -> diagnostics.Health:
        counts, now = dict(self.source.counts), steady_time()
        if now > self._counted_at:
            self._rate = (counts['readings'] - self._counted) / (now - self._counted_at)
        self._counted, self._counted_at = counts['readings'], now
        values = {'port': self._port.port, 'rate': f'{self._rate:.1f}', **counts}
        if self.source.trouble:
            return diagnostics.ERROR, self.source.trouble, values
        if self._rate < RATE_FRACTION_MIN * self._port.rate:
            return diagnostics.WARN, (
                f'{self._rate:.0f} readings a second, {self._port.rate} were requested'), values
        return diagnostics.OK, 'running', values
