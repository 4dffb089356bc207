# SPDX-License-Identifier: Apache-2.0
"""The verb ``figures``: the figures of the paper, re-simulated, and additional ones."""
import argparse

from ballbot_ros.cli.options import add_format, add_out, add_quiet
from ballbot_ros.cli.output import figure_files, result_folder, save_figure, watched
from ballbot_ros.cli.verb import DONE, INTERRUPTED, print_error
from ballbot_ros.config.fields import check_choice


def add_arguments(parser: argparse.ArgumentParser) -> None:
    asked = parser.add_mutually_exclusive_group()
    asked.add_argument('names', nargs='*', default=[], metavar='NAME',
                       help='figures to draw (default: all)')
    asked.add_argument('--list', action='store_true', help='list the names without drawing')
    add_out(parser, 'figures')
    add_format(parser)
    add_quiet(parser)


def run(arguments: argparse.Namespace) -> int:
    """Draw the figures; each is written as soon as it is complete."""
    from ballbot_ros.paper.figures import FIGURES
    if arguments.list:
        for name, draw in FIGURES.items():
            print(f'{name:<12} {(draw.__doc__ or "").splitlines()[0]}')
        return DONE
    for name in arguments.names:
        check_choice('figure', name, FIGURES)
    names = list(dict.fromkeys(arguments.names)) or list(FIGURES)
    out = result_folder(arguments.out, 'figures', figure_files(names, arguments.format),
                        arguments.overwrite)
    files: list[str] = []
    try:
        with watched(len(names), arguments.quiet, 'drawing', 'figures') as progress:
            for number, name in enumerate(names):
                figure = FIGURES[name](lambda done: progress(number + done))
                files += save_figure(figure, out, name, arguments.format)
    except KeyboardInterrupt:
        done = f'; {", ".join(files)} are in {out}' if files else ''
        print_error(f'interrupted{done}')
        return INTERRUPTED
    if not arguments.quiet:
        print(f'Written to {out}: {", ".join(files)}')
    return DONE
