# SPDX-License-Identifier: Apache-2.0
"""The nodes: declare, convert, call, publish."""
import os

# The matrices here are 4 by 4.  More threads do not help with those, and where the cores are
# busy the threads of OpenBLAS wait for each other: the check of the control loop then takes
# 10 s instead of 15 ms.  Must be set before numpy is imported.
for _library in ('OPENBLAS', 'OMP'):
    os.environ.setdefault(f'{_library}_NUM_THREADS', '1')
