# SPDX-License-Identifier: Apache-2.0
"""
Figures of runs and studies; matplotlib, without a display.

A figure is a function ``name(progress=ignore) -> Figure`` in `paper.figures.FIGURES`;
``ballbot figures NAME`` draws it, and docs/architecture.md names one to copy.

    >>> from ballbot_ros.figures.run import strip
    >>> from ballbot_ros.physics import load_scene
    >>> figure = strip(load_scene('fig7_top').simulate(duration=0.2), 'a title')
    >>> type(figure).__name__
    'Figure'
"""
