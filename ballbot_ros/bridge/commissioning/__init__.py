# SPDX-License-Identifier: Apache-2.0
"""Commissioning: doctor and calibration."""
