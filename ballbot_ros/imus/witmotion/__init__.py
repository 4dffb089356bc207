# SPDX-License-Identifier: Apache-2.0
"""WitMotion: serial protocol and emulated sensor."""
