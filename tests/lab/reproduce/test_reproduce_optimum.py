"""Every row of `reproduce optimum` is reproduced."""

import pytest

from flexslew_lab.reproduce import REPRODUCTIONS


@pytest.mark.slow
def test_every_optimum_is_reproduced() -> None:
    rows = REPRODUCTIONS["optimum"].rows()
    assert len(rows) == 14
    assert not [row for row in rows if not row["ok"]]
    printed = [row["paper"] for row in rows if row["paper"] != "not printed"]
    assert printed == ["5.865958", "5.865958"]
