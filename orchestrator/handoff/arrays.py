"""Labelled arrays: every axis has a name, and every place on it a coordinate."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from orchestrator.evidence.rows import SCORED
from orchestrator.handoff.evidence import bounded_groups
from orchestrator.score.gather import Floats, Ints
from orchestrator.score.scoring import Evidence
from orchestrator.topology.resolved import Topology

if TYPE_CHECKING:
    import pyarrow as pa
    import xarray as xr

_BY_STEP = ("node", "step")
_FIGURES = ("nees", "nis", "nis_dof", "attacked", "sent")


def run_arrays(
    topology: Topology,
    evidence: Evidence,
    components: Sequence[str],
    estimates: pa.Table,
    truth: pa.Table,
    rows: pa.Table,
) -> xr.Dataset:
    """Return the arrays of a run, N estimators, K steps, n components and G state groups.

    ``truth`` (K, n); ``estimate``, ``sigma``, ``error`` (N, K, n); ``covariance`` (N, K, n, n);
    ``error_norm``, ``bound`` (N, K, G); ``nees``, ``nis``, ``nis_dof``, ``attacked``, ``sent``, ``refers_to``
    (N, K); all by the step of publication. NaN where there is none. ``rows`` of evidence have bound and sent.
    """
    import xarray as xr

    plan, own = topology.plan, evidence.gathered.estimates
    names = [estimator.name for estimator in plan.estimators]
    groups = sorted(evidence.errors.norm)
    by_component, state = (*_BY_STEP, "component"), list(components)
    place = _places(estimates, names, plan.steps)

    def by_step(column: str) -> Floats:
        return _series(rows, column, [range(len(names))], place[1])

    variables: dict[str, Any] = {
        "truth": (("step", "component"), _filled(truth, state, [np.asarray(truth["step"])], (plan.steps,))),
        "estimate": (by_component, _filled(estimates, state, *place)),
        "sigma": (by_component, _filled(estimates, [f"sigma_{name}" for name in state], *place)),
        "error": (by_component, own.error),
        "covariance": ((*by_component, "other_component"), own.covariance),
        "error_norm": ((*_BY_STEP, "group"), np.stack([evidence.errors.norm[name] for name in groups], 2)),
        "nees": (_BY_STEP, evidence.nees),
        "nis": (_BY_STEP, np.where(own.nis_dof > 0, own.nis, np.nan)),
        "nis_dof": (_BY_STEP, own.nis_dof),
        "attacked": (_BY_STEP, evidence.attacked),
        "bound": ((*_BY_STEP, "group"), np.stack([by_step(f"pcrb.{name}") for name in groups], 2)),
        "sent": (_BY_STEP, by_step("sent")),
        "refers_to": (_BY_STEP, _filled(estimates, ["refers_to"], *place)[..., 0]),
    }
    coordinates = {
        "node": names,
        "step": np.arange(plan.steps),
        "t": ("step", np.arange(plan.steps) * plan.period_s),
        "component": state,
        "other_component": state,
        "group": groups,
        "method": ("node", [estimator.kind.reference.rpartition(":")[2] for estimator in plan.estimators]),
    }
    facts = {"name": plan.name, "seed": plan.seed, "trial": plan.trial, "topology_hash": topology.hash}
    return xr.Dataset(variables, coords=coordinates, attrs=facts)


def _places(table: pa.Table, names: Sequence[str], steps: int) -> tuple[list[Ints], tuple[int, ...]]:
    """Return where each row of a table goes in an array by node and step, and the array's shape."""
    index = {name: i for i, name in enumerate(names)}
    node = np.array([index[name] for name in table["node"].to_pylist()], dtype=np.int64)
    return [node, np.asarray(table["step"])], (len(names), steps)


def _filled(table: pa.Table, columns: Sequence[str], place: Sequence[Ints], shape: tuple[int, ...]) -> Floats:
    """Return an array with the values of some columns on its last axis; NaN where no row goes."""
    whole = np.full((*shape, len(columns)), np.nan)
    for i, column in enumerate(columns):
        whole[..., i][tuple(place)] = table[column].to_numpy()
    return whole


def _series(rows: pa.Table, column: str, places: Sequence[Sequence[int]], shape: tuple[int, ...]) -> Floats:
    """Return an array with the list of each row at its place, on the last axis; NaN where there is none."""
    whole = np.full(shape, np.nan)
    for *place, values in zip(*places, rows[column], strict=True):
        if values.is_valid:
            own = values.values.to_numpy(zero_copy_only=False)
            whole[tuple(place)][: len(own)] = own
    return whole


def campaign_arrays(rows: pa.Table, groups: Sequence[str], attributes: dict[str, Any]) -> xr.Dataset:
    """Return the arrays of a campaign by ``variant``, ``trial``, ``node`` and ``step``.

    ``error_norm``, and ``bound`` where results have it, have a further axis ``group``; ``nees``, ``nis``,
    ``nis_dof``, ``attacked`` and ``sent`` have none. NaN where a variant has no such node or step, and in
    trials that failed.
    """
    import xarray as xr

    held = rows.filter([status == SCORED for status in rows["status"].to_pylist()])
    axes = {
        "variant": sorted(set(rows["variant"].to_pylist())),
        "trial": sorted(set(rows["trial"].to_pylist())),
        "node": list(dict.fromkeys(held["node"].to_pylist())),
    }
    places = [[values.index(own) for own in held[axis].to_pylist()] for axis, values in axes.items()]
    steps = max((len(values) for values in held["nees"]), default=0)
    shape = (len(axes["variant"]), len(axes["trial"]), len(axes["node"]), steps)

    def series(column: str) -> Floats:
        return _series(held, column, places, shape)

    dims = (*axes, "step")
    variables: dict[str, Any] = {name: (dims, series(name)) for name in _FIGURES}
    for name, column, known in (("error_norm", "error", groups), ("bound", "pcrb", bounded_groups(rows))):
        if known:
            stacked = np.stack([series(f"{column}.{group}") for group in groups], axis=-1)
            variables[name] = ((*dims, "group"), stacked)
    coordinates: dict[str, Any] = {**axes, "step": np.arange(steps), "group": list(groups)}
    return xr.Dataset(variables, coords=coordinates, attrs=attributes)
