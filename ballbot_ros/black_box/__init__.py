# SPDX-License-Identifier: Apache-2.0
"""Recorder of the last minutes before a fault of the bridge: writing, reading and reports."""
