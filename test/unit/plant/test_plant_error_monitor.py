# SPDX-License-Identifier: Apache-2.0
"""A plant with an accuracy estimates its error while it runs."""
from dataclasses import replace
import math

import pytest
from refusals import refused

from ballbot_ros.errors import SimulationError
from ballbot_ros.physics import load_scene
from ballbot_ros.physics.model.actuation import Actuator, TORQUE
from ballbot_ros.plant import Plant
from ballbot_ros.plant.error_monitor import ErrorMonitor


def run(plant, torque, periods=400):
    for _ in range(periods):
        plant.advance(torque)
    return plant


def test_the_error_is_below_the_estimate_and_the_estimate_below_the_accuracy():
    plant = run(Plant(load_scene('fig7_top'), 500.0, accuracy=1e-5), 0.3)
    exact = run(Plant(load_scene('fig7_top'), 500.0, accuracy=1e-9), 0.3)
    assert abs(plant.state.x - exact.state.x) < plant.error_estimate < 1e-5
    assert plant.accuracy_lost_at == math.inf


def test_a_reset_restarts_the_estimate():
    plant = run(Plant(load_scene('fig7_top'), 500.0, accuracy=1e-5), 0.0)
    assert plant.error_estimate > 0.0
    plant.reset()
    assert plant.error_estimate == 0.0


def test_without_an_accuracy_the_estimate_is_nan():
    assert math.isnan(run(Plant(load_scene('flat'), 500.0), 0.0, 5).error_estimate)


def monitored(accuracy, **changes):
    """Return a plant and an error monitor whose robot differs from that of the plant."""
    scene = load_scene('fig7_top')
    plant = Plant(scene, 500.0)
    robot = replace(scene.model.robot, **changes)
    return plant, ErrorMonitor(replace(scene.model, robot=robot), plant.state, accuracy)


def follow(plant, monitor, periods):
    drive = Actuator(TORQUE)
    for _ in range(periods):
        monitor.advance(plant.advance(0.0), drive, 20)


def test_the_time_at_which_the_error_exceeds_the_accuracy_is_reported():
    plant, monitor = monitored(1e-9, contact_stiffness=1e5)
    follow(plant, monitor, 100)
    assert monitor.error > 1e-9 and 0.0 < monitor.accuracy_lost_at <= plant.time
    lost = monitor.accuracy_lost_at
    follow(plant, monitor, 100)
    assert monitor.accuracy_lost_at == lost


def test_a_failure_of_the_coarser_run_does_not_change_the_estimate():
    # The ground of the monitor is too soft to support the ball; that of the plant is not.
    plant, monitor = monitored(1.0, contact_stiffness=1e-6)
    with pytest.raises(SimulationError):
        while True:
            error = monitor.error
            follow(plant, monitor, 1)
    assert monitor.error == error
    with pytest.raises(SimulationError):
        follow(plant, monitor, 1)
    assert monitor.error == error


def test_an_accuracy_out_of_range_is_refused():
    with refused('out_of_range', 'accuracy'):
        Plant(load_scene('flat'), 500.0, accuracy=1e-15)
