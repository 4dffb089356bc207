# SPDX-License-Identifier: Apache-2.0
"""Shared by the nodes: parameters, quality of service, conversions, start and stop."""
