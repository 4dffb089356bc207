# SPDX-License-Identifier: Apache-2.0
"""Execute decisions: set angles, goals, attempts, stuck detection."""
