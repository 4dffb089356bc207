# SPDX-License-Identifier: Apache-2.0
"""
Proof of the decision in closed loop: drawn approaches, run, judged on the truth, and counted.

An approach (`approaches`) is a drawn robot on a drawn ground (`grounds`) behind a drawn sensor
(`sensors`).  The decision always believes the nominal robot file.  `loop` runs it with the full
model, `judge` says what came of it, `campaign` runs thousands of them and keeps what is done,
`report` counts.
"""
