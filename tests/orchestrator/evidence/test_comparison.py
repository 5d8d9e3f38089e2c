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
from orchestrator.evidence.facts import facts
from orchestrator.evidence.samples import sample
from orchestrator.evidence.wording import lines, sentence


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


def test_one_that_diverges_where_the_other_does_not_is_called_neither_equal_nor_hardly_worse() -> None:
    """A minority of infinite errors moves no median; the verdict must not rest on one."""
    rng = np.random.default_rng(5)
    alike = TRIALS * rng.lognormal(0.0, 0.001, 30)
    assert verdict(alike, TRIALS) is Verdict.EQUAL
    alike[7] = np.inf
    found = compared({"A": TRIALS, "B": alike})
    (own,) = found.compared
    assert own.verdict is Verdict.UNDECIDED
    assert not own.within_margin
    said = sentence(own, found)
    assert said.startswith(
        "No difference between A and B in rmse.position (infinite in 0 of 30 trials with A and in 1 of 30 "
        "trials with B) is shown: "
    )
    assert said.endswith("Nor can they be called equal, since one is infinite where the other is not.")

    often = 1.001 * TRIALS
    often[:5] = np.inf
    found = compared({"A": TRIALS, "B": often})
    (own,) = found.compared
    assert own.verdict is Verdict.FIRST
    said = sentence(own, found)
    assert said.startswith(
        "A is better than B in rmse.position (infinite in 0 of 30 trials with A and in 5 of 30 trials with B)"
        ": median difference"
    )
    for wrong in ("no more than", "negligible", "of their mean"):
        assert wrong not in said
    assert "Where both are finite: median difference -0.00" in said
    assert "A lower in 25 and higher in 0 of 25 common trials" in said


def test_programs_are_told_who_is_infinite_alone_and_no_practical_size() -> None:
    often = 1.001 * TRIALS
    often[:5] = np.inf
    neither = TRIALS.copy()
    neither[:2] = np.inf
    (told,) = facts(compared({"A": neither, "B": often}))["comparisons"]
    assert told["infinite"] == [2, 5]
    assert told["infinite_alone"] == [0, 3]
    assert told["within_margin"] is False
    assert told["relative"] is told["practical_size"] is None
    assert told["finite"]["lower_equal_higher"] == [25, 0, 0]


def test_two_that_diverge_in_the_same_trials_can_be_equal() -> None:
    a, b = TRIALS.copy(), TRIALS * np.random.default_rng(6).lognormal(0.0, 0.001, 30)
    a[:3] = b[:3] = np.inf
    found = compared({"A": a, "B": b})
    assert found.compared[0].verdict is Verdict.EQUAL
    assert "(infinite in 3 of 30 trials with A and in 3 of 30 trials with B)" in lines(found)[0]


def test_nobody_is_called_better_for_being_lower_who_diverges_more_often() -> None:
    risky = 0.8 * TRIALS
    risky[:2] = np.inf
    for first, second in ((risky, TRIALS), (TRIALS, risky)):
        found = compared({"A": first, "B": second})
        (own,) = found.compared
        assert own.p_adjusted < 0.01  # the ranks alone would have called the risky one better
        assert own.verdict is Verdict.MIXED
    assert lines(found)[0].startswith(
        "Neither A nor B is called better in rmse.position (infinite in 0 of 30 trials with A and in 2 of 30 "
        "trials with B), since A is infinite less often, but B is better otherwise: "
    )
    assert facts(found)["comparisons"][0]["verdict"] == "mixed"


def test_divergences_that_outweigh_in_the_ranks_what_is_better_otherwise_leave_it_mixed() -> None:
    """Neither cancels the other into no difference; where divergences prevail they decide."""
    risky = 0.8 * TRIALS
    risky[:9] = np.inf
    found = compared({"A": risky, "B": TRIALS})
    assert found.compared[0].p_adjusted > 0.05
    assert found.compared[0].verdict is Verdict.MIXED
    risky[:24] = np.inf
    found = compared({"A": risky, "B": TRIALS})
    assert found.compared[0].verdict is Verdict.SECOND
    assert "Where both are finite: median difference -0.1" in lines(found)[0]
    assert "A lower in 6 and higher in 0 of 6 common trials" in lines(found)[0]


def test_more_is_better_is_not_turned_around_by_failed_trials() -> None:
    recall = np.random.default_rng(7).uniform(0.5, 0.9, 30)
    rows = [select(table(recall + more, "detector.recall", failed=f)) for more, f in ((0.1, 3), (0.0, 0))]
    found = compare([Contender(n, n, own) for n, own in zip("AB", rows, strict=True)], ["detector.recall"])
    assert found.compared[0].verdict is Verdict.MIXED
    assert "since B is infinite less often, but A is better otherwise" in lines(found)[0]


