# SPDX-License-Identifier: Apache-2.0
"""Floor files and map_server maps: loading, and refusals with their reasons."""
import math

import numpy as np
from PIL import Image
import pytest
from scipy.ndimage import label

from ballbot_ros.errors import ConfigurationError
from ballbot_ros.floors import Floor, load_floor, read_map
from ballbot_ros.floors.floor import distance_to_segment, Feature, FREE, inside, OCCUPIED, UNKNOWN

MAP = 'image: plan.pgm\nresolution: 0.1\norigin: [-1.0, 2.0, 0.0]\nnegate: {}\n' \
    'occupied_thresh: 0.65\nfree_thresh: 0.2\n'


def write_map(folder, shades, text=MAP.format(0), name='plan.pgm'):
    Image.fromarray(np.array(shades, np.uint8)).save(folder / name)
    path = folder / 'plan.yaml'
    path.write_text(text)
    return path


def refusals(path, text):
    path.write_text(text)
    with pytest.raises(ConfigurationError) as caught:
        load_floor(path)
    return {(one.reason, one.field) for one in caught.value.problems or (caught.value,)}


def test_a_map_of_map_server_has_its_last_row_at_the_origin(tmp_path):
    cells, resolution, origin = read_map(write_map(tmp_path, [[0, 255], [205, 254]]))
    # 205 is 0.196 occupied, which is free below 0.2; black is occupied.
    assert cells.tolist() == [[FREE, FREE], [OCCUPIED, FREE]]
    assert (resolution, origin) == (0.1, (-1.0, 2.0))


def test_shades_between_the_thresholds_are_unknown_and_negate_inverts_the_shades(tmp_path):
    shades = [[0, 128, 255]]
    assert read_map(write_map(tmp_path, shades))[0].tolist() == [[OCCUPIED, UNKNOWN, FREE]]
    assert read_map(write_map(tmp_path, shades, MAP.format(1)))[0].tolist() == [
        [FREE, UNKNOWN, OCCUPIED]]


def test_png_and_pgm_give_the_same_map(tmp_path):
    shades = np.random.default_rng(0).integers(0, 255, (7, 9))
    pgm = read_map(write_map(tmp_path, shades))[0]
    png = read_map(write_map(tmp_path, shades, MAP.format(0).replace('pgm', 'png'), 'plan.png'))[0]
    assert np.array_equal(pgm, png)


@pytest.mark.parametrize('change, reason, field', [
    (('origin: [-1.0, 2.0, 0.0]', 'origin: [0, 0]'), 'wrong_type', 'origin'),
    (('resolution: 0.1', 'resolution: 50'), 'out_of_range', 'resolution'),
    (('occupied_thresh: 0.65', 'occupied_thresh: .nan'), 'not_finite', 'occupied_thresh'),
    (('plan.pgm', 'none.pgm'), 'unreadable', 'image')])
def test_an_invalid_map_is_refused(change, reason, field, tmp_path):
    path = write_map(tmp_path, [[255]], MAP.format(0).replace(*change))
    with pytest.raises(ConfigurationError) as caught:
        read_map(path)
    assert (caught.value.reason, caught.value.field) == (reason, field)


def test_a_map_of_100_million_cells_is_refused_before_its_pixels_are_read(tmp_path):
    path = write_map(tmp_path, [[255]])
    (tmp_path / 'plan.pgm').write_bytes(b'P5\n10000 10000\n255\n')
    with pytest.raises(ConfigurationError) as caught:
        read_map(path)
    assert caught.value.reason == 'out_of_range'


def test_a_list_of_features_may_be_empty(tmp_path):
    """This happens after a user has commented out all of them."""
    (tmp_path / 'f.yaml').write_text('walls: {size: [4, 4], lines: []}\nfeatures:\n  # none\n')
    assert load_floor(tmp_path / 'f.yaml').features == ()


