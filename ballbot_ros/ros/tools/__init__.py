# SPDX-License-Identifier: Apache-2.0
"""What the verbs of ``ballbot`` do on a running graph, in the words of ``ros2``."""
