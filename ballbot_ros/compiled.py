# SPDX-License-Identifier: Apache-2.0
"""
Compile the inner loops with numba where it is installed; run the same source where not.

The numerical kernels are written in the part of Python that numba understands and are
marked ``@compiled``.  Set ``BALLBOT_UNCOMPILED=1`` to run them as plain Python, to debug
or to compare: both give the same numbers to rounding.
"""
import os
from typing import Any, Callable

try:
    if os.environ.get('BALLBOT_UNCOMPILED', '0') not in ('', '0'):
        raise ImportError('compilation switched off by BALLBOT_UNCOMPILED')
    import numba

    COMPILED = True
except ImportError:
    COMPILED = False


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """
    Mark a kernel for compilation.

    The machine code is cached beside the source (or in numba's own cache folder), so that
    only the first run after a change pays for it.  Strict IEEE arithmetic is kept: no
    reordering, no dropped checks for infinities.
    """
    if not COMPILED:
        return function
    return numba.njit(cache=True, error_model='numpy')(function)