def test_all_errors_of_a_file_are_reported_together(tmp_path):
    found = refusals(tmp_path / 'f.yaml', """
walls: {size: [5, -5], lines: [[[0, .nan], [1, 1]]]}
heights: {image: none.png, resolution: 0.05, scale: 0.001}
rooms: 3
features:
  - {kind: stp, line: [[1, 1], [2, 2]]}
  - {kind: step, line: [[1, 1], [2, 2]], height: 40}
  - {kind: carpet, line: [[1, 1], [2, 2]], height: 0.01}
""")
    assert found == {('unknown_name', 'rooms'), ('not_a_choice', 'kind'),
                     ('out_of_range', 'height'), ('wrong_type', 'polygon'),
                     ('inconsistent', 'line'), ('wrong_type', 'lines[0]'),
                     ('out_of_range', 'size'), ('unreadable', 'image')}
    # With a readable map, positions outside it are reported as well.
    found = refusals(tmp_path / 'f.yaml', """
walls: {size: [5, 5], lines: []}
start: [1, 40, 0]
features:
  - {kind: ramp, polygon: [[1, 1]], line: [[2, 2], [3, 2], [2, 2]], height: 0}
  - {kind: step, line: [[1, 1], [2000, 2]], height: 0.04}
""")
    assert found == {('wrong_type', 'polygon'), ('inconsistent', 'line'),
                     ('out_of_range', 'height'), ('out_of_range', 'line'),
                     ('out_of_range', 'start')}


@pytest.mark.parametrize('text, refusal', [
    ('features: []', ('inconsistent', 'map')),
    ('walls: {size: [1, 1], lines: []}\nmap: a.yaml', ('inconsistent', 'map')),
    ('walls: {size: [4, 4], lines: []}\nfeatures:\n'
     '  - {kind: step, line: [[1000, 1], [2000, 1]], height: 0.02}', ('out_of_range', 'line')),
    ('walls: {size: [4, 4], lines: [[[0, 1], [4, 1]], [[1000, 1], [2, 1]]]}',
     ('out_of_range', 'lines[1]')),
    ('walls: {size: [1e4, 1e4], lines: []}', ('out_of_range', 'image')),
    ('walls: {size: [4, 4], lines: []}\nfeatures:\n'
     '  - {kind: step, line: [[1, 1], [2, 1]], height: .nan}', ('not_finite', 'height')),
    ('walls: {size: [4, 4], lines: []}\nfeatures:\n'
     '  - {kind: step, line: [[1, 1], [1, 1]], height: 0.02}', ('wrong_type', 'line')),
    ('walls: {size: [4, 4], lines: []}\nfeatures:\n  - {kind: keep_out, '
     'polygon: [[1, 1], [2, 2], [2, 1], [1, 2]]}', ('inconsistent', 'polygon')),
    ('walls: {size: [4, 4], lines: []}\nfeatures:\n'
     '  - {kind: level, polygon: [[1, 1], [2, 1], [2, 2]]}', ('out_of_range', 'height')),
    ('robot: gimball\nterrain: []\nduration: 3', ('wrong_kind', 'floor'))])
def test_a_floor_that_contradicts_itself_is_refused(text, refusal, tmp_path):
    assert refusal in refusals(tmp_path / 'f.yaml', text)


@pytest.mark.parametrize('corners', [
    [[0, 0], [3, 0], [3, 2], [2, 2], [2, 1], [1, 1], [1, 2], [0, 2]],
    [[0, 0], [1, 0], [1, 1], [0, 0]], [[0, 0], [2, 0], [1, 0], [1, 1]]],
    ids=['two edges on one line', 'closed', 'returning edge'])
def test_an_outline_that_touches_itself_is_accepted(corners):
    assert len(Feature(kind='keep_out', polygon=corners).polygon) == len(corners)


def test_the_label_of_stairs_without_a_height_states_none():
    corners = [[1, 1], [2, 1], [2, 2]]
    assert Feature(kind='stairs', polygon=corners).label == 'stairs'
    assert Feature(kind='stairs', polygon=corners, height=0.3).label == 'stairs of 300 mm'


def test_walls_have_the_thickness_of_the_file(tmp_path):
    path = tmp_path / 'f.yaml'
    path.write_text('walls: {size: [2, 1], lines: [[[1, 0], [1, 1]]], thickness: 0.2, '
                    'resolution: 0.01}')
    floor = load_floor(path)
    row = floor.cells[50]
    assert np.flatnonzero(row[20:180] == OCCUPIED).tolist() == list(range(70, 90))


@pytest.mark.parametrize('text', ['thickness: 0.02', 'resolution: 0.2'])
@pytest.mark.parametrize('end', [4.0, 3.0])
def test_a_wall_thinner_than_a_cell_has_no_gaps(text, end, tmp_path):
    (tmp_path / 'f.yaml').write_text(
        f'walls: {{size: [6, 5], {text}, lines: [[[2, 0], [{end}, 5]]]}}')
    _, count = label(load_floor(tmp_path / 'f.yaml').cells == FREE)
    assert count == 2


