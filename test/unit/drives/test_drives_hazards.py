# SPDX-License-Identifier: Apache-2.0
"""Hazards that stop an armed motor without a reported fault, and a second motor output."""
from contextlib import suppress

from drive_bench import Bench
import pytest
from tiers import slow

from ballbot_ros.drives.can_frames import CanFrame, record
from ballbot_ros.drives.emulated_device import DriveSettings
from ballbot_ros.drives.odrive.cansimple import codec as cansimple
from ballbot_ros.drives.vesc.can import codec as vesc_can
from ballbot_ros.errors import DriveError


def armed(kind, settings=None, **options):
    """Return a bench whose motor is armed."""
    bench = Bench(kind, settings, **options)
    bench.driver.identify()
    bench.driver.read_settings()
    bench.driver.arm()
    assert bench.cycles(100, torque=0.01).hazards == ()
    return bench


@pytest.mark.parametrize('kind', [
    'odrive 0.6', *slow('odrive 0.5', 'odrive_can 0.5', 'odrive_can 0.6', 'vesc_can', 'roboclaw')])
def test_settings_that_stay_are_no_hazard(kind):
    bench = armed(kind)
    for _ in range(25):
        assert bench.cycles(100, torque=0.01).hazards == ()


@pytest.mark.parametrize('kind, frame', [
    ('odrive_can 0.5', CanFrame(cansimple.SET_INPUT_TORQUE, bytes(4))),
    ('odrive_can 0.6', CanFrame(cansimple.SET_INPUT_TORQUE, bytes(4))),
    ('vesc_can', vesc_can.packet(vesc_can.SET_CURRENT, 0, bytes(4)))])
def test_torque_frames_of_another_sender_are_a_hazard_under_power(kind, frame):
    bench = armed(kind)
    bench.waiting.append((bench.now, record(frame)))
    assert bench.cycles(2, torque=0.01).hazards[0].setting == ''
    bench.driver.stop()
    bench.driver.arm()
    assert bench.driver.poll().hazards == ()


@pytest.mark.parametrize('firmware, name, value', [
    ('0.5', 'axis0.motor.config.torque_lim', 0.5), ('0.6', 'axis0.config.watchdog_timeout', 3.0),
    *slow(('0.5', 'axis0.config.watchdog_timeout', 3.0),
          ('0.5', 'axis0.config.enable_watchdog', 0),
          ('0.5', 'axis0.motor.config.current_lim', 60.0),
          ('0.6', 'axis0.config.torque_soft_max', 0.5),
          ('0.6', 'axis0.controller.config.control_mode', 2))])
def test_a_setting_of_an_odrive_that_changes_under_power_is_a_hazard(firmware, name, value):
    bench = armed(f'odrive {firmware}')
    bench.device.properties[name] = value
    hazard, = bench.cycles(2500, torque=0.01).hazards
    assert hazard.setting == name


def test_a_current_limit_of_a_roboclaw_that_changes_under_power_is_a_hazard():
    bench = armed('roboclaw')
    bench.device.settings = DriveSettings(torque_limit=1.0, current_limit=40.0)
    hazard, = bench.cycles(200, torque=0.01).hazards
    assert hazard.setting == 'max current [A]'


@pytest.mark.parametrize('boot_time', [0.005, 0.03, 0.09])
def test_a_roboclaw_that_restarts_under_power_stops_by_itself_when_commands_end(boot_time):
    bench = armed('roboclaw', DriveSettings(watchdog=0.0, boot_time=boot_time))
    bench.device.reboot(bench.now)
    bench.cycles(100, torque=0.05)
    assert bench.device.torque() > 0.0
    bench.pass_time(0.12)  # the process is killed: no more bytes are sent
    bench.device.tick(bench.now)
    assert bench.device.torque() == 0.0


@pytest.mark.parametrize('kind', ['odrive 0.5', 'roboclaw'])
def test_the_motor_on_the_second_output_is_driven_with_the_option_axis(kind):
    bench = armed(kind, DriveSettings(axis=1), axis=1)
    bench.sense(position=3.0)
    telemetry = bench.cycles(10, torque=0.05)
    assert bench.device.torque() == pytest.approx(0.05, rel=0.05)
    assert telemetry.position == pytest.approx(3.0, abs=0.01) and telemetry.armed
    bench.device.over_current()
    telemetry = bench.cycles(200, torque=0.05)
    assert telemetry.faults and not telemetry.armed
    bench.driver.stop()
    assert bench.device.torque() == 0.0


@pytest.mark.parametrize('kind', ['odrive 0.5', 'roboclaw'])
def test_the_output_without_a_motor_gets_no_torque(kind):
    bench = Bench(kind, DriveSettings(axis=1))
    bench.driver.identify()
    with suppress(DriveError):  # an ODrive does not report its state
        bench.driver.arm()
        bench.cycles(10, torque=0.05)
    assert bench.device.torque() == 0.0
