# SPDX-License-Identifier: Apache-2.0
"""RoboClaw: codec of its packet serial mode, driver, and emulated drive."""
