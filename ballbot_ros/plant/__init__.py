# SPDX-License-Identifier: Apache-2.0
"""
The simulated robot as something that takes commands and keeps time; no ROS.

The simulator node is this package with topics around it.
"""
from ballbot_ros.plant.commands import CommandGate as CommandGate
from ballbot_ros.plant.pace import Pace as Pace
from ballbot_ros.plant.pace import periods_per as periods_per
from ballbot_ros.plant.pace import Speedometer as Speedometer
from ballbot_ros.plant.plant import Plant as Plant
from ballbot_ros.plant.sensor import Sensor as Sensor
from ballbot_ros.plant.sensor import Sight as Sight
