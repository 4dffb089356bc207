# SPDX-License-Identifier: Apache-2.0
"""Motor controllers in software: their firmware behind a real serial device, a ball behind it."""
