# SPDX-License-Identifier: Apache-2.0
"""
Send torques to a drive: here an emulated one, which moves the simulated ball.

For a real drive, omit the emulator and use its port, a serial line or a CAN bus.

    python examples/emulated_drive.py [PROTOCOL]

PROTOCOL is odrive, roboclaw, vesc, or vesc_can behind a serial adapter to a CAN bus.
"""
import sys
import time

from ballbot_ros.drives import driver_class, open_driver, open_line, read_options
from ballbot_ros.emulator.ball import settings_for
from ballbot_ros.emulator.emulator import Emulator
from ballbot_ros.physics import load_scene

PERIOD = 0.02
TORQUE, LIMIT = 0.01, 0.05  # at the motor shaft [N m]
WATCHDOG = 0.5  # longer than a pause of this process, which has no real-time priority [s]


def main() -> None:
    """Arm the drive, apply a torque for half a second, and stop it."""
    protocol = sys.argv[1] if len(sys.argv) > 1 else 'vesc'
    options = read_options(
        protocol, {'torque_limit': LIMIT, 'watchdog': WATCHDOG}, 'this example')
    baud, scene = driver_class(protocol).baud_rates[0], load_scene('flat')
    settings = settings_for(scene.model.robot, watchdog=WATCHDOG)
    with Emulator(protocol, scene, baud, settings) as robot:
        driver = open_driver(protocol, open_line(protocol, robot.path, baud), options)
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
        driver.line.close()
        print(f'Stopped; the torque is {abs(robot.torque):g} N m.')


if __name__ == '__main__':
    main()
