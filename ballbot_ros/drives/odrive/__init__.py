# SPDX-License-Identifier: Apache-2.0
"""ODrive: codec of its ASCII protocol, driver, and the drive in software."""
