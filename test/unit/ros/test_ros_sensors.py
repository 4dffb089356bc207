# SPDX-License-Identifier: Apache-2.0
"""What of the simulated sensors would leave a lockstep run without its one answer a period."""
import pytest
from refusals import refused

from ballbot_ros.nodes.simulator.outputs import check_lockstep
from ballbot_ros.nodes.simulator.settings import SimulatorSettings


@pytest.mark.parametrize('given, named', [
    ({'observation_rate': 50.0}, 'terrain_rate'), ({'sensor_latency': 0.1}, 'sensor_latency'),
    ({'sensor_dropout': 0.1}, 'sensor_dropout')])
def test_in_lockstep_each_observation_comes_once_and_immediately(given, named):
    with refused('inconsistent', named):
        check_lockstep(SimulatorSettings(lockstep=True, **given))


def test_one_sensor_of_either_kind_goes_with_lockstep():
    check_lockstep(SimulatorSettings(lockstep=True))
    check_lockstep(SimulatorSettings(lockstep=True, terrain_rate=0.0, observation_rate=50.0))
