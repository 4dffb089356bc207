# SPDX-License-Identifier: Apache-2.0
"""Forces and motion: contact law, equations of motion, modes, Jacobian."""
