# SPDX-License-Identifier: Apache-2.0
"""ODrive on a CAN bus: codec of CANSimple, driver, and the drive in software."""
