# SPDX-License-Identifier: Apache-2.0
"""
Evaluation of the decision in closed loop.

An approach (`approaches`) is a drawn robot on a drawn terrain (`terrains`) with a drawn sensor
(`sensors`).  The decision always assumes the nominal robot file.  `run` runs an approach with the
full model, `outcome` determines its outcome, `evaluation` runs thousands of approaches and stores
their results, `report` counts the outcomes.
"""
