# SPDX-License-Identifier: Apache-2.0
"""The verb ``engage-e-stop``."""
import argparse

from ballbot_ros.cli import e_stop


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add whose."""
    e_stop.add_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Print the answer; 1 for a refusal."""
    return e_stop.call(arguments, 'engage_e_stop')
