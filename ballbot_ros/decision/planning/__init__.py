# SPDX-License-Identifier: Apache-2.0
"""From the profile of the ground to a decision: stopping, planners, safety filter."""
