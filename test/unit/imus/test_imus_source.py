# SPDX-License-Identifier: Apache-2.0
"""A sensor on a line: configured, found at another baud rate, unplugged, frozen, reconnected."""
from types import SimpleNamespace

import pytest

from ballbot_ros.drives.memory_line import MemoryLine
from ballbot_ros.imus import source as source_module
from ballbot_ros.imus.plausibility import EXPLANATIONS
from ballbot_ros.imus.source import Axes, ImuSource
from ballbot_ros.imus.witmotion.emulated import EmulatedWitMotion
from ballbot_ros.imus.witmotion.protocol import WitMotion

TICK = 0.001


class SensorLine(MemoryLine):
    """A sensor, a cable, and a clock that only the test advances."""

    port = 'line'

    def __init__(self):
        super().__init__(EmulatedWitMotion())
        self.now, self.baud, self.lines, self.noise = 50.0, 0, 0, 0

    def connect(self, baud):
        """Open the line."""
        self._check()
        self.baud, self.waiting = baud, []
        self.lines += 1
        return self

    def close(self):
        """Decrement the number of open lines."""
        self.lines -= 1

    def sleep(self, seconds):
        """Advance time; the sensor sends its readings."""
        end = self.now + seconds
        while self.now < end:
            self.pass_time(TICK)

    def live(self):
        """Run the sensor up to now."""
        self.noise += 1
        # Readings never repeat, as those of a real sensor.
        x, y, z = self.device.force
        self.device.force = (x, y, 9.81 + 0.01 * (self.noise % 7))
        data = self.device.tick(self.now)
        # At another baud rate every byte differs.
        self.waiting.append((self.now, data if self.baud == self.device.baud else bytes(
            (value * 7 + 3) % 256 for value in data[::2])))

    def write(self, data):
        """Send bytes to the sensor."""
        self._check()
        if self.baud == self.device.baud:
            self.device.receive(data)


def source_of(line, axes='x y z', baud=115200, rate=200, latency=0.003):
    """Return a source on a line."""
    return ImuSource(WitMotion(baud, rate, 98), line.connect, Axes(axes), latency)


def run(line, source, seconds):
    """Return the readings of some seconds."""
    end, found = line.now + seconds, []
    while line.now < end:
        found += source.read(0.05)
    return found


@pytest.fixture
def line(monkeypatch):
    """Return a line with a sensor, whose clock the source uses."""
    line = SensorLine()
    monkeypatch.setattr(source_module, 'steady_time', line.clock)
    monkeypatch.setattr(source_module, 'time', SimpleNamespace(
        sleep=lambda seconds: line.sleep(seconds)))
    return line


@pytest.fixture
def reading(line):
    """Return a line with a sensor and a source that reads from it."""
    source = source_of(line)
    run(line, source, 2.0)
    return line, source


def test_a_sensor_in_factory_settings_is_found_and_configured(line):
    source = source_of(line)
    assert run(line, source, 2.5)
    assert line.device.baud == 115200 and not source.trouble
    assert len(run(line, source, 1.0)) == pytest.approx(200, abs=2)


def test_a_sensor_at_the_right_baud_rate_is_configured_once(line):
    line.device.registers[4] = 6
    source = source_of(line)
    assert len(run(line, source, 1.2)) >= 190
    assert source.counts['set_up'] == 1


def test_readings_are_in_the_axes_of_the_shell(reading):
    line, _ = reading
    line.device.turn_rate, line.device.force = (0.1, 0.2, 0.3), (1.0, 2.0, 9.81)
    source = source_of(line, axes='-y x z')
    last = run(line, source, 0.5)[-1]
    assert last.turn_rate == pytest.approx((-0.2, 0.1, 0.3), abs=0.002)
    assert last.force[:2] == pytest.approx((-2.0, 1.0), abs=0.01)


def test_a_stamp_is_the_time_of_measurement_and_not_of_arrival(reading):
    line, source = reading
    last = run(line, source, 0.5)[-1]
    on_the_wire = 22 * 10 / 115200
    assert line.now - last.stamp == pytest.approx(0.003 + on_the_wire, abs=2.0 * TICK)


def test_stamps_are_evenly_spaced_although_the_thread_is_delayed(reading):
    line, source = reading
    found = []
    for number in range(60):
        line.sleep(0.013 if number % 5 else 0.019)
        found += source.read(0.0)
    steps = [after.stamp - before.stamp for before, after in zip(found[10:], found[11:])]
    assert min(steps) > 0.003 and max(steps) < 0.007


def test_old_readings_are_not_stamped_as_new_after_a_long_delay_of_the_thread(reading):
    line, source = reading
    line.sleep(0.1)
    found = source.read(0.0)
    assert found[-1].stamp - found[0].stamp == pytest.approx(0.005 * (len(found) - 1), abs=0.002)
    assert len(found) == pytest.approx(20, abs=1)


def test_a_replugged_sensor_is_found_and_configured_again(reading):
    line, source = reading
    line.plugged = False
    assert not run(line, source, 1.0)
    assert 'cable' in source.trouble and source.counts['lost'] == 1 and line.lines == 0
    line.device.boot()  # without power, the sensor loses its settings
    line.plugged = True
    assert run(line, source, 3.0) and not source.trouble
    assert len(run(line, source, 1.0)) == pytest.approx(200, abs=2)


def test_repeated_readings_are_not_used(reading):
    line, source = reading
    line.live = lambda: None
    frozen = EmulatedWitMotion()
    frozen.registers.update(line.device.registers)
    found = []
    for _ in range(400):
        line.now += 0.005
        line.waiting = [(line.now, frozen.tick(line.now))]
        found += source.read(0.0)
    assert len(found) <= 51 and source.counts['frozen'] >= 340
    assert source.trouble == EXPLANATIONS['imu_frozen']


def test_saturated_readings_are_counted(reading):
    line, source = reading
    line.device.turn_rate = (50.0, 0.0, 0.0)
    last = run(line, source, 0.5)[-1]
    assert last.saturated and source.counts['saturated'] > 50
    assert last.turn_rate[0] == pytest.approx(34.9, abs=0.1)


def test_a_silent_sensor_is_reported_with_port_and_baud_rate(reading):
    line, source = reading
    line.device.tick = lambda now: b''
    assert not run(line, source, 2.0)
    assert line.port in source.trouble
    assert any(str(baud) in source.trouble for baud in (9600, 115200))


def test_noise_is_counted_and_gives_no_reading(reading):
    line, source = reading
    line.device.tick = lambda now: b'\x12\x34'
    assert not run(line, source, 2.0)
    assert source.counts['skipped'] > 100 and source.trouble


def test_a_closed_source_leaves_no_line_open(reading):
    line, source = reading
    source.close()
    source.close()
    assert line.lines == 0
