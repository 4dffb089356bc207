# SPDX-License-Identifier: Apache-2.0
"""
The live page: one robot on one ground, looked at and driven in a browser.

A `Source` (`source.py`) has the robot, the ground and `Frame` after `Frame` (`frame.py`); the page
draws what a source knows, and offers what it can do.  No source waits for a page.
"""
