# SPDX-License-Identifier: Apache-2.0
"""Checks of refused input by reason code and field, not by the text of the message."""
from contextlib import contextmanager

import pytest

from ballbot_ros.errors import BallbotError


@contextmanager
def refused(reason, field=None, error=BallbotError):
    """
    Expect an error of this package with a reason code and, if given, a field.

    Yields pytest's ExceptionInfo; its ``value`` is the error.
    """
    with pytest.raises(error) as caught:
        yield caught
    assert caught.value.reason == reason, f'{caught.value.reason!r}: {caught.value}'
    if field is not None:
        assert caught.value.field == field, f'{caught.value.field!r}: {caught.value}'
