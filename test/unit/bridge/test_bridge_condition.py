# SPDX-License-Identifier: Apache-2.0
"""Temperature and battery in a session: first a warning, then less torque, then a stop."""
import pytest
from refusals import refused
from virtual_robot import VirtualRobot

from ballbot_ros.bridge.condition import Battery, Thermal
from ballbot_ros.bridge.supervisor import StopReason
from ballbot_ros.errors import RefusedError


def robot(battery=Battery(), thermal=Thermal(), **arguments):
    """Return a robot whose shell is held, ready to drive."""
    return VirtualRobot(held=True, **arguments).change(battery=battery, thermal=thermal).ready()


def test_a_hot_power_stage_reduces_the_torque_before_the_drive_trips():
    found = robot(thermal=Thermal(drive_warn_at=80.0, drive_zero_at=90.0), torque_limit=1.0)
    assert found.run(0.3, torque=1.0).torque == 1.0
    found.temperature = 85.0
    report = found.run(0.5, torque=1.0)  # longer than the interval between temperature readings
    assert report.condition.part == pytest.approx(0.5, abs=0.02)
    assert report.torque == pytest.approx(0.5, abs=0.02)
    assert report.condition.warnings == ('drive_hot',) and not report.e_stop
    found.temperature = 40.0
    report = found.run(0.5, torque=0.5)
    assert report.torque == 0.5 and report.condition.part == 1.0 and not report.condition.warnings


def test_torque_above_the_continuous_torque_decays_to_it():
    found = robot(thermal=Thermal(continuous_torque=0.4, time_constant=0.2), torque_limit=0.8)
    assert found.run(0.05, torque=0.8).torque == pytest.approx(0.8)
    report = found.run(1.5, torque=0.8)
    assert 0.4 <= report.torque < 0.5 and report.condition.warnings == ('motor_i2t',)
    assert 0.9 < report.condition.warmth < 1.05


@pytest.mark.slow
def test_an_empty_battery_lowers_the_pendulum_before_the_e_stop_and_inhibits_its_release():
    found = robot(battery=Battery(low_voltage=22.0, empty_voltage=21.0, smoothing=0.1,
                                  empty_time=0.5, fade_time=1.0))
    raised = found.run(1.5, torque=1.0)
    angle = raised.estimate.readings.pendulum_angle
    assert angle > 0.5 and not raised.condition.warnings
    found.bus_voltage = 20.0
    report = found.run(0.5, torque=1.0)
    assert report.condition.warnings == ('battery_low',) and report.torque == pytest.approx(1.0)
    faded = found.run(1.1, torque=1.0)
    assert 'battery_empty' in faded.condition.warnings
    assert 0.0 < faded.estimate.readings.pendulum_angle < 0.7 * angle
    assert abs(faded.estimate.readings.pendulum_rate) < 2.0  # lowered, not dropped
    stopped = found.run(0.6, torque=1.0)
    assert stopped.e_stop.reason is StopReason.BATTERY_EMPTY
    found.bus_voltage = 21.5  # the voltage recovers without load
    found.run(2.0)
    with refused('standing', 'battery', RefusedError):
        found.session.release()
    found.bus_voltage = 24.0
    found.run(2.0)
    found.session.release()


def test_the_release_is_refused_with_an_empty_battery():
    found = VirtualRobot(held=True).change(battery=Battery(
        empty_voltage=25.0, empty_time=0.2, fade_time=0.1)).active()
    found.run(0.6)
    with refused('standing', 'battery', RefusedError):
        found.session.release()
