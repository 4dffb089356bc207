# SPDX-License-Identifier: Apache-2.0
"""The verbs ``plan-route`` and ``floor-masks``: routes on a floor, and masks for Nav2."""
import argparse
from pathlib import Path
from typing import Any

from ballbot_ros.cli import options
from ballbot_ros.cli.output import check_new_file, print_json, result_folder
from ballbot_ros.cli.verb import DONE, Verb


def _add_floor(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('floor', metavar='FLOOR', help='name of a floor or a YAML file')
    options.add_robot(parser)
    parser.add_argument('--curve', default='gimball_down', metavar='NAME',
                        help='name of a height curve or a YAML file (default: %(default)s)')
    parser.add_argument('--tuning', default='decision_default', metavar='NAME', help='name of a '
                        'decision tuning or a YAML file (default: %(default)s)')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    _add_floor(parser)
    for name in ('start', 'goal'):
        parser.add_argument(f'--{name}', type=float, nargs=2, required=True, metavar=('X', 'Y'),
                            help='position of the centre [m]')
    parser.add_argument('--out', type=Path, metavar='FILE.png',
                        help='draw the floor and the route to a PNG or SVG file')
    options.add_overwrite(parser, file=True)
    parser.add_argument('--json', action='store_true', help='print the route as JSON (SI units)')


def _planner(arguments: argparse.Namespace) -> Any:
    from ballbot_ros.decision import Knowledge, load_curve, load_decision_tuning
    from ballbot_ros.floors import load_floor
    from ballbot_ros.navigation import RoutePlanner
    knowledge = Knowledge(options.read_robot(arguments), load_curve(arguments.curve),
                          load_decision_tuning(arguments.tuning))
    return RoutePlanner(load_floor(arguments.floor), knowledge)


def run(arguments: argparse.Namespace) -> int:
    if arguments.out is not None:
        from ballbot_ros.figures.canvas import FORMATS
        check_new_file(arguments.out, arguments.overwrite,
                       endings=[f'.{kind}' for kind in FORMATS])
    planner = _planner(arguments)
    route = planner.route(arguments.start, arguments.goal)
    explanation = planner.explain(route, arguments.start, arguments.goal)
    if arguments.json:
        from ballbot_ros.results.summary import plain
        print_json({
            'time': route.time, 'probability': route.probability,
            'explanation': explanation, 'segments': [{
                'points': segment.points, 'time': segment.time,
                'feature': segment.feature.label if segment.feature is not None else None,
                'crossing': None if segment.crossing is None
                else plain(segment.crossing._asdict())} for segment in route.segments]})
    else:
        from ballbot_ros.table import table
        rows, time = [('time', 'to', 'by')], 0.0
        for segment in route.segments:
            time += segment.time
            how = 'free floor'
            if segment.feature is not None and segment.crossing is not None:
                how = (f'over the {segment.feature.label}, {segment.crossing.run_up:.2f} m of '
                       f'run-up, up to {segment.crossing.speed:.2f} m/s, probability '
                       f'{segment.crossing.probability:.2f}, with a further attempt '
                       f'{segment.crossing.eventual:.2f}')
            x, y = segment.points[-1]
            rows.append((f'{time:.1f} s', f'({x:5.2f}, {y:5.2f})', how))
        print(table(rows))
        print(f'Probability {route.probability:.3f}. {explanation}'.rstrip())
    if arguments.out is not None:
        from ballbot_ros.figures.canvas import save
        from ballbot_ros.figures.route import route_figure
        save(route_figure(planner.floor, route, planner.ball_radius), arguments.out)
        if not arguments.json:
            print(f'Drawn to {arguments.out}')
    return DONE


def add_masks(parser: argparse.ArgumentParser) -> None:
    _add_floor(parser)
    parser.add_argument('--out', type=Path, required=True, metavar='DIR',
                        help='folder for images, YAML files and server parameters')
    options.add_overwrite(parser, file=True)


def masks(arguments: argparse.Namespace) -> int:
    from ballbot_ros.navigation.masks import mask_files, write_masks
    folder = result_folder(arguments.out, '', [path.name for path in mask_files(arguments.out)],
                           arguments.overwrite)
    for path in write_masks(_planner(arguments), folder):
        print(path)
    return DONE


MASKS = Verb(add_masks, masks)
