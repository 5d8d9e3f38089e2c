"""What an estimator may publish: a field of another type is refused with its place and the cure."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from nodes import checked as guard
from nodes.checked import checked_payload
from nodes.contract import Belief, Detection

ORDER = "; a Detection takes source, sequence, statistic and alarm, in this order"


def checked(said: Any) -> tuple[Belief, bool]:
    return guard.checked(said, ((2,), (2, 2)))


def belief(**parts: Any) -> Belief:
    return Belief(**{"state": np.zeros(2), "covariance": np.eye(2), "nis": 1.0, "nis_dof": 1, **parts})


def judged(*verdict: Any) -> Belief:
    """A belief whose second detection is made of the values given."""
    return belief(detections=[Detection("s1", 0, 0.5, False), Detection(*verdict)])


@pytest.mark.parametrize(
    ("said", "words"),
    [
        (judged(3, "s1", 0.5, False), f"detections[1].source must be text, got 3 (int){ORDER}"),
        (judged("s1", "3", 0.5, False), "detections[1].sequence must be a whole number, got '3' (str)"),
        (judged("s1", True, 0.5, 3), f"detections[1].alarm must be True or False, got 3 (int){ORDER}"),
        (judged("s1", 3, True, 0.5), f"detections[1].alarm must be True or False, got 0.5 (float){ORDER}"),
        (judged("s1", 3, None, True), "detections[1].statistic must be a number, got None (NoneType)"),
        (judged("s1", 2.5, 1.0, True), "detections[1].sequence must be a whole number, got 2.5 (float)"),
        (judged("s1", True, 1.0, True), "detections[1].sequence must be a whole number, got True (bool)"),
        (judged("s1", 3, 1.0, "no"), "detections[1].alarm must be True or False, got 'no' (str)"),
        (judged("s1", 3, 1.0, np.int64(1)), "detections[1].alarm must be True or False, got"),
        (judged("s1", 3, np.ones(2), True), "detections[1].statistic must be a number, got array([1., 1.])"),
        (judged("s1", 3, 1j, True), "detections[1].statistic must be a number, got 1j (complex)"),
        (belief(detections=[("s1", 0, 0.5, False)]), "detections[0] must be a nodes.contract.Detection, got"),
        (belief(detections=Detection("s1", 0, 0.5, False)), "detections must be a list, got Detection("),
        (belief(detections=None), "detections must be a list, got None (NoneType)"),
        (belief(nis_dof=1.5), "nis_dof must be a whole number, got 1.5 (float); the degrees of freedom"),
        (belief(nis_dof=-1), "nis_dof must be 0 or more, got -1 (int); 0 says that no packet came"),
        (belief(nis="1.0"), "nis must be a number, got '1.0' (str)"),
        (belief(nis=None), "nis must be a number, got None (NoneType)"),
        (belief(refers_to=0.5), "refers_to must be a whole number, got 0.5 (float); a step; None is"),
        (belief(diagnostics={"gain": np.ones(2)}), "diagnostics['gain'] must be a number, got array([1."),
        (belief(diagnostics={"gain": "big"}), "diagnostics['gain'] must be a number, got 'big' (str)"),
        (belief(diagnostics={3: 1.0}), "a name in diagnostics must be text, got 3 (int)"),
        (belief(diagnostics=[1.0]), "diagnostics must be a dictionary, got [1.0] (list)"),
        (belief(state=[0.0, 0.0]), "state must be an array, got [0.0, 0.0] (list); numpy.array makes one"),
        (belief(state=np.zeros(2, dtype=complex)), "state must hold real numbers, got an array of comp"),
        (belief(covariance=None), "covariance must be an array, got None (NoneType)"),
        (None, "what `estimate` returns must be a nodes.contract.Belief, got None (NoneType)"),
        ((np.zeros(2), np.eye(2)), "what `estimate` returns must be a nodes.contract.Belief, got (array("),
    ],
)  # fmt: skip
def test_a_field_of_another_type_is_refused_with_its_place_and_what_it_must_be(said: Any, words: str) -> None:
    with pytest.raises(TypeError) as caught:
        checked(said)
    assert words in str(caught.value)


def test_a_long_value_is_cut_in_the_message() -> None:
    with pytest.raises(TypeError) as caught:
        checked(belief(nis="x" * 10_000))
    assert len(str(caught.value)) < 200


class Own(np.ndarray):
    """An array of a class of its own."""


ONE = belief(
    refers_to=3,
    detections=[Detection("s1", 4, 0.5, True)],
    diagnostics={"gain": 0.25},
)
SAME = [
    belief(
        refers_to=np.int64(3),
        nis=np.float32(1.0),
        nis_dof=np.int8(1),
        detections=[Detection(np.str_("s1"), np.uint16(4), np.float64(0.5), np.bool_(True))],  # type: ignore[arg-type]
        diagnostics={np.str_("gain"): np.array(0.25)},
    ),
    belief(
        refers_to=3.0,
        nis=1,
        nis_dof=1.0,
        detections=(Detection("s1", 4, np.array([[0.5]]), np.array([True])),),  # type: ignore[arg-type]
        diagnostics={"gain": Fraction(1, 4)},
    ),
    belief(
        state=np.zeros(2, dtype=np.int64),
        covariance=np.eye(2, dtype=np.float32).view(Own),
        refers_to=3,
        detections=np.array([Detection("s1", 4, 0.5, True)], dtype=object),
        diagnostics={"gain": 0.25},
    ),
]


def facts(said: Belief) -> list[Any]:
    return [
        *(said.state.tolist(), said.covariance.tolist(), said.state.dtype, type(said.covariance)),
        *(said.refers_to, said.nis, said.nis_dof, list(said.detections), dict(said.diagnostics)),
    ]


@pytest.mark.parametrize("said", SAME)
def test_what_means_the_same_in_another_library_s_types_is_taken(said: Belief) -> None:
    taken, finite = checked(said)
    assert finite
    assert facts(taken) == facts(ONE)
    (detection,) = taken.detections
    assert (type(detection.source), type(detection.sequence), type(taken.nis_dof)) == (str, int, int)


def test_a_belief_of_the_very_types_is_the_same_object() -> None:
    assert checked(ONE) == (ONE, True)
    assert checked(ONE)[0] is ONE


def test_detections_that_can_be_looked_at_only_once_are_not_lost() -> None:
    def one_by_one() -> Iterator[Detection]:
        yield Detection("s1", 4, 0.5, True)

    taken, _ = checked(belief(detections=one_by_one()))
    assert list(taken.detections) == [Detection("s1", 4, 0.5, True)]


@pytest.mark.parametrize(
    ("parts", "finite"),
    [
        ({"nis": 10**400}, False),
        ({"nis": np.float32(np.inf), "nis_dof": np.int64(1)}, False),
        ({"state": np.array([1e308, 1e308])}, True),
        ({"state": np.array([1e308, np.nan])}, False),
        ({"detections": [Detection("s1", 0, -np.inf, True), Detection("s1", 1, np.inf, True)]}, False),
    ],
)
def test_numbers_that_are_not_finite_are_told_from_large_ones(parts: dict[str, Any], finite: bool) -> None:
    assert checked(belief(**parts))[1] is finite


@pytest.mark.parametrize("values", [np.array([1, 2]), np.array([1.0, 2.0], dtype=np.float32)])
def test_a_payload_of_other_real_numbers_becomes_one_of_floats(values: Any) -> None:
    payload = checked_payload(values)
    assert (str(payload.dtype), payload.tolist()) == ("float64", [1.0, 2.0])


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ([1.0, 2.0], r"a payload must be an array, got \[1.0, 2.0\] \(list\); numpy.array makes one"),
        (1.0, r"a payload must be an array, got 1.0 \(float\)"),
        (np.array(["a"]), "a payload must hold real numbers, got an array of <U1"),
    ],
)
def test_a_payload_that_is_no_array_of_real_numbers_is_refused(values: Any, words: str) -> None:
    with pytest.raises(TypeError, match=words):
        checked_payload(values)
