# SPDX-License-Identifier: Apache-2.0
"""
Models that leave out what a stretch of a run does not need.

Each is derived from the full model of `dynamics` and `contact`, says how far it is from it,
and is left where that is too far:

`rolling`
    One contact, no sliding: the creep of the contact, and where the contact spring is quiet
    its dent as well, follow from the rest of the state.
`flight`
    No contact: the motion in closed form.
"""
