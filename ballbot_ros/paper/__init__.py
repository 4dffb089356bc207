# SPDX-License-Identifier: Apache-2.0
"""Reproduction of the paper: cases, test bench, model comparisons and figures."""
