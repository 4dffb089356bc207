# SPDX-License-Identifier: Apache-2.0
"""What every driver does, whatever its protocol."""
import math

from drive_bench import Bench
import pytest

from ballbot_ros.drives.emulated_device import DriveSettings
from ballbot_ros.errors import DriveError, MessageError


def test_a_drive_tells_who_it_is(bench, kind):
    identity = bench.driver.identify()
    assert f'{identity.protocol} {identity.generation}'.strip() == kind
    assert identity.firmware.startswith(identity.generation)
    assert identity.in_words.endswith(identity.generation)


def test_a_vesc_that_would_misunderstand_is_refused(monkeypatch):
    monkeypatch.setattr('ballbot_ros.drives.vesc.emulated.FIRMWARE', (3, 40))
    with pytest.raises(DriveError, match='3.40') as raised:
        Bench('vesc').driver.identify()
    assert raised.value.reason == 'firmware'


def test_settings_that_will_do_are_accepted(bench):
    settings = bench.driver.read_settings()
    assert {setting.name for setting in settings} >= {'watchdog'}
    assert all(setting.acceptable for setting in settings), settings


def test_a_watchdog_that_is_off_is_not_accepted(kind):
    bench = Bench(kind, DriveSettings(watchdog=0.0))
    watchdog, = (item for item in bench.driver.read_settings() if item.name == 'watchdog')
    assert not watchdog.acceptable and watchdog.remedy


def test_a_watchdog_that_is_too_slow_is_not_accepted(kind):
    bench = Bench(kind, DriveSettings(watchdog=2.0))
    watchdog, = (item for item in bench.driver.read_settings() if item.name == 'watchdog')
    assert not watchdog.acceptable


def test_a_torque_reaches_the_motor_once_armed(bench):
    bench.driver.arm()
    bench.cycles(20, torque=0.05)
    assert bench.device.torque() == pytest.approx(0.05, abs=2e-3)


def test_more_than_the_limit_is_cut(bench):
    bench.driver.arm()
    bench.cycles(20, torque=-3.0)
    assert -0.102 < bench.device.torque() < -0.09


@pytest.mark.parametrize('torque', [math.nan, math.inf, -math.inf])
def test_a_torque_that_is_not_finite_is_refused_and_not_sent(bench, torque):
    bench.driver.arm()
    bench.cycles(5, torque=0.02)
    sent = bench.driver.counts['sent']
    with pytest.raises(MessageError, match='finite'):
        bench.driver.send_torque(torque)
    assert bench.driver.counts['sent'] == sent


def test_the_drive_lets_go_by_itself_without_commands(bench):
    bench.driver.arm()
    bench.cycles(20, torque=0.05)
    for _ in range(150):
        bench.pass_time(0.001)
    assert bench.device.torque() == 0.0


def test_questions_alone_do_not_feed_the_watchdog(bench):
    bench.driver.arm()
    bench.cycles(20, torque=0.05)
    for _ in range(150):
        bench.pass_time(0.001)
        bench.driver.poll()
        bench.driver.ask()
    assert bench.device.torque() == 0.0


def test_feeding_keeps_the_torque(bench):
    bench.driver.arm()
    bench.cycles(20, torque=0.05)
    for _ in range(300):
        bench.pass_time(0.001)
        bench.driver.feed()
        bench.driver.poll()
    assert bench.device.torque() == pytest.approx(0.05, abs=2e-3)


def test_a_stop_is_confirmed(bench):
    bench.driver.arm()
    bench.cycles(20, torque=0.05)
    bench.driver.stop()
    assert bench.device.torque() == 0.0
    assert bench.driver.telemetry.armed is False


def test_a_stop_is_repeated_while_the_line_loses_it(bench):
    bench.driver.arm()
    bench.cycles(20, torque=0.05)
    lost = []
    deliver = bench.to_drive
    bench.to_drive = lambda data: lost.append(data) or b'' if len(lost) < 5 else deliver(data)
    bench.driver.stop()
    assert len(lost) == 5 and bench.device.torque() == 0.0


