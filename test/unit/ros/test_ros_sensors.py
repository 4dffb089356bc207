# SPDX-License-Identifier: Apache-2.0
"""Lockstep refuses sensor settings that prevent one answer per period."""
import pytest
from refusals import refused

from ballbot_ros.nodes.simulator.outputs import check_lockstep
from ballbot_ros.nodes.simulator.settings import SimulatorSettings


@pytest.mark.parametrize('given, named', [
    ({'observation_rate': 50.0}, 'terrain_rate'), ({'sensor_latency': 0.1}, 'sensor_latency'),
    ({'sensor_dropout': 0.1}, 'sensor_dropout')])
def test_lockstep_refuses_repeated_late_and_missing_observations(given, named):
    with refused('inconsistent', named):
        check_lockstep(SimulatorSettings(lockstep=True).changed(given))


def test_lockstep_accepts_one_sensor_of_either_kind():
    check_lockstep(SimulatorSettings(lockstep=True))
    check_lockstep(SimulatorSettings(lockstep=True, terrain_rate=0.0, observation_rate=50.0))
