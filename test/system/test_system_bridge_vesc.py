# SPDX-License-Identifier: Apache-2.0
"""The node and a VESC with the ways of its firmware: a slow thread, and a kill switch."""
from driving import Driving, WATCHDOG
import pytest
import yaml

from ballbot_ros.config.files import config_folder
from ballbot_ros.emulator.ball import settings_for
from ballbot_ros.emulator.control import obey
from ballbot_ros.emulator.emulator import Emulator
from ballbot_ros.physics import load_scene


@pytest.fixture
def vesc(tmp_path):
    """Return an emulated VESC with a kill switch, ended after the test."""
    scene = load_scene('flat')
    with Emulator('vesc', scene, baud=921600, link=tmp_path / 'vesc', settings=settings_for(
            scene.model.robot, watchdog=WATCHDOG, quirks=('kill_switch',))) as emulator:
        yield emulator


@pytest.fixture
def vesc_file(tmp_path):
    """Return a hardware file for it; no IMU is needed on a level floor."""
    content = yaml.safe_load((config_folder() / 'hardware/gimball_vesc.yaml').read_text())
    content['connection'].update(imu_required=False, loop_rate=200.0, watchdog=WATCHDOG)
    path = tmp_path / 'vesc.yaml'
    path.write_text(yaml.safe_dump(content))
    return str(path)


def test_a_vesc_is_released_each_time_and_its_kill_switch_is_reported(graph, vesc, vesc_file):
    graph.start('bridge', hardware=vesc_file, port=vesc.path, control='direct')
    run = Driving(graph, vesc)
    for _ in range(3):  # idle until its timeout has expired
        graph.spin(WATCHDOG + 0.1)
        run.release()
        assert not run.status[-1].e_stop
        run.pull()
        obey(vesc, 'stop_switch')
        graph.wait(lambda: 'KILL_SW_ACTIVE' in run.status[-1].faults, 'it reports the switch')
        run.wait_for_nothing()
        assert list(run.status[-1].faults) == ['KILL_SW_ACTIVE']
        obey(vesc, 'stop_switch 0')
        run.wait_for_nothing()
