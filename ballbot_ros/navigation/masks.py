# SPDX-License-Identifier: Apache-2.0
"""
Costmap filter masks for Nav2's planners: keep-out zones and speed limits of a floor.

A planner without run-ups in its model must treat each step, cord and carpet as a wall.  The speed
mask limits the speed near stairs and drops so that the ball can stop.
"""
from pathlib import Path
from typing import List

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.floors.floor import distance_to_segment, inside
from ballbot_ros.navigation.route import RoutePlanner

# Types of nav2_msgs/CostmapFilterInfo: keep-out zones, and speed limits in percent.
KEEP_OUT, SPEED_PERCENT = 0, 1
# Distance over which the speed limit rises to 100 % of the cruise speed [m].
LIMIT_RISE_DISTANCE = 1.0


def mask_files(folder: Path) -> List[Path]:
    """Return the files that `write_masks` writes: image, YAML file and parameters of each mask."""
    return [folder / f'{mask}_{part}' for mask in ('keepout', 'speed')
            for part in ('mask.pgm', 'mask.yaml', 'filter_info.yaml')]


def write_masks(planner: RoutePlanner, folder: Path) -> List[Path]:
    """
    Write keep-out and speed masks with the parameters of Nav2's servers.

    Parameters
    ----------
    planner : RoutePlanner
        Planner of the floor and the robot.
    folder : Path
        Existing folder.

    Returns
    -------
    list of Path
        The files, see `mask_files`: two images, their YAML files for map_server, and the
        parameters of the two costmap_filter_info_server nodes.

    """
    from PIL import Image
    floor = planner.floor
    x, y = floor.centers
    keep_out = ~planner.free
    percent: NDArray[np.float64] = np.full(keep_out.shape, 100.0)
    for edges, feature in zip(planner.boundaries, floor.features):
        if planner.is_closed(feature):
            keep_out |= inside(x, y, feature.polygon)
        if feature.kind in ('friction', 'keep_out'):
            continue
        for edge in edges:
            distance = distance_to_segment(x, y, *edge.line)
            keep_out |= distance < max(floor.resolution, 0.0 if feature.polygon
                                       else 0.5 * feature.width)
            falls = edge.keep(x, y) >= planner.drop_distance
            keep_out |= falls & (distance < planner.drop_distance)
            beyond = np.clip((distance - planner.drop_distance) / LIMIT_RISE_DISTANCE, 0.1, 1.0)
            percent = np.where(falls, np.minimum(percent, 100.0 * beyond), percent)
    files = mask_files(folder)
    # map_server in the mode scale: occupancy from 0 (white) to 100 (black).
    limited = np.where(percent < 100.0, percent, 0.0)
    for name, kind, mask, (image, yaml, info) in (
            ('keepout', KEEP_OUT, 100.0 * keep_out, files[:3]),
            ('speed', SPEED_PERCENT, limited, files[3:])):
        shades = np.round(255.0 - 2.55 * mask).astype(np.uint8)[::-1]
        Image.fromarray(shades).save(image)
        yaml.write_text(
            f'image: {image.name}\nmode: scale\nresolution: {floor.resolution!r}\n'
            f'origin: [{floor.origin[0]!r}, {floor.origin[1]!r}, 0.0]\nnegate: 0\n'
            'occupied_thresh: 1.0\nfree_thresh: 0.0\n', encoding='utf-8')
        info.write_text(
            f'{name}_costmap_filter_info_server:\n  ros__parameters:\n    type: {kind}\n'
            f'    filter_info_topic: {name}_filter_info\n    mask_topic: {name}_filter_mask\n'
            '    base: 0.0\n    multiplier: 1.0\n', encoding='utf-8')
    return files
