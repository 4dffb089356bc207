# SPDX-License-Identifier: Apache-2.0
"""Simulated plans: a rolling model for the approach, the full model for the contact."""
