from __future__ import annotations

import pyarrow as pa

from orchestrator.handoff.evidence import errors
from orchestrator.handoff.frames import exploded

ROWS = pa.table(
    {
        "node": ["e1", "e2", "e3", "e4"],
        "one": pa.array([[1.0, 2.0], None, [3.0], []], type=pa.list_(pa.float64())),
        "two": pa.array([None, None, [7.0], []], type=pa.list_(pa.float64())),
    }
)


def test_lists_are_laid_end_to_end_and_null_where_a_row_has_none() -> None:
    table = exploded(ROWS, ["node"], {"one": "a", "two": "b"}, counter="step")
    assert table.to_pylist() == [
        {"node": "e1", "step": 0, "a": 1.0, "b": None},
        {"node": "e1", "step": 1, "a": 2.0, "b": None},
        {"node": "e3", "step": 0, "a": 3.0, "b": 7.0},
    ]


def test_a_bound_stands_beside_the_error_where_results_have_one() -> None:
    figures = {name: pa.array([[0.0], None, [0.0], None]) for name in ("nees", "nis", "sent", "nis_dof")}
    figures |= {"attacked": pa.array([[True], None, [False], None])}
    figures |= {"error.state": pa.array([[1.0], None, [2.0], None])}
    figures |= {"pcrb.state": pa.array([None, None, [0.5], None], type=pa.list_(pa.float64()))}
    table = errors(pa.table({"node": ROWS["node"], **figures}), ["node"])
    assert table["state"].to_pylist() == [1.0, 2.0]
    assert table["bound_state"].to_pylist() == [None, 0.5]
