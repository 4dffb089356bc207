# SPDX-License-Identifier: Apache-2.0
"""The least that a drive must be; it stands for a fourth one in the tests."""