def test_a_map_whose_size_is_not_a_multiple_of_its_cells_covers_the_size(tmp_path):
    (tmp_path / 'f.yaml').write_text(
        'walls: {size: [7.42, 5.0], lines: []}\nfeatures:\n'
        '  - {kind: threshold, line: [[7.42, 1], [6, 1]], height: 0.01}')
    assert load_floor(tmp_path / 'f.yaml').extent == pytest.approx((0.0, 7.45, 0.0, 5.0))


def test_distance_and_inside_agree_with_geometry():
    assert distance_to_segment(0.0, 1.0, (-1.0, 0.0), (1.0, 0.0)) == 1.0
    assert distance_to_segment(4.0, 4.0, (0.0, 0.0), (1.0, 0.0)) == 5.0
    x, y = np.random.default_rng(1).uniform(-1.0, 2.0, (2, 1000))
    square = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    assert np.array_equal(inside(x, y, square), (0 <= x) & (x < 1) & (0 <= y) & (y < 1))


def test_a_rotated_map_is_sampled_along_the_axes(tmp_path):
    shades = np.full((20, 40), 255)
    shades[5, 30] = 0  # row 14 from the bottom
    text = MAP.format(0).replace('origin: [-1.0, 2.0, 0.0]', 'origin: [1.0, 2.0, 0.5]')
    cells, resolution, origin = read_map(write_map(tmp_path, shades, text))
    # The centre of the occupied cell in the frame map.
    x, y = 3.05, 1.45
    place = (1.0 + math.cos(0.5) * x - math.sin(0.5) * y, 2.0 + math.sin(0.5) * x
             + math.cos(0.5) * y)
    floor = Floor('rotated', cells, resolution, origin, ())
    occupied = np.argwhere(cells == OCCUPIED)
    assert 1 <= len(occupied) <= 2
    for cell in occupied:
        assert math.dist(floor.center_of(*cell), place) < 0.08
    assert (cells == UNKNOWN).any()
    assert np.sum(cells == FREE) == pytest.approx(799, rel=0.02)


@pytest.mark.parametrize('change, refusal', [
    ({}, None), ({'scale': 1.0}, ('out_of_range', 'heights')),
    ({'image': 'none.png'}, ('unreadable', 'image')),
    ({'resolution': 1e-4}, ('out_of_range', 'resolution')),
    ({'image': 'eight.png'}, ('wrong_type', 'image'))])
def test_heights_are_read_from_an_image_of_16_bits(change, refusal, tmp_path):
    values = np.array([[0, 1000], [20, 65535]], np.uint16)
    Image.fromarray(values).save(tmp_path / 'heights.png')
    Image.fromarray(values.astype(np.uint8)).save(tmp_path / 'eight.png')
    given = {'image': 'heights.png', 'resolution': 0.5, 'scale': 1e-5, **change}
    text = 'walls: {size: [1, 1], lines: []}\nheights: {' + ', '.join(
        f'{key}: {value}' for key, value in given.items()) + '}'
    path = tmp_path / 'f.yaml'
    if refusal is not None:
        assert refusals(path, text) == {refusal}
        return
    path.write_text(text)
    heights = load_floor(path).heights
    assert heights.values.tolist() == pytest.approx(np.array([[0.0002, 0.65535], [0.0, 0.01]]))
    assert heights.at(0.5, 0.25) == pytest.approx(0.5 * (0.0002 + 0.65535))


def test_the_start_is_the_middle_of_the_largest_room_or_that_of_the_file(tmp_path):
    path = tmp_path / 'f.yaml'
    path.write_text('walls: {size: [6, 4], lines: [[[4, 0], [4, 4]]]}')
    x, y, heading = load_floor(path).start
    assert (x, y, heading) == pytest.approx((2.0, 2.0, 0.0), abs=0.11)
    path.write_text('walls: {size: [6, 4], lines: []}\nstart: [1, 2, 90]')
    assert load_floor(path).start == pytest.approx((1.0, 2.0, 0.5 * math.pi))
    assert refusals(path, 'walls: {size: [6, 4], lines: []}\nstart: [1, 2]') == {
        ('wrong_type', 'start')}
