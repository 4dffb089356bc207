# SPDX-License-Identifier: Apache-2.0
"""Runs: a model, its scenes, trajectories, and how wrong they are."""
