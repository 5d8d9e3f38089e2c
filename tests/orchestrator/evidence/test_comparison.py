"""Verdicts on samples whose truth is known, and what the sentences say."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pyarrow as pa
import pytest
from scipy import stats

from orchestrator.evidence.columns import select
from orchestrator.evidence.comparison import Comparison, Verdict, compare
from orchestrator.evidence.contenders import Contender
from orchestrator.evidence.samples import sample
from orchestrator.evidence.wording import facts, lines, sentence


def table(values: np.ndarray, metric: str, *, first_trial: int = 0, failed: int = 0) -> pa.Table:
    """Return rows of one estimator whose trials have these values; the last ones failed."""
    trials = len(values)
    status = ["scored"] * (trials - failed) + ["failed"] * failed
    return pa.table(
        {
            "variant": pa.array([0] * trials, pa.int32()),
            "trial": pa.array(range(first_trial, first_trial + trials), pa.int32()),
            "seed": pa.array([1] * trials, pa.int64()),
            "node": pa.array(["e1"] * (trials - failed) + [""] * failed),
            "method": pa.array(["kalman"] * trials),
            "status": pa.array(status),
            metric: pa.array(values, from_pandas=True),
        }
    )


def compared(
    samples: Mapping[str, np.ndarray], metric: str = "rmse.position", **settings: float
) -> Comparison:
    contenders = [Contender(name, name, select(table(values, metric))) for name, values in samples.items()]
    return compare(contenders, [metric], **settings)


def verdict(a: np.ndarray, b: np.ndarray, metric: str = "rmse.position") -> Verdict:
    return compared({"A": a, "B": b}, metric).compared[0].verdict


TRIALS = np.random.default_rng(1).lognormal(0.0, 0.4, 30)


def test_the_better_one_is_named_whichever_comes_first() -> None:
    assert verdict(0.8 * TRIALS, TRIALS) is Verdict.FIRST
    assert verdict(TRIALS, 0.8 * TRIALS) is Verdict.SECOND
    assert verdict(0.8 * TRIALS, TRIALS, "detector.recall") is Verdict.SECOND  # more is better
    assert verdict(0.8 * TRIALS, TRIALS, "packets.sent") is Verdict.LOWER  # neither is better


def test_a_consistent_one_is_better_than_one_too_wide_or_too_narrow() -> None:
    noise = np.random.default_rng(2).lognormal(0.0, 0.05, 30)
    assert verdict(noise, 2.0 * noise, "nees.ratio") is Verdict.FIRST
    assert verdict(noise, 0.5 * noise, "nees.ratio") is Verdict.FIRST


def test_equals_are_called_identical_equal_or_undecided_by_what_is_known() -> None:
    rng = np.random.default_rng(3)
    assert verdict(TRIALS, TRIALS.copy()) is Verdict.IDENTICAL
    assert verdict(TRIALS * rng.lognormal(0.0, 0.01, 30), TRIALS) is Verdict.EQUAL
    assert verdict(TRIALS * rng.lognormal(0.0, 0.8, 30), TRIALS) is Verdict.UNDECIDED


def test_few_trials_are_said_to_be_too_few_and_how_many_would_do() -> None:
    found = compared({"A": TRIALS[:4], "B": TRIALS[:4] * 1.5})
    assert found.compared[0].verdict is Verdict.TOO_FEW
    assert found.compared[0].trials_needed == 6
    assert "at least 6 common trials" in lines(found)[0]
    three = compared({"A": TRIALS[:4], "B": TRIALS[:4] * 1.5, "C": TRIALS[:4] * 2})
    assert three.compared[0].trials_needed == 7  # 2^-6 is within 0.05 / 3


def test_a_divergence_counts_as_the_largest_error() -> None:
    diverging = 0.9 * TRIALS
    diverging[:20] = np.inf
    found = compared({"A": diverging, "B": TRIALS})
    assert found.compared[0].verdict is Verdict.SECOND
    assert found.samples[0][0].infinite == 20
    assert any("infinite in 20 of 30 trials" in line for line in lines(found))


def test_failed_trials_count_and_are_told() -> None:
    good, bad = (
        Contender(n, n, select(table(TRIALS, "rmse.state", failed=f))) for n, f in (("A", 0), ("B", 9))
    )
    found = compare([good, bad], ["rmse.state"])
    assert len(found.samples[0][1].values) == 30
    assert found.samples[0][1].infinite == 9
    assert any("9 of 30 trials failed" in line for line in lines(found))


def test_undefined_trials_are_left_out_and_told() -> None:
    holes = TRIALS.copy()
    holes[[2, 5]] = np.nan
    found = compared({"A": holes, "B": 2.0 * TRIALS})
    assert found.compared[0].difference.sizes == (28, 28)
    assert any("undefined in 2 of 30 trials" in line for line in lines(found))
    nothing = compared({"A": np.full(30, np.nan), "B": TRIALS, "C": 2.0 * TRIALS})
    assert [own.verdict for own in nothing.compared] == [Verdict.UNDEFINED, Verdict.UNDEFINED, Verdict.FIRST]
    assert nothing.compared[2].p_adjusted == nothing.compared[2].difference.p_value  # the only one judged


def test_whom_an_oracle_tells_and_whose_record_is_cut_off_is_said() -> None:
    whole, told = table(TRIALS, "rmse.state"), table(0.5 * TRIALS, "rmse.state")
    told = told.append_column("privileged", pa.array(["bias"] * 30))
    told = told.append_column("complete", pa.array([False] * 2 + [True] * 28))
    found = compare([Contender("A", "A", select(whole)), Contender("B", "B", select(told))], ["rmse.state"])
    notes = [line for line in lines(found) if line.startswith("Note")]
    assert notes == [
        "Note: B: an oracle tells e1 of bias, which no honest estimator knows.",
        "Note: B: the record of 2 of 30 trials is incomplete; figures are those of what is there.",
    ]


def test_it_is_told_for_whom_a_metric_is_undefined() -> None:
    found = compared({"A": TRIALS, "B": np.full(30, np.nan)})
    assert lines(found)[0] == "rmse.position is undefined for B."


def test_trials_too_few_for_an_interval_have_none() -> None:
    found = compared({"A": TRIALS[:3], "B": 2.0 * TRIALS[:3]})
    assert "(no 95% interval from so few trials" in sentence(found.compared[0], found)


def test_trials_of_other_numbers_are_compared_unpaired_and_said_so() -> None:
    one = Contender("A", "A", select(table(TRIALS, "rmse.state")))
    other = Contender("B", "B", select(table(3.0 * TRIALS, "rmse.state", first_trial=100)))
    found = compare([one, other], ["rmse.state"])
    assert not found.compared[0].difference.paired
    assert found.compared[0].verdict is Verdict.FIRST
    assert "30 and 30 trials, unpaired, since fewer than two have seed and trial in common" in lines(found)[0]
    assert facts(found)["comparisons"][0]["paired"] is False


def test_a_sentence_tells_the_numbers() -> None:
    found = compared({"A": TRIALS - 0.1, "B": TRIALS})
    said = sentence(found.compared[0], found)
    assert said.startswith(
        "A is better than B in rmse.position: median difference -0.1 (95% interval -0.1 to -0.1"
    )
    assert "p < 0.0001" in said
    assert "matched-pairs rank biserial -1.00, A lower in 30 and higher in 0 of 30 common trials" in said


def test_a_sure_difference_that_is_too_small_to_matter_is_said_to_be_so() -> None:
    found = compared({"A": 0.99 * TRIALS, "B": TRIALS})
    assert found.compared[0].verdict is Verdict.FIRST
    assert sentence(found.compared[0], found).startswith(
        "A is better than B in rmse.position, but by no more than 5%: median difference"
    )
    strict = compared({"A": 0.99 * TRIALS, "B": TRIALS}, margin=0.001)
    assert sentence(strict.compared[0], strict).startswith("A is better than B in rmse.position: median")
    packets = compared({"A": 0.99 * TRIALS, "B": TRIALS}, "packets.sent")
    assert "packets.sent is lower with A than with B, but by no more than 5%" in lines(packets)[0]


def test_programs_get_the_same_as_people() -> None:
    diverging = TRIALS.copy()
    diverging[:25] = np.inf
    told = facts(compared({"A": diverging, "B": TRIALS, "C": 2 * TRIALS}))
    assert told["correction"] == "holm"
    assert [sample["infinite"] for sample in told["samples"]] == [25, 0, 0]
    assert told["samples"][0]["median"] == "inf"
    assert [own["verdict"] for own in told["comparisons"]] == ["second is better"] * 2 + ["first is better"]
    assert set(told["comparisons"][0]) == {
        *(
            "metric",
            "first",
            "second",
            "verdict",
            "paired",
            "trials",
            "difference",
            "low",
            "high",
            "relative",
        ),
        *("practical_size", "test", "p", "p_adjusted", "effect_name", "effect", "trials_needed", "sentence"),
        "lower_equal_higher",
    }


def test_several_estimators_of_a_trial_make_one_value() -> None:
    rows = pa.concat_tables(
        [table(np.array([3.0, 1.0]), "rmse.state"), table(np.array([4.0, np.inf]), "rmse.state")]
    )
    pooled = sample(select(rows), "rmse.state")
    assert pooled.values.tolist() == [pytest.approx(np.sqrt(12.5)), np.inf]
    counted = rows.rename_columns([*rows.column_names[:-1], "packets.sent"])
    assert sample(select(counted), "packets.sent").values.tolist() == [7.0, np.inf]


def test_equal_contenders_are_called_better_in_no_more_than_5_percent_of_comparisons() -> None:
    """Four equal estimators on common trials, six comparisons; the false-alarm rate is below 1e-6."""
    rng, runs, wrong = np.random.default_rng(4), 60, 0
    for _ in range(runs):
        common = rng.lognormal(0.0, 0.5, 20)
        found = compared({name: common * rng.lognormal(0.0, 0.2, 20) for name in "ABCD"})
        wrong += any(own.verdict in (Verdict.FIRST, Verdict.SECOND) for own in found.compared)
    assert wrong <= stats.binom.ppf(1 - 1e-6, runs, 0.05)
