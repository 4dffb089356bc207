# SPDX-License-Identifier: Apache-2.0
"""
LSODA in C++, from the sources of numbalsoda: one call of its library is one run.

No wheel of numbalsoda supports our Python, and its build needs a Fortran compiler for unused
parts; so this script compiles the two required files into the folder build/.

    .venv/bin/python bench/compiled_liblsoda.py
"""
import ctypes
import math
from pathlib import Path
import subprocess
import sys
import tarfile
import tempfile

import compiled_rates
from compiled_rates import MOTION
import numpy as np

from ballbot_ros.physics.model.state import X, Y

MOST_STEPS = 10**7

SOURCE = 'numbalsoda==0.3.4'
FILE = Path(__file__).resolve().parents[1] / 'build' / 'liblsoda.so'
HOW_TO_BUILD = '.venv/bin/python bench/compiled_liblsoda.py'
LIBRARY = ctypes.CDLL(str(FILE)) if FILE.exists() else None


class Liblsoda:
    """Runs of one case; the right-hand sides are not counted."""

    def __init__(self, rates, duration):
        self.solve = LIBRARY.lsoda_wrapper
        place, real, whole = ctypes.c_void_p, ctypes.c_double, ctypes.c_int
        self.solve.restype = None
        self.solve.argtypes = (place, whole, place, place, whole, place, place, real, real, whole,
                               place)
        self.rates, self.times, self.rows = rates, np.array([0.0, duration]), np.zeros(2 * MOTION)
        self.success = whole(0)
        self.first = (compiled_rates.plain_rates.address, MOTION, rates.start.ctypes.data,
                      rates.data.ctypes.data, 2, self.times.ctypes.data, self.rows.ctypes.data)
        self.last = MOST_STEPS, ctypes.addressof(self.success)

    def evaluations(self):
        """Return 0: unknown."""
        return 0

    def __call__(self, tolerance):
        """Run, and return the end position."""
        self.solve(*self.first, tolerance, tolerance, *self.last)
        if not self.success.value:
            return math.nan, math.nan
        return self.rows[MOTION + X], self.rows[MOTION + Y]


def build():
    """Fetch the sources and compile them for the local processor."""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.executable, '-m', 'pip', 'download', '--quiet', '--no-deps',
                        '--no-binary', 'numbalsoda', '--dest', folder, SOURCE], check=True)
        with tarfile.open(next(Path(folder).glob('*.tar.gz'))) as archive:
            archive.extractall(folder, filter='data')
        sources = next(Path(folder).glob('*/src'))
        FILE.parent.mkdir(exist_ok=True)
        subprocess.run(['c++', '-O3', '-march=native', '-std=c++11', '-shared', '-fPIC',
                        *(str(sources / name) for name in ('LSODA.cpp', 'wrapper.cpp')),
                        '-o', str(FILE)], check=True)


if __name__ == '__main__':
    build()
