# SPDX-License-Identifier: Apache-2.0
"""A sensor on a line: set up, found at another baud rate, unplugged, frozen, back again."""
import pytest

from ballbot_ros.errors import ConfigurationError, LinkError
from ballbot_ros.imus.axes import Axes
from ballbot_ros.imus.emulated import EmulatedWitMotion
from ballbot_ros.imus.source import ImuSource

TICK = 0.001


class Desk:
    """A sensor, a cable, and a clock that only the test moves."""

    port = 'desk'

    def __init__(self):
        self.device, self.now, self.plugged = EmulatedWitMotion(), 50.0, True
        self.baud, self.waiting, self.lines = 0, b'', 0
        self.noise = 0

    def connect(self, baud):
        """Open the line."""
        if not self.plugged:
            raise LinkError('missing', 'desk is not there')
        self.baud, self.waiting = baud, b''
        self.lines += 1
        return self

    def close(self):
        """Count it."""
        self.lines -= 1

    def clock(self):
        """Return the time [s]."""
        return self.now

    def sleep(self, seconds):
        """Let time pass; the sensor talks."""
        end = self.now + seconds
        while self.now < end:
            self.now += TICK
            self.noise += 1
            # No two readings are alike, as of a real one.
            x, y, z = self.device.force
            self.device.force = (x, y, 9.81 + 0.01 * (self.noise % 7))
            data = self.device.tick(self.now)
            # At another baud rate every byte is another one.
            self.waiting += data if self.baud == self.device.baud else bytes(
                (value * 7 + 3) % 256 for value in data[::2])

    def wait(self, seconds):
        """Wait until bytes come."""
        end = self.now + seconds
        while not self.waiting and self.now < end:
            self.sleep(TICK)
        if not self.plugged:
            raise LinkError('gone', 'desk was unplugged')
        return bool(self.waiting)

    def read(self):
        """Return what has come."""
        data, self.waiting = self.waiting, b''
        return data

    def write(self, data):
        """Give bytes to the sensor."""
        if not self.plugged:
            raise LinkError('gone', 'desk was unplugged')
        if self.baud == self.device.baud:
            self.device.receive(data)


def source_of(desk, axes='x y z', baud=115200, rate=200, latency=0.003):
    """Return a source on a desk."""
    return ImuSource(desk.connect, baud, rate, 98, Axes(axes), latency, desk.clock, desk.sleep)


def run(desk, source, seconds):
    """Return what is read in a while."""
    end, found = desk.now + seconds, []
    while desk.now < end:
        found += source.read(0.05)
    return found


@pytest.fixture
def reading():
    """Return a desk and a source that reads from it."""
    desk = Desk()
    source = source_of(desk)
    run(desk, source, 2.0)
    return desk, source


def test_a_sensor_as_it_leaves_the_factory_is_found_and_told_to_be_quick():
    desk = Desk()
    source = source_of(desk)
    assert run(desk, source, 2.5)
    assert desk.device.baud == 115200 and not source.trouble
    assert len(run(desk, source, 1.0)) == pytest.approx(200, abs=2)


def test_a_sensor_that_is_quick_already_is_only_set_up():
    desk = Desk()
    desk.device.registers[4] = 6
    source = source_of(desk)
    assert len(run(desk, source, 1.2)) >= 190
    assert source.counts['set_up'] == 1


def test_readings_are_in_the_axes_of_the_shell(reading):
    desk, _ = reading
    desk.device.turn_rate, desk.device.force = (0.1, 0.2, 0.3), (1.0, 2.0, 9.81)
    source = source_of(desk, axes='-y x z')
    last = run(desk, source, 0.5)[-1]
    assert last.turn_rate == pytest.approx((-0.2, 0.1, 0.3), abs=0.002)
    assert last.force[:2] == pytest.approx((-2.0, 1.0), abs=0.01)


def test_a_stamp_is_that_of_the_measurement_and_not_of_the_arrival(reading):
    desk, source = reading
    last = run(desk, source, 0.5)[-1]
    on_the_wire = 22 * 10 / 115200
    assert desk.now - last.stamp == pytest.approx(0.003 + on_the_wire, abs=2.0 * TICK)


def test_stamps_are_even_though_the_thread_is_held_up(reading):
    desk, source = reading
    found = []
    for number in range(60):
        desk.sleep(0.013 if number % 5 else 0.019)
        found += source.read(0.0)
    steps = [after.stamp - before.stamp for before, after in zip(found[10:], found[11:])]
    assert min(steps) > 0.003 and max(steps) < 0.007


def test_an_unplugged_sensor_is_found_again_and_set_up_again(reading):
    desk, source = reading
    desk.plugged = False
    assert not run(desk, source, 1.0)
    assert 'desk' in source.trouble and source.counts['lost'] == 1 and desk.lines == 0
    desk.device.boot()  # without power it has forgotten
    desk.plugged = True
    assert run(desk, source, 3.0) and not source.trouble
    assert len(run(desk, source, 1.0)) == pytest.approx(200, abs=2)


def test_a_sensor_that_repeats_itself_measures_nothing(reading):
    desk, source = reading
    desk.sleep = lambda seconds: None
    frozen = EmulatedWitMotion()
    frozen.registers.update(desk.device.registers)
    found = []
    for _ in range(400):
        desk.now += 0.005
        desk.waiting = frozen.tick(desk.now)
        found += source.read(0.0)
    assert len(found) <= 51 and source.counts['frozen'] >= 340
    assert 'same numbers' in source.trouble


def test_the_end_of_the_range_is_counted(reading):
    desk, source = reading
    desk.device.turn_rate = (50.0, 0.0, 0.0)
    last = run(desk, source, 0.5)[-1]
    assert last.saturated and source.counts['saturated'] > 50
    assert last.turn_rate[0] == pytest.approx(34.9, abs=0.1)


def test_silence_is_told_with_port_and_baud_rate(reading):
    desk, source = reading
    desk.device.tick = lambda now: b''
    assert not run(desk, source, 2.0)
    assert 'no readings at' in source.trouble and 'baud on desk' in source.trouble


def test_noise_is_told_for_what_it_is(reading):
    desk, source = reading
    desk.device.tick = lambda now: b'\x12\x34'
    assert not run(desk, source, 2.0)
    assert 'bytes come that make no sense' in source.trouble


def test_a_closed_source_leaves_no_line_open(reading):
    desk, source = reading
    source.close()
    source.close()
    assert desk.lines == 0


@pytest.mark.parametrize('arguments, said', [
    ({'rate': 200, 'baud': 38400}, '200 readings a second take 44000 bit/s'),
    ({'rate': 150}, 'rate of a WitMotion sensor'), ({'baud': 100000}, 'baud rate')])
def test_what_cannot_work_is_refused_at_the_start(arguments, said):
    with pytest.raises(ConfigurationError, match=said):
        source_of(Desk(), **arguments)
