# SPDX-License-Identifier: Apache-2.0
"""
Models that leave out what a stretch of a run does not need, and what decides between them.

Each is derived from the full model of `dynamics` and `contact`, says how far it is from it,
and is left where that is too far:

`rolling`
    One contact, no sliding, no ringing: way and pendulum remain, dent and creep follow.
`flight`
    No contact: the motion in closed form.
`impact`
    A collision as an impulse; for use from Python, no run goes through it.

`switching` goes from one to another during a run, `spans` tells which took which part, and
`analysis` what a run can meet, before it.
"""
