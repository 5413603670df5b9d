"""Numbers as options take them."""

import pytest

from tuning.cli.numbers import decimal, whole


@pytest.mark.parametrize("text", ["1_0", "\u0661", "\uff11", "1_0.5", "nan", "0x10", "", "1e", "--1"])
def test_what_is_no_decimal_number_is_refused(text):
    for read in (decimal, whole):
        with pytest.raises(ValueError):
            read(text)


def test_decimal_numbers_are_read():
    assert [decimal(text) for text in ("1", "-.5", "1e-3", " 2 ", "+3")] == [1.0, -0.5, 1e-3, 2.0, 3.0]
    assert whole("-12") == -12
