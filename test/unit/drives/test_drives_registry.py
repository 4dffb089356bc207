# SPDX-License-Identifier: Apache-2.0
"""One line registers a drive: all else is found from it."""
from importlib import util
from pathlib import Path
import random

import pytest
from refusals import refused
from waiting import wait_until

from ballbot_ros import drives
from ballbot_ros.drives import device_class, driver_class, open_driver, read_options
from ballbot_ros.drives.transport import Link
from ballbot_ros.emulator.emulator import Emulator
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics.simulation.scene import load_scene

TARGETS = Path(__file__).resolve().parents[3] / 'fuzz' / 'targets.py'


@pytest.fixture
def toy(monkeypatch):
    """Register a fourth drive."""
    monkeypatch.setitem(drives.DRIVES, 'toy', drives.Vendor('toy_drive', 'Toy', 'ToyDevice'))
    return 'toy'


def fuzz_targets():
    """Return the fuzz targets of all drives that are registered now."""
    spec = util.spec_from_file_location('targets', TARGETS)
    module = util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.TARGETS


def test_a_fourth_drive_turns_the_motor_behind_the_emulator(toy):
    with Emulator(toy, load_scene('flat')) as emulator, Link(emulator.path, 115200) as link:
        driver = open_driver(toy, link, read_options(toy, {'torque_limit': 0.05}, 'test'))
        assert driver.identify().protocol == toy and driver.read_settings() == ()
        driver.arm()
        wait_until(lambda: driver.poll().armed, lambda: driver.send_torque(0.02))
        assert emulator.torque == 0.02 and driver.telemetry.armed
        assert driver.baud_rates == (115200,)  # where a driver names none
        driver.stop()
        assert emulator.torque == 0.0 and not driver.telemetry.armed
        assert emulator.state.pendulum_rate != 0.0


def test_a_fourth_drive_is_fuzzed_like_the_others(toy):
    targets = fuzz_targets()
    assert {'toy host', 'toy drive', 'vesc host'} <= set(targets)
    rng = random.Random(1)
    for name, (fuzz, protocol) in targets.items():
        fed = [fuzz(protocol, rng.randbytes(600)) for _ in range(10)]
        assert all(size > 300 for size, _ in fed), name
        assert name.endswith('drive') or sum(messages for _, messages in fed) > 0, name


@pytest.mark.parametrize('find', [driver_class, device_class, drives.codec_of])
def test_an_unknown_protocol_gets_a_suggestion(find):
    with refused('unknown_name', 'protocol', ConfigurationError):
        find('odriv')


def test_an_unknown_option_is_named():
    with refused('unknown_name', 'axes', ConfigurationError):
        read_options('odrive', {'torque_limit': 0.1, 'axes': 0}, 'hardware.yaml')


def test_the_options_of_another_drive_are_refused():
    with refused('wrong_type', 'drive', ConfigurationError):
        open_driver('vesc', None, read_options('odrive', {'torque_limit': 0.1}, 'test'))
