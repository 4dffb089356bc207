# SPDX-License-Identifier: Apache-2.0
"""Text of figures."""


def words_of(figure):
    """Return all texts of a figure and its axes, titles and legends included."""
    found = [item.get_text() for item in figure.texts]
    for axes in figure.axes:
        found += [item.get_text() for item in axes.texts]
        found += [axes.get_title(loc) for loc in ('left', 'center')]
        found += [axes.get_xlabel(), axes.get_ylabel()]
        legend = axes.get_legend()
        found += [item.get_text() for item in legend.get_texts()] if legend else []
    return found
