# SPDX-License-Identifier: Apache-2.0
"""The node ``bridge``: a real motor on a serial line, and its control laws."""
