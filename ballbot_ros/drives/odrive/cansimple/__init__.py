# SPDX-License-Identifier: Apache-2.0
"""ODrive by CANSimple on a CAN bus."""
