# SPDX-License-Identifier: Apache-2.0
"""The demo: all nodes as processes, two steps, and a timeline of the events."""
