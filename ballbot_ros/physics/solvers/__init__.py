# SPDX-License-Identifier: Apache-2.0
"""From one state to a later one: methods, step sizes, events."""
