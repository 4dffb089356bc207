# SPDX-License-Identifier: Apache-2.0
"""
Results of a run: files of values, figures and a summary.

    >>> from ballbot_ros.results import summarise
    >>> from ballbot_ros.physics import load_scene
    >>> scene = load_scene('fig7_bottom')
    >>> [face.passed for face in summarise(scene.simulate()).faces]
    [True]

Figures are imported from `ballbot_ros.figures.run`, because matplotlib loads slowly.
"""
from ballbot_ros.results.faces import FaceMeeting
from ballbot_ros.results.files import (
    read_columns, read_units, write_text, write_trajectory)
from ballbot_ros.results.summary import report, summarise, Summary

__all__ = [
    'FaceMeeting', 'read_columns', 'read_units', 'report', 'summarise', 'Summary', 'write_text',
    'write_trajectory']
