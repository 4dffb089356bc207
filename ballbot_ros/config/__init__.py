# SPDX-License-Identifier: Apache-2.0
"""What files say: described and ranged fields, where a number comes from, and the files."""
