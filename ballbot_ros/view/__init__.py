# SPDX-License-Identifier: Apache-2.0
"""
The live page: display and control of one robot on one ground in a browser.

A `Source` (`source.py`) provides the robot, the ground and a sequence of `Frame` (`frame.py`); the
page draws them, and shows the controls that the source supports.  No source waits for a page.
"""
