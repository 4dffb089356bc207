# SPDX-License-Identifier: Apache-2.0
"""``ballbot plan-route`` and ``ballbot floor-masks``."""
import json
import math
from pathlib import Path

import numpy as np
from PIL import Image

from ballbot_ros.cli.command import main
from ballbot_ros.floors.floor import AREAS, LINES

FLAT = ['apartment', '--start', '1.7', '1.4', '--goal', '5.3', '5.8']


def test_a_route_is_printed_drawn_and_given_as_json(capsys, tmp_path):
    picture = tmp_path / 'route.png'
    assert main(['plan-route', *FLAT, '--out', str(picture)]) == 0
    assert 'bedroom step' in capsys.readouterr().out
    assert Image.open(picture).width > 500
    assert main(['plan-route', *FLAT, '--json', '--out', str(tmp_path / 'again.svg')]) == 0
    assert (tmp_path / 'again.svg').stat().st_size > 0
    route = json.loads(capsys.readouterr().out)
    # The nearest state of the lattice, whose cells are smaller than 0.12 m.
    assert math.dist(route['segments'][-1]['points'][-1], (5.3, 5.8)) < 0.085
    assert 0.9 <= route['probability'] <= 1.0


def test_every_kind_of_feature_is_drawn(capsys, tmp_path):
    areas = {'carpet': ', height: 0.005', 'level': ', height: 0.01', 'keep_out': '',
             'ramp': ', height: 0.05, line: [[5.0, 6.5], [6.0, 6.5]]',
             'friction': ', friction: 0.1', 'stairs': ''}
    heights = {'step': 0.01, 'threshold': 0.01, 'cord': 0.005, 'drop': 0.2}
    assert {*areas, *heights} == {*AREAS, *LINES}
    features = [f'{{kind: {kind}, polygon: [[{x}, 6], [{x}, 7], [{x + 1}, 6]]{more}}}'
                for x, (kind, more) in zip(range(2, 8), areas.items())]
    features += [f'{{kind: {kind}, line: [[{x}, 9], [{x}, 8]], height: {height}}}'
                 for x, (kind, height) in zip(range(2, 6), heights.items())]
    path = tmp_path / 'floor.yaml'
    path.write_text('walls: {size: [10, 10], lines: []}\nfeatures:\n'
                    + ''.join(f'  - {feature}\n' for feature in features))
    picture = tmp_path / 'route.png'
    assert main(['plan-route', str(path), '--start', '1.0', '1.0', '--goal', '9.0', '1.0',
                 '--out', str(picture)]) == 0
    colours = np.asarray(Image.open(picture).convert('RGB')).reshape(-1, 3)
    assert len(np.unique(colours[::7] // 32, axis=0)) > 8


def test_the_ramp_of_the_template_leads_to_the_level_of_the_template(capsys, tmp_path):
    path = tmp_path / 'my_floor.yaml'
    assert main(['new', 'floor', str(path)]) == 0
    text = path.read_text()
    for kind in ('level', 'ramp'):
        text = text.replace(f'# - {{kind: {kind}', f'- {{kind: {kind}')
    path.write_text(text.replace('#    line:', '   line:'))
    words = ['plan-route', str(path), '--start', '1', '1', '--goal', '5.4', '4.2', '--json']
    capsys.readouterr()
    assert main(words) == 0
    assert len(json.loads(capsys.readouterr().out)['segments']) == 3  # free, upper room, free


def test_attempts_are_printed_for_crossings_only(capsys):
    for goal, attempts in ((('3.0', '1.4'), 0), (('1.8', '5.5'), 2)):
        assert main(['plan-route', *FLAT[:5], *goal]) == 0
        assert capsys.readouterr().out.count('with a further attempt') == attempts


def test_a_goal_in_a_wall_ends_in_an_error(refuses):
    refuses('wall', 'goal', 'plan-route', *FLAT[:5], '5.0', '4.0')


def test_masks_make_their_folder_and_are_not_replaced_silently(capsys, tmp_path, refusal):
    words = ['floor-masks', 'apartment', '--out']
    tmp_path = tmp_path / 'new' / 'masks'
    assert main([*words, str(tmp_path)]) == 0
    written = [Path(line) for line in capsys.readouterr().out.splitlines()]
    assert len(written) == 6
    for kept in written:
        for path in written:
            path.unlink(missing_ok=True)
        kept.touch()
        error = refusal(*words, tmp_path)
        assert error.reason == 'exists' and kept.name in str(error) \
            and str(kept.parent) in str(error)
