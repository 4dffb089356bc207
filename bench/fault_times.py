# SPDX-License-Identifier: Apache-2.0
"""
Measure the time to zero torque of each failure mode: the bridge session in simulated time.

    .venv/bin/python bench/fault_times.py            # prints the table
    .venv/bin/python bench/fault_times.py --write    # also updates docs/hardware_bridge.md

Ball, drive, cable and IMU are models on one clock, so the times do not depend on the machine;
`faults.py` measures the additional delay of a busy machine.
"""
import logging
from pathlib import Path
import sys

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / 'test' / 'helpers'))

from documents import show, table  # noqa: E402
from session_faults import FAULTS, FORWARD, loop, time_to_zero  # noqa: E402
from virtual_robot import VirtualRobot  # noqa: E402

from ballbot_ros.control import Mode, SetPoint  # noqa: E402

PROTOCOLS = ('odrive 0.5', 'odrive_can 0.6', 'vesc', 'vesc_can', 'roboclaw')
LONGEST = 4.0  # after a fault [s]


def measure():
    logging.disable(logging.WARNING)
    for name, fault in FAULTS.items():
        times = []
        for protocol in PROTOCOLS:
            robot = VirtualRobot(protocol, onboard='gentle').ready()
            loop(robot, 0.2, FORWARD)
            try:
                times.append(1e3 * time_to_zero(robot, fault, LONGEST, SetPoint(Mode.SPEED, 0.5)))
            except AssertionError:
                times.append(float('inf'))
        yield f'zero torque after: {name}', 'ms', times, None


def main():
    text = table(('failure mode', *PROTOCOLS), [
        (name.partition(': ')[2], *(f'{time:.0f} ms' for time in times))
        for name, _, times, _ in measure()])
    print(text)
    if '--write' in sys.argv[1:]:
        show('docs/hardware_bridge.md', 'fault times', text)


if __name__ == '__main__':
    main()
