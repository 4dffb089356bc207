# SPDX-License-Identifier: Apache-2.0
"""
The simulated robot as something that takes commands and keeps time; no ROS.

The simulator node is this package with topics around it.
"""
from ballbot_ros.plant.imu import Imu, ImuSample
from ballbot_ros.plant.pacing import Pace, periods_per, Speedometer
from ballbot_ros.plant.plant import Plant
from ballbot_ros.plant.sensor_faults import Latency, SensorFaults
from ballbot_ros.plant.step_sensor import Sensor, Sight
from ballbot_ros.plant.terrain_sensor import TerrainSensor, TerrainSight
from ballbot_ros.renamed import refuse_old_names

__all__ = [
    'Imu', 'ImuSample', 'Latency', 'Pace', 'periods_per', 'Plant', 'Sensor', 'SensorFaults',
    'Sight', 'Speedometer', 'TerrainSensor', 'TerrainSight']

refuse_old_names(globals())
