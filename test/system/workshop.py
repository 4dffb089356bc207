# SPDX-License-Identifier: Apache-2.0
"""A drive in factory settings, and a person who configures it with the tools of its vendor."""
from dataclasses import replace
import re
import shlex

from driving import write_hardware
from stand import StoodBall
from waiting import wait_until

from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.cli import main
from ballbot_ros.drives import open_line
from ballbot_ros.emulator.ball import PERIOD, settings_for
from ballbot_ros.emulator.emulator import Emulator
from ballbot_ros.physics import load_scene

EXTRA = 1.15  # ratio of actual to predicted torque: the gear loses less than in the file
# Factory settings: limits too high for the pendulum, no watchdog or a long one.
FRESH = {'odrive': {'quirks': ('factory',)},
         'odrive 0.6': {'quirks': ('factory',), 'firmware': '0.6'},
         'vesc': {'torque_limit': 10.0, 'current_limit': 60.0, 'watchdog': 1.0},
         'roboclaw': {'torque_limit': 10.0, 'current_limit': 60.0, 'watchdog': 0.0}}


class Workshop:
    """A drive in factory settings, its hardware file, and a person with tools."""

    def __init__(self, kind, folder, capsys):
        self.folder, self.capsys, self.complaint = folder, capsys, ''
        self.protocol, _, firmware = kind.partition(' ')
        self.scene = load_scene('flat')
        robot = self.scene.model.robot
        baud = load_hardware(f'gimball_{self.protocol}').connection.baud
        self.motor = Emulator(self.protocol, self.scene, baud,
                              settings_for(robot, **FRESH[kind]), link=folder / 'motor')
        self.ball = self.motor.ball = StoodBall(self.motor.ball, robot, PERIOD, EXTRA)

    def copy_file(self, **limits):
        """Copy the hardware file of the package to my.yaml, as on the page."""
        write_hardware(self.folder / 'my.yaml', f'gimball_{self.protocol}', limits,
                       port=str(self.folder / 'motor'))

    def run(self, command):
        """Run a ``ballbot`` command of the page; return exit code and output."""
        program, *words = shlex.split(command)
        assert program == 'ballbot'
        code = main(words)
        out, self.complaint = self.capsys.readouterr()
        return code, out

    def obey_doctor(self, command):
        """Apply the remedies of the doctor until none remains; return the number of rounds."""
        for turn in range(6):
            code, out = self.run(command)
            wrong = re.findall(r'^WRONG  (.*)\n +-> (.*)$', out, re.M)
            assert (code != 0) == ('WRONG' in out) and out.count('WRONG') == len(wrong), out
            if code == 0:
                return turn
            for what, remedy in wrong:
                self.apply_remedy(what, remedy)
        raise AssertionError(f'the doctor still finds errors:\n{out}')

    def apply_remedy(self, what, remedy):
        """Apply a remedy with the tool that it names."""
        done, device = remedy.split(' (')[0], self.motor.device
        if self.protocol == 'odrive':
            line = open_line('odrive', self.motor.path, self.motor.baud)
            line.write(''.join(f'{word}\n' for word in done.split(', ')).encode())
            # State 1 is idle, which it is not during a calibration.
            wait_until(lambda: line.read().endswith(b'1\r\n'),
                       lambda: line.write(b'r axis0.current_state\n'))
            line.close()
            return
        number = float(re.search(r'(\d[0-9.e-]*)(?: \w+)?$', done).group(1))
        if 'Timeout' in remedy:
            device.application = device.application._replace(timeout=1e-3 * number)
        elif 'Motor Current Max' in remedy:
            device.limits.update(l_current_max=number, l_current_min=-number)
        elif 'serial timeout' in remedy:
            device._timeout = round(number / 0.1)
        elif 'max current' in remedy:
            device.settings = replace(device.settings, current_limit=number)
        else:
            raise AssertionError(f'{what}: this test has no handler for {remedy!r}')
