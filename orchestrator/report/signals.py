"""What an estimator said of a signal attack on the plant: its probability, and the signal itself."""

from __future__ import annotations

import numpy as np

from orchestrator.report.contents import Choice, Figure, Trace, View
from orchestrator.report.lines import line, stacked
from orchestrator.report.recording import Recording
from orchestrator.report.steps import over_steps, step_shapes
from orchestrator.report.thinning import kept
from orchestrator.score.gather import Floats

SHOWN = 24
"""Most estimators that can be chosen."""


def signal_figure(recording: Recording) -> Figure | None:
    """Return probability and signal beside the truth, one estimator at a time; None if none spoke of it."""
    beliefs = recording.evidence.gathered.attack_beliefs
    spoke = ~(np.isnan(beliefs.probability).all(axis=1) & np.isnan(beliefs.value).all(axis=(1, 2)))
    chosen = np.flatnonzero(spoke)[:SHOWN].tolist()
    if not chosen:
        return None
    q = beliefs.signal.shape[1]
    views: dict[tuple[str, ...], View] = {
        (recording.names[node],): View(
            _traces(recording, node), {"shapes": step_shapes(recording, beliefs.on[: recording.steps])}
        )
        for node in chosen
    }
    names = [(recording.names[node], recording.names[node]) for node in chosen]
    titles = ["probability", *(f"signal {i + 1}" for i in range(q))]
    return Figure(
        name="signal-attack",
        title="What was said of the attack on the plant",
        views=views,
        layout=over_steps(recording, stacked(titles, [1.0] * len(titles), recording.plan.period_s)),
        choices=(Choice("Estimator", names, names[0][0]),),
        text="Above, the probability of an attack in each step; below, the signal and its estimate, in the "
        "steps that were called attacked. Shaded: there was an attack.",
        height=180 + 130 * q,
    )


def _traces(recording: Recording, node: int) -> list[Trace]:
    """Return the traces of one estimator, by the steps that it spoke of."""
    beliefs = recording.evidence.gathered.attack_beliefs
    on, signal = beliefs.on[: recording.steps], beliefs.signal[: recording.steps]
    said = np.flatnonzero((beliefs.about[node] >= 0) & (beliefs.about[node] < recording.steps))
    about = beliefs.about[node, said]
    probability = _by_step(beliefs.probability[node, said], about, recording.steps)
    at = kept(probability)
    hover = {"hovertemplate": "%{y:.4g}"}
    traces = [line(at, probability[at], "estimate", "$blue", **hover)]
    for i in range(signal.shape[1]):
        truth = np.where(on, signal[:, i], np.nan)
        value = _by_step(beliefs.value[node, said, i], about, recording.steps)
        likely = np.isnan(probability) | (probability > 0.5)
        value = np.where(likely, value, np.nan)
        at = kept(value)
        axis = {"yaxis": f"y{i + 2}"}
        true = {"legendgroup": "truth", "showlegend": i == 0, **axis, **hover}
        told = {"legendgroup": "estimate", "showlegend": False, **axis, **hover}
        traces.append(line(at, truth[at], "truth", "$ink", width=2.2, **true))
        traces.append(line(at, value[at], "estimate", "$blue", **told))
    traces[0]["legendgroup"] = "estimate"
    return traces


def _by_step(values: Floats, about: np.ndarray[tuple[int], np.dtype[np.int64]], steps: int) -> Floats:
    series = np.full(steps, np.nan)
    series[about] = values
    return series
