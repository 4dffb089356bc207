# SPDX-License-Identifier: Apache-2.0
"""Simulation: models, scenes, runs, trajectories, and their errors."""
