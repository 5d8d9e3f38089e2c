"""What an estimator may publish, held against the contract: every field has its type, or the node fails.

Nearly every belief has the very types of the contract; one look tells that. All others are taken apart field
by field: what means the same as a number, a text or an array of another library becomes Python's own.
"""

from __future__ import annotations

import math
import reprlib
from collections.abc import Mapping, Sequence
from numbers import Integral, Real
from typing import Any, cast

import numpy as np

from bus.packets import Vector
from nodes.contract import Belief, Detection, Matrix

Shapes = tuple[tuple[int, ...], tuple[int, ...]]

_FLOAT = np.dtype(np.float64)
_LISTS = (tuple, list)
_TRUTHS = (bool, np.bool_)
_ORDER = "a Detection takes source, sequence, statistic and alarm, in this order"


def checked(belief: Any, shapes: Shapes) -> tuple[Belief, bool]:
    """Return a belief with the types of `Belief` and `Detection`, and whether all its numbers are finite.

    ``shapes`` are those of state and covariance. Single numbers and truths may remain numpy's own, and
    numbers may be whole. Raises TypeError that names the field, what it must be and what it is, ValueError
    for other shapes.
    """
    total: object = None
    try:
        numbers = _numbers_if_plain(belief, shapes)
        total = sum(numbers)
    except (AttributeError, TypeError, OverflowError):
        pass  # a field is not what it shall be: which one is told below
    if not isinstance(total, float):  # nor is the sum of what are no real numbers, or of none
        belief = _converted(belief, shapes)
        numbers = _numbers_if_plain(belief, shapes)
        total = sum(numbers)
    return belief, math.isfinite(total) or all(map(math.isfinite, numbers))  # a sum may overflow


def checked_payload(values: Any) -> Vector:
    """Return a payload as an array (m,) of float64.

    Raises TypeError for what holds no real numbers, ValueError for another number of dimensions.
    """
    if type(values) is not np.ndarray or values.dtype is not _FLOAT:
        values = _array(values, "a payload")
    if values.ndim != 1:
        raise ValueError(f"a payload has one dimension, this one has the shape {values.shape}; ravel it")
    return cast("Vector", values)


def _numbers_if_plain(belief: Belief, shapes: Shapes) -> list[float]:
    """Return all numbers of a belief whose other fields have the very types that they shall have.

    Of any other belief there are none, or an error says so. This is asked in every step of every estimator.
    """
    state, covariance, detections = belief.state, belief.covariance, belief.detections
    if (
        (state.shape, covariance.shape) != shapes
        or state.dtype is not _FLOAT
        or covariance.dtype is not _FLOAT
        or type(belief.nis_dof) is not int
        or belief.nis_dof < 0
        or not (belief.refers_to is None or type(belief.refers_to) is int)
        or type(detections) not in _LISTS
    ):
        return []
    numbers = [*state.tolist(), *covariance.ravel().tolist(), belief.nis, *belief.diagnostics.values()]
    for own in detections:
        if type(own.source) is not str or type(own.sequence) is not int or type(own.alarm) not in _TRUTHS:
            return []
        numbers.append(own.statistic)
    for name in belief.diagnostics:
        if type(name) is not str:
            return []
    return numbers


def _converted(belief: Any, shapes: Shapes) -> Belief:
    if not isinstance(belief, Belief):
        raise _not(belief, "what `estimate` returns", "a nodes.contract.Belief")
    state, covariance = _array(belief.state, "state"), _array(belief.covariance, "covariance")
    if (state.shape, covariance.shape) != shapes:
        raise ValueError(
            f"a belief has state and covariance of the shapes {shapes}, "
            f"this one {(state.shape, covariance.shape)}"
        )
    refers_to = belief.refers_to
    nis_dof = _whole(belief.nis_dof, "nis_dof", "the degrees of freedom of nis")
    if nis_dof < 0:
        raise _not(belief.nis_dof, "nis_dof", "0 or more", "0 says that no packet came")
    return Belief(
        state,
        cast("Matrix", covariance),
        None if refers_to is None else _whole(refers_to, "refers_to", "a step; None is the current one"),
        _number(belief.nis, "nis"),
        nis_dof,
        _detections(belief.detections),
        _diagnostics(belief.diagnostics),
    )


def _detections(found: Any) -> Sequence[Detection]:
    if isinstance(found, Detection | str | bytes | Mapping) or not np.iterable(found):
        raise _not(found, "detections", "a list", "with a nodes.contract.Detection for each packet judged")
    return [_detection(own, f"detections[{place}]") for place, own in enumerate(found)]


def _detection(own: Any, where: str) -> Detection:
    if not isinstance(own, Detection):
        raise _not(own, where, "a nodes.contract.Detection")
    source, alarm = _plain(own.source), _plain(own.alarm)
    if not isinstance(source, str):
        raise _not(own.source, f"{where}.source", "text", _ORDER)
    if not isinstance(alarm, bool):
        raise _not(own.alarm, f"{where}.alarm", "True or False", _ORDER)
    sequence = _whole(own.sequence, f"{where}.sequence", _ORDER)
    return Detection(str(source), sequence, _number(own.statistic, f"{where}.statistic", _ORDER), alarm)


def _diagnostics(found: Any) -> Mapping[str, float]:
    if not isinstance(found, Mapping):
        raise _not(found, "diagnostics", "a dictionary", "of a number by name")
    numbers = {}
    for name, value in found.items():
        if not isinstance(name, str):
            raise _not(name, "a name in diagnostics", "text")
        each = "each component under a name of its own" if np.ndim(value) else ""
        numbers[str(name)] = _number(value, f"diagnostics[{str(name)!r}]", each)
    return numbers


def _array(values: Any, what: str) -> Vector:
    """Return an array of float64 with the same real numbers."""
    if not isinstance(values, np.ndarray):
        raise _not(values, what, "an array", "numpy.array makes one")
    if values.dtype.kind not in "fiub":
        raise TypeError(f"{what} must hold real numbers, got an array of {values.dtype}")
    return np.asarray(values, dtype=np.float64)


def _plain(value: Any) -> Any:
    """Return the scalar of Python for one of numpy, or for an array that holds nothing else."""
    return value.item() if isinstance(value, np.generic | np.ndarray) and value.size == 1 else value


def _number(value: Any, what: str, cure: str = "") -> float:
    number = _plain(value)
    if not isinstance(number, Real):
        raise _not(value, what, "a number", cure)
    try:
        return float(number)
    except OverflowError:  # an integer beyond all floats
        return math.inf


def _whole(value: Any, what: str, cure: str) -> int:
    number = _plain(value)
    if isinstance(number, float) and number.is_integer():
        number = int(number)
    if isinstance(number, bool) or not isinstance(number, Integral):
        raise _not(value, what, "a whole number", cure)
    return int(number)


def _not(value: Any, what: str, wanted: str, cure: str = "") -> TypeError:
    """Return the error of a field that is not as it must be."""
    got = f"got {reprlib.repr(value)} ({type(value).__name__})"
    return TypeError(f"{what} must be {wanted}, {got}{cure and '; '}{cure}")
