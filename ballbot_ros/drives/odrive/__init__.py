# SPDX-License-Identifier: Apache-2.0
"""ODrive: firmware generations, settings and emulated board, shared by both protocols."""
