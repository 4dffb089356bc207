# SPDX-License-Identifier: Apache-2.0
"""Faults of the bytes on a line falsify no measurement, with any protocol."""
import random

import pytest

from ballbot_ros.emulator.line import LineFaults

POSITION, VOLTAGE = 2.5, 21.5  # of the shaft [rad], of the supply [V]
READINGS = 50


def damage(**faults):
    """Return a fault of both directions of a bench."""
    def plant(bench, rng):
        bad = LineFaults(**faults)
        bench.to_drive = bench.from_drive = lambda data: bad.damage(data, rng)
    return plant


def delay(bench, rng):
    """Let replies arrive 20 ms later."""
    bench._delay += 0.02


def garbage(bench, rng):
    """Insert a random byte before some of the replies."""
    bench.from_drive = lambda data: rng.randbytes(rng.random() < 0.2) + data if data else data


@pytest.mark.slow
@pytest.mark.parametrize('fault', [
    damage(corrupt=0.02), damage(drop=0.02), damage(duplicate=0.02), delay, garbage],
    ids=['corrupt', 'drop', 'duplicate', 'delay', 'garbage'])
def test_telemetry_stays_true_on_a_bad_line(bench, fault):
    def read():
        bench.driver.ask()
        bench.pass_time(0.004)
        return bench.driver.poll()
    bench.sense(position=POSITION, bus_voltage=VOLTAGE)
    for _ in range(200):
        last = read()
    fault(bench, random.Random(5))
    found = {}
    for _ in range(100 * READINGS):
        telemetry = read()
        if telemetry.time != last.time:
            found[telemetry.time] = telemetry
        if len(found) == READINGS:
            break
    assert len(found) == READINGS
    for telemetry in found.values():
        assert telemetry.position == pytest.approx(POSITION, abs=0.01)
        assert telemetry.bus_voltage in (None, pytest.approx(VOLTAGE, abs=0.01))
