"""The rod models meet every published and exact solution of the table that `python -m bench.oracles` prints."""

import pytest
from bench.oracle_rows import QUICK


@pytest.mark.parametrize("part", QUICK)
def test_every_row_of_the_table_holds(part):
    rows = list(QUICK[part]())
    assert rows
    assert [row for row in rows if not row.holds] == []