def test_unpaired_samples_with_infinite_values_are_not_equal_either() -> None:
    rng = np.random.default_rng(8)
    one, other = rng.lognormal(0.0, 0.001, (2, 400))
    other[:8] = np.inf
    rows = [select(table(own, "rmse.state", first_trial=at)) for own, at in ((one, 0), (other, 900))]
    found = compare([Contender(n, n, own) for n, own in zip("AB", rows, strict=True)], ["rmse.state"])
    assert found.compared[0].verdict is Verdict.UNDECIDED
    assert "(infinite in 0 of 400 trials with A and in 8 of 400 trials with B)" in lines(found)[0]
    assert "Of the finite values: median difference" in lines(found)[0]


def test_rare_events_are_told_by_means_and_shares_and_not_by_a_median_of_0() -> None:
    none, some = np.zeros(100), np.zeros(100)
    some[:14] = 1.0
    found = compared({"A": none, "B": some}, "divergences")
    said = lines(found)[0]
    assert said.startswith(
        "A is better than B in divergences: mean 0 and 0.14; they differ in 14 of 100 trials, of which A is "
        "lower in 100% (95% interval 77% to 100%), p = 0.00012"
    )
    assert "median difference" not in said
    (told,) = facts(found)["comparisons"]
    assert told["is_shift"] is False
    assert told["means"] == [0.0, 0.14]
    assert told["lower_share"] == [1.0, pytest.approx(0.768, abs=1e-3), 1.0]
    some[4:] = 0.0
    assert compared({"A": none, "B": some}, "divergences").compared[0].verdict is Verdict.UNDECIDED


def test_an_end_at_0_that_is_itself_rejected_is_said_to_be_so() -> None:
    differences = np.repeat([-1.0, 0.0, 1.0, 2.0], [4, 5, 5, 7])
    found = compared({"A": 5.0 + differences, "B": np.full(21, 5.0)})
    assert "(95% interval 0 to 1.5 without 0 itself, +9.1% of their mean), p = 0.018" in lines(found)[0]


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
        *("of", "within_margin", "infinite", "infinite_alone", "finite", "is_shift", "means"),
        *("lower_equal_higher", "lower_share"),
    }


def test_several_estimators_of_a_trial_make_one_value() -> None:
    rows = pa.concat_tables(
        [table(np.array([3.0, 1.0]), "rmse.state"), table(np.array([4.0, np.inf]), "rmse.state")]
    )
    pooled = sample(select(rows), "rmse.state")
    assert pooled.values.tolist() == [pytest.approx(np.sqrt(12.5)), np.inf]
    counted = rows.rename_columns([*rows.column_names[:-1], "packets.sent"])
    assert sample(select(counted), "packets.sent").values.tolist() == [7.0, np.inf]


def two_estimators(first: np.ndarray, second: np.ndarray, metric: str) -> pa.Table:
    """Return rows of two estimators whose trials have these values."""
    return pa.concat_tables([table(first, metric), table(second, metric)])


def test_one_too_sure_and_one_too_humble_do_not_make_a_consistent_pair() -> None:
    """Ratios of 0.05 and 1.95 have the mean 1; each is far from it."""
    noise = np.random.default_rng(9).lognormal(0.0, 0.05, (4, 30))
    lying = select(two_estimators(0.05 * noise[0], 1.95 * noise[1], "nees.ratio"))
    honest = select(two_estimators(noise[2], noise[3], "nees.ratio"))
    expected = 0.5 * (np.abs(np.log(0.05 * noise[0])) + np.abs(np.log(1.95 * noise[1])))
    assert sample(lying, "nees.ratio").values == pytest.approx(expected)
    found = compare([Contender("A", "A", lying), Contender("B", "B", honest)], ["nees.ratio"])
    assert found.compared[0].verdict is Verdict.SECOND
    said = lines(found)[0]
    assert "median difference 1.78 in |log ratio|" in said
    assert "A nearer to 1 in 0 and farther from 1 in 30 of 30 common trials" in said
    assert {own["of"] for own in facts(found)["samples"]} == {"|log nees.ratio|"}


def test_equal_contenders_are_called_better_in_no_more_than_5_percent_of_comparisons() -> None:
    """Four equal estimators on common trials, six comparisons; the false-alarm rate is below 1e-6."""
    rng, runs, wrong = np.random.default_rng(4), 60, 0
    for _ in range(runs):
        common = rng.lognormal(0.0, 0.5, 20)
        found = compared({name: common * rng.lognormal(0.0, 0.2, 20) for name in "ABCD"})
        wrong += any(own.verdict in (Verdict.FIRST, Verdict.SECOND) for own in found.compared)
    assert wrong <= stats.binom.ppf(1 - 1e-6, runs, 0.05)
