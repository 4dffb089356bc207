# SPDX-License-Identifier: Apache-2.0
"""The verb ``doctor``: check ports, drive and ROS, with a remedy for each finding."""
import argparse
import os

from ballbot_ros.cli.options import add_hardware, add_port
from ballbot_ros.cli.verb import DONE, FAILED, note


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_hardware(parser)
    add_port(parser)


def run(arguments: argparse.Namespace) -> int:
    """Print each finding; return 1 if a verdict is `WRONG`."""
    from ballbot_ros.bridge.commissioning.doctor import examine, WRONG
    code = DONE
    for finding in examine(arguments.hardware, arguments.port, os.environ,
                           lambda text: note(f'    .  {text}')):
        print(f'{finding.verdict:>5}  {finding.what}')
        if finding.remedy:
            print(f'       -> {finding.remedy}')
        if finding.verdict == WRONG:
            code = FAILED
    return code
