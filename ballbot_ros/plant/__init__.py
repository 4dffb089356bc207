# SPDX-License-Identifier: Apache-2.0
"""
The simulated robot as a component that accepts commands and keeps time; without ROS.

The simulator node adds the topics to this package.

    >>> from ballbot_ros.physics import load_scene
    >>> plant = Plant(load_scene('flat'), control_rate=500.0)
    >>> state = plant.advance(torque=0.5)
    >>> round(plant.time, 6), state.pendulum_rate > 0.0 > state.ball_rate
    (0.002, True)

A `TerrainSensor` observes the ground ahead, with noise that depends on seed and reading only:

    >>> from ballbot_ros.physics import Terrain
    >>> sensor = TerrainSensor(Terrain.step(0.02, at=0.5), reach=1.0, height_sd=0.001)
    >>> sight = sensor.measure(0.0, 0.226, 0)
    >>> bool(0.01 < max(sight.z) - min(sight.z) < 0.03)
    True
"""
from ballbot_ros.plant.floor_plant import FloorPlant
from ballbot_ros.plant.imu import Imu, ImuSample
from ballbot_ros.plant.pacing import Pace, periods_per, Speedometer
from ballbot_ros.plant.plant import Plant
from ballbot_ros.plant.sensor_faults import Latency, SensorFaults
from ballbot_ros.plant.step_sensor import Sensor, Sight
from ballbot_ros.plant.terrain_sensor import TerrainSensor, TerrainSight

__all__ = [
    'FloorPlant', 'Imu', 'ImuSample', 'Latency', 'Pace', 'periods_per', 'Plant', 'Sensor',
    'SensorFaults', 'Sight', 'Speedometer', 'TerrainSensor', 'TerrainSight']