def test_a_stop_that_nobody_confirms_is_an_error(bench):
    bench.driver.arm()
    bench.to_drive = lambda data: b''
    with pytest.raises(DriveError, match='did not confirm') as raised:
        bench.driver.stop(patience=0.2)
    assert raised.value.reason == 'not_stopped'


def test_nobody_at_the_other_end_is_silence(kind):
    bench = Bench(kind)
    bench.to_drive = lambda data: b''
    with pytest.raises(DriveError) as raised:
        bench.driver.identify(patience=0.2)
    assert raised.value.reason == 'silent'
    assert bench.now < 0.5


def test_bytes_that_make_no_sense_are_told_from_silence(kind):
    bench = Bench(kind)
    bench.from_drive = lambda data: bytes(0xAA ^ byte >> 1 for byte in data)
    with pytest.raises(DriveError) as raised:
        bench.driver.identify(patience=0.2)
    assert raised.value.reason == 'garbled'


def test_a_lost_reply_keeps_the_loop_going(bench):
    bench.driver.arm()
    deliver, count = bench.from_drive, iter(range(10**6))
    bench.from_drive = lambda data: b'' if next(count) % 3 == 0 else deliver(data)
    before = bench.now
    bench.cycles(500, torque=0.01)
    assert bench.now - before == pytest.approx(1.0)  # no wait in between
    assert bench.driver.counts['lost'] > 50
    assert bench.driver.telemetry.time > bench.now - 0.02


def test_no_torque_is_sent_before_arming_or_after_a_stop(bench):
    with pytest.raises(DriveError, match='armed'):
        bench.driver.send_torque(0.05)
    bench.driver.arm()
    bench.cycles(20, torque=0.05)
    bench.driver.stop()
    with pytest.raises(DriveError, match='armed'):
        bench.driver.send_torque(0.05)
    assert bench.device.torque() == 0.0


def test_position_velocity_and_health_are_told(bench):
    bench.device.sensed = bench.device.sensed._replace(
        position=2.3, velocity=-45.0, bus_voltage=23.5, temperature=41.0)
    bench.driver.arm()
    telemetry = bench.cycles(400, torque=0.05)
    assert telemetry.position == pytest.approx(2.3, abs=2e-3)
    assert telemetry.velocity == pytest.approx(-45.0, rel=0.01)
    assert telemetry.bus_voltage == pytest.approx(23.5, abs=0.06)
    assert telemetry.temperature == pytest.approx(41.0, abs=0.1)
    assert telemetry.current == pytest.approx(2.0, abs=0.1)
    assert telemetry.armed is True and telemetry.faults == ()


def test_the_position_goes_on_over_full_turns_although_replies_are_lost(bench):
    bench.driver.arm()
    start = bench.cycles(10).position
    bench.device.sensed = bench.device.sensed._replace(position=1234.5)
    assert bench.cycles(10).position - start == pytest.approx(1234.5, abs=2e-3)
    bench.device.sensed = bench.device.sensed._replace(position=-987.6)
    assert bench.cycles(10).position - start == pytest.approx(-987.6, abs=2e-3)


def test_a_fault_is_named_and_takes_the_power_off(bench):
    bench.driver.arm()
    bench.device.over_current()
    telemetry = bench.cycles(100, torque=0.05)
    assert telemetry.faults and telemetry.armed is False
    assert bench.device.torque() == 0.0


def test_the_budget_covers_what_really_goes_over_the_line(bench):
    written, received = [], []
    bench.to_drive = lambda data: written.append(len(data)) or data
    bench.from_drive = lambda data: received.append(len(data)) or data
    bench.device.sensed = bench.device.sensed._replace(position=-12345.6, velocity=-987.6)
    bench.driver.arm()
    written.clear()
    received.clear()
    bench.cycles(400, torque=-0.09)
    budget = bench.driver.budget()
    assert 0.5 * budget.bytes_out < max(written) <= budget.bytes_out
    assert 0.5 * budget.bytes_in < max(received) <= budget.bytes_in
