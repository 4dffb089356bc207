# SPDX-License-Identifier: Apache-2.0
"""
Talk to a motor controller on a serial line: here one in software, with the ball behind it.

For a real one, leave the emulator out and give the path of its port.

    python examples/emulated_drive.py [odrive|vesc|roboclaw]
"""
import sys
import time

from ballbot_ros.drives import open_driver, read_options
from ballbot_ros.drives.transport import Link
from ballbot_ros.emulator.emulator import Emulator
from ballbot_ros.physics import load_scene

BAUD, PERIOD = 115200, 0.02
TORQUE, LIMIT = 0.01, 0.05  # at the motor shaft [N m]


def main() -> None:
    """Arm the drive, push for half a second, and stop it."""
    protocol = sys.argv[1] if len(sys.argv) > 1 else 'vesc'
    options = read_options(protocol, {'torque_limit': LIMIT}, 'this example')
    with Emulator(protocol, load_scene('flat'), BAUD) as robot, Link(robot.path, BAUD) as link:
        driver = open_driver(protocol, link, options)
        identity = driver.identify()
        print(f'On the line: {identity.protocol}, firmware {identity.firmware}')
        driver.arm()
        for period in range(25):
            driver.send_torque(TORQUE)
            time.sleep(PERIOD)
            telemetry = driver.poll()
            if period % 8 == 7:
                print(f'{period * PERIOD:4.2f} s: motor at {telemetry.position:6.2f} rad, '
                      f'ball at {1e3 * robot.state.x:5.1f} mm')
        driver.stop()
        print(f'Stopped; the torque is {abs(robot.torque):g} N m.')


if __name__ == '__main__':
    main()
