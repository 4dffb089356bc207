# SPDX-License-Identifier: Apache-2.0
"""Experiment files, lockstep runs and their results."""
