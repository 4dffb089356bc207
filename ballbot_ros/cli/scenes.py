# SPDX-License-Identifier: Apache-2.0
"""The verb ``scenes``: what can be simulated."""
import argparse


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add nothing: there is nothing to choose."""
    parser.epilog = 'Run one with "ballbot simulate NAME".'


def run(arguments: argparse.Namespace) -> int:
    """List the scenes."""
    from ballbot_ros.cli.listing import print_list
    print_list('scenes')
    return 0
