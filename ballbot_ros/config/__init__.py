# SPDX-License-Identifier: Apache-2.0
"""What files say: described and ranged fields, and where the files are."""
