"""How bad input is refused in this process."""

import pytest

from softness_bayes.base.errors import InputError


def refusal(call, *args, **options):
    """Return the message of the error with which a call refuses its input."""
    with pytest.raises(InputError) as caught:
        call(*args, **options)
    return str(caught.value)
