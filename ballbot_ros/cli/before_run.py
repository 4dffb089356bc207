# SPDX-License-Identifier: Apache-2.0
"""What is said before a run: how much it would write."""
from pathlib import Path
import shutil
import sys
from typing import Any

from ballbot_ros.errors import ConfigurationError

# Of all files of a run together, and of the memory that it takes, per sample.
BYTES = 1000
LARGE = 1e9  # that people are told of


def before_the_run(scene: Any, folder: Path, silent: bool) -> None:
    """
    Say on standard error that the files of a run would be large.

    Raises
    ------
    ConfigurationError
        If the files would not fit on the disk.

    """
    samples = scene.run.duration / scene.run.output_step
    size = BYTES * samples
    coarser = scene.run.output_step * 10.0
    while BYTES * scene.run.duration / coarser > 0.1 * LARGE:
        coarser *= 10.0
    words = (f'this run writes about {1e-9 * size:.2g} GB ({samples:.3g} samples, one each '
             f'{scene.run.output_step:g} s); --output-step {coarser:g} makes it '
             f'{1e-9 * BYTES * scene.run.duration / coarser:.2g} GB')
    place = next(path for path in (folder.absolute(), *folder.absolute().parents)
                 if path.exists())
    if size > shutil.disk_usage(place).free:
        raise ConfigurationError(f'{words}; there is no room for it in {place}')
    if size > LARGE and not silent:
        print(f'Warning: {words}', file=sys.stderr, flush=True)
