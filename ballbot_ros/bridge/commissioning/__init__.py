# SPDX-License-Identifier: Apache-2.0
"""Before the first drive: doctor and calibration."""
