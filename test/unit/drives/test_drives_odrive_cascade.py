# SPDX-License-Identifier: Apache-2.0
"""A drive that damps by itself between two commands: the law's rate term, closed in the drive."""
import math

from drive_bench import Bench
import pytest

from ballbot_ros.drives.odrive.ascii import codec
from ballbot_ros.errors import ConfigurationError, DriveError

DAMPING = 0.004  # N m s/rad
GAIN = 'axis0.controller.config.vel_gain'
INTEGRATOR = 'axis0.controller.config.vel_integrator_gain'


def bench(kind='odrive 0.5', **options):
    """Return a bench whose driver lets the drive damp."""
    return Bench(kind, **{'damping': DAMPING, **options})


def armed():
    """Return a bench whose motor is under power."""
    here = bench()
    here.driver.arm()
    return here


def turning(here, speed):
    """Return the torque when the shaft turns at a speed [rad/s]."""
    here.device.sensed = here.device.sensed._replace(velocity=speed)
    here.pass_time(0.001)
    return here.device.torque()


def test_a_velocity_command_has_the_form_of_the_documents():
    # docs/ascii-protocol.rst: v motor velocity torque_ff, in turn/s and N m.
    assert codec.velocity(0, -12.5, 0.05).startswith(b'v 0 -0.001250000e4 0.000005000e4 *')


def test_arming_sets_the_gains_that_damp_and_torque_stays_nothing_until_there_is_a_command():
    here = armed()
    assert here.device.properties[GAIN] == pytest.approx(DAMPING * math.tau)
    assert here.device.properties[INTEGRATOR] == 0.0
    assert here.device.armed and turning(here, 30.0) == 0.0


@pytest.mark.parametrize('torque, speed', [(0.03, 0.0), (0.03, 50.0), (-0.02, -200.0)])
def test_the_torque_is_that_of_the_command_at_its_speed_and_falls_with_it(torque, speed):
    here = armed()
    here.driver.send_damped(torque, speed)
    assert turning(here, speed) == pytest.approx(torque, abs=1e-5)
    for faster in (-5.0, -1.0, 2.0, 8.0):
        assert turning(here, speed + faster) == pytest.approx(
            torque - DAMPING * faster, abs=1e-5)


def test_what_the_drive_adds_stays_within_its_torque_limit():
    here = armed()
    here.driver.send_damped(0.05, 0.0)
    assert turning(here, -1000.0) == pytest.approx(0.1)
    assert turning(here, 1000.0) == pytest.approx(-0.1)
    here.driver.send_damped(55.0, 0.0)  # and a command within that of the driver
    assert turning(here, 0.0) == pytest.approx(0.1)


def test_no_torque_is_none_however_fast_the_shaft_turns():
    here = armed()
    here.driver.send_damped(0.05, 0.0)
    here.driver.send_damped(0.0, 0.0)
    assert turning(here, 300.0) == 0.0
    here.driver.send_damped(0.05, 0.0)
    here.driver.send_torque(0.02)  # nor is a torque of no law damped
    assert turning(here, 300.0) == pytest.approx(0.02)


def test_when_commands_end_the_watchdog_disarms_the_motor():
    here = armed()
    here.driver.send_damped(0.05, 10.0)
    here.pass_time(0.099)
    assert here.device.armed and here.device.torque() != 0.0
    here.pass_time(0.003)
    assert not here.device.armed and here.device.torque() == 0.0
    telemetry = here.cycles(50)
    assert telemetry.faults == ('WATCHDOG_TIMER_EXPIRED',)


def test_velocity_commands_feed_the_watchdog():
    here = armed()
    for _ in range(300):
        here.pass_time(0.002)
        here.driver.poll()
        here.driver.send_damped(0.01, 0.0)
    assert here.device.armed and here.driver.telemetry.faults == ()


def test_a_stop_stops_it():
    here = armed()
    here.driver.send_damped(0.05, 10.0)
    here.driver.stop()
    assert not here.device.armed and here.device.torque() == 0.0
    with pytest.raises(DriveError, match='not been armed'):
        here.driver.send_damped(0.05, 10.0)


@pytest.mark.parametrize('name', [GAIN, INTEGRATOR])
def test_a_drive_that_does_not_take_a_gain_is_not_armed(name):
    here = bench()
    here.driver.identify()
    here.device.properties[INTEGRATOR] = 2.0 / 6.0
    here.to_drive = lambda data: b'' if data.startswith(f'w {name}'.encode()) else data
    with pytest.raises(DriveError, match=f'{name} must be') as raised:
        here.driver.arm()
    assert raised.value.reason == 'not_armed' and not here.device.armed


def test_of_0_6_it_is_not_known_and_refused():
    here = bench('odrive 0.6')
    with pytest.raises(DriveError, match='firmware 0.6 takes velocity commands.*cascade to 0'):
        here.driver.arm()
    assert not here.device.armed
    wrong, = (item for item in here.driver.read_settings() if not item.acceptable)
    assert (wrong.name, wrong.remedy) == ('cascade', 'set cascade: 0 in the hardware file')


def test_a_driver_that_does_not_damp_sends_the_torque_as_it_is():
    here = Bench('odrive 0.5')
    here.driver.arm()
    here.driver.send_damped(0.05, 10.0)
    assert turning(here, 300.0) == pytest.approx(0.05)
    assert here.device.properties[GAIN] == pytest.approx(1.0 / 6.0)


@pytest.mark.parametrize('cut', range(1, 45))
def test_a_line_that_is_cut_short_or_loses_its_checksum_stays_within_the_limit(cut):
    # Worse than with torque commands, where it is next to nothing: this is why it is an option.
    here = armed()
    here.driver.send_damped(0.02, 50.0)
    turning(here, 50.0)
    line = codec.velocity(0, 55.0 / math.tau, 0.02)
    here.device.receive(line[:cut] + b';' + line[cut + 1:], here.now)
    assert abs(turning(here, 55.0)) <= 0.1 + 1e-9
    here.driver.send_damped(0.02, 55.0)
    assert turning(here, 55.0) == pytest.approx(0.02, abs=1e-5)


def test_the_wire_carries_the_longer_command():
    plain, damped = Bench('odrive 0.5').driver.budget(), bench().driver.budget()
    assert damped.bytes_out - plain.bytes_out == len(codec.velocity(0, -1e3, -0.1)) - len(
        codec.torque(0, -0.1))


def test_the_velocity_limit_that_the_drive_needs_is_that_of_the_gain_it_will_have():
    here = bench(speed_limit=600.0)
    here.device.properties[GAIN] = 1e-9  # from before
    assert all(item.acceptable for item in here.driver.read_settings())


def test_a_drive_that_damps_must_not_let_more_torque_through_than_is_commanded():
    for damping, accepted in ((0.0, True), (DAMPING, False)):
        here = bench(damping=damping, drive_torque_limit=0.2)
        here.device.properties.update({'axis0.motor.config.torque_lim': 0.15,
                                       'axis0.motor.config.current_lim': 50.0})
        limit, *_ = here.driver.read_settings()
        assert limit.name == 'torque limit' and limit.acceptable is accepted


def test_damping_is_not_below_zero():
    with pytest.raises(ConfigurationError, match='damping must be at least 0'):
        bench(damping=-1.0)
