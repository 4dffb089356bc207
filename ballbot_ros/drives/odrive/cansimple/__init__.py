# SPDX-License-Identifier: Apache-2.0
"""ODrive with CANSimple on a CAN bus."""
