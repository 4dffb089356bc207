# SPDX-License-Identifier: Apache-2.0
"""The verb ``run``: a node, as ``ros2 run ballbot_ros NODE`` runs it, or an experiment file."""
import argparse
from pathlib import Path
from pkgutil import iter_modules

from ballbot_ros.cli.options import add_number, add_quiet, from_ros
from ballbot_ros.cli.verb import DONE, FAILED, Parser
from ballbot_ros.config.fields import quantity
from ballbot_ros.errors import ConfigurationError

FOLDER = Path(__file__).resolve().parent.parent / 'nodes'
NODES = tuple(sorted(module.name for module in iter_modules([str(FOLDER)])
                     if module.ispkg))
# Nodes that may share a process: none of them drives a motor.
COMPOSABLE_NODES = ('controller', 'obstacle_decision', 'simulator')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('target', metavar='NODE|FILE',
                        help=f'node to run ({", ".join(NODES)}), several of '
                        f'{", ".join(COMPOSABLE_NODES)} in one process, or YAML file or folder of '
                        'an experiment')
    # Options after the target belong to it.
    parser.add_argument('rest', nargs=argparse.REMAINDER, metavar='...',
                        help='options of the target: --ros-args and its parameters for a node; '
                        '--out DIR, --quiet, --timeout SECONDS for an experiment')


def run(arguments: argparse.Namespace) -> int:
    """Run until Ctrl-C, which is the normal end of a node: exit code 0."""
    target = arguments.target
    if target not in NODES:  # the name of a node has precedence over a folder of that name
        if target.endswith(('.yaml', '.yml')) or '/' in target or Path(target).is_dir():
            return _experiment(target, arguments.rest)
        from ballbot_ros.config.fields import suggestion
        near = suggestion(target, NODES)
        raise ConfigurationError(f'there is no node {target!r}{near}; an experiment is given by '
                                 'the path of its YAML file', 'unknown_name', target)
    split = next((index for index, word in enumerate(arguments.rest) if word not in NODES),
                 len(arguments.rest))
    names, rest = [target, *arguments.rest[:split]], arguments.rest[split:]
    try:
        if len(names) == 1:
            return int(from_ros(f'ballbot_ros.nodes.{target}.node').main(rest))
        return _together(names, rest)
    except KeyboardInterrupt:  # during imports; later the node handles the signal
        return DONE


def _together(names: list[str], rest: list[str]) -> int:
    alone = [name for name in names if name not in COMPOSABLE_NODES]
    if alone or len(set(names)) < len(names):
        what = f'{alone[0]} requires a separate process' if alone else 'each can run once'
        raise ConfigurationError(
            f'cannot run {" and ".join(names)} in one process: {what}; several of '
            f'{", ".join(COMPOSABLE_NODES)} can share one', 'inconsistent', 'NODE')
    modules = [from_ros(f'ballbot_ros.nodes.{name}.node') for name in names]
    classes = [getattr(module, name.title().replace('_', ''))
               for module, name in zip(modules, names)]
    return int(from_ros('ballbot_ros.ros.run').run_together(classes, rest))


def _experiment(target: str, words: list[str]) -> int:
    parser = Parser(prog='ballbot run FILE', allow_abbrev=False)
    parser.add_argument('--out', type=Path, metavar='DIR', help='folder to write to')
    add_quiet(parser)
    add_number(parser, '--timeout', 'SECONDS', quantity(
        's', 'longest wall time of a seed', default=120.0, above=0.0))
    try:
        options = parser.parse_args(words)
    except SystemExit:  # --help
        return DONE
    from ballbot_ros.experiments.run import run_experiment
    same = run_experiment(target, options.out, options.quiet, options.timeout)
    return DONE if same else FAILED
