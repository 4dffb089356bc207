# SPDX-License-Identifier: Apache-2.0
"""Verbs of ``ballbot`` for a running graph, with the terms of ``ros2``."""
