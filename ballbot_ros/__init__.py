# SPDX-License-Identifier: Apache-2.0
"""A pendulum-driven ball robot: simulator, controller and obstacle decision for ROS 2."""
from pkgutil import extend_path

# The generated ballbot_ros.msg and ballbot_ros.srv live in another directory than this source
# whenever the package is installed with symlinks or run from a checkout: join the two.
__path__ = extend_path(__path__, __name__)

__version__ = '0.1.0'
