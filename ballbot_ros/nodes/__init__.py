# SPDX-License-Identifier: Apache-2.0
"""The ROS nodes: they declare parameters, convert messages, call the library and publish."""
import os

# The matrices of this package are 4 by 4, too small for several threads, and on busy cores the
# threads of OpenBLAS wait for each other: the stability check of the control loop then takes
# 10 s instead of 15 ms.  Must be set before numpy is imported.
for _library in ('OPENBLAS', 'OMP'):
    os.environ.setdefault(f'{_library}_NUM_THREADS', '1')
