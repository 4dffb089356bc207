# SPDX-License-Identifier: Apache-2.0
"""The table of the drives; test_extending.py adds one."""
from importlib import util
from pathlib import Path
import random

import pytest
from refusals import refused

from ballbot_ros import drives
from ballbot_ros.drives import device_class, driver_class, open_driver, read_options
from ballbot_ros.errors import ConfigurationError

TARGETS = Path(__file__).resolve().parents[3] / 'fuzz' / 'targets.py'


def fuzz_targets():
    """Return the fuzz targets of all registered drives."""
    spec = util.spec_from_file_location('targets', TARGETS)
    module = util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.TARGETS


def test_a_drive_is_fuzzed_once_it_is_registered(monkeypatch):
    monkeypatch.setitem(drives.DRIVES, 'own', drives.DRIVES['vesc'])
    targets = fuzz_targets()
    assert {'own host', 'own drive', 'vesc host'} <= set(targets)
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
