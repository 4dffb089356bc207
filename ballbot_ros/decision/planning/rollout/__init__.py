# SPDX-License-Identifier: Apache-2.0
"""Plans tried out with the physics: the approach rolled, the contact with the full model."""
