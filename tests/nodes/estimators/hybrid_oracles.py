"""What the hybrid Bernoulli filter is held against: the enumeration of all hypotheses, in a small world."""

from __future__ import annotations

import itertools
from types import SimpleNamespace

import numpy as np
from scipy.stats import multivariate_normal

from tests.nodes.estimators.attacked_world import BOX, Attackable


def enumerate_hypotheses(
    world: Attackable,
    inboxes: list[dict[str, list[np.ndarray]]],
    estimator: dict[str, object],
    feedthrough: bool,
) -> SimpleNamespace:
    """Return r, and mean and covariance of state and signal, by summing over every possible story.

    A story says for each step whether there was an attack and of which component of its prior, and which
    packet of each sensor was genuine. Given a story all is one Gaussian, and its measurements are regressed
    on at once: nothing here is recursive.
    """
    steps = len(inboxes)
    laws = world.prior
    weights = np.array([law.weight for law in laws]) / sum(law.weight for law in laws)
    times = range(steps) if feedthrough else range(steps - 1)
    modes = [-1, *range(len(laws))]
    slots = [(k, name, values) for k, box in enumerate(inboxes) for name, values in box.items()]
    joint = _Joint(world, steps)
    parts = {"safe": [], "attacked": []}
    for attacks in itertools.product(modes, repeat=len(times)):
        chance = 1.0
        for before, now in itertools.pairwise((None, *attacks)):
            if before is None:
                p = estimator["initial_attack_probability"]
            else:
                p = estimator["attack_survival"] if before >= 0 else estimator["attack_birth"]
            chance *= p * weights[now] if now >= 0 else 1.0 - p
        for genuine in itertools.product(*(range(-1, len(values)) for _, _, values in slots)):
            weight, used = chance, []
            for (k, name, values), which in zip(slots, genuine, strict=True):
                weight *= _origin(estimator, values, which)
                if which >= 0:
                    used.append((k, name, values[which]))
            if weight > 0.0:
                log_weight, mean, covariance = joint.posterior(attacks, used, feedthrough)
                last = attacks[-1] if attacks else -1
                key = "attacked" if last >= 0 else "safe"
                parts[key].append((np.log(weight) + log_weight, mean, covariance))
    return _summary(parts)


def _origin(estimator: dict[str, object], values: list[np.ndarray], which: int) -> float:
    """Return the factor of "this packet is genuine", up to what all stories share."""
    kappa = np.exp(BOX.law(values[0].size).log_level)
    if len(values) == 1 and estimator.get("correction") != "injection":
        pf = estimator["substitution"]
        return pf * kappa if which < 0 else 1.0 - pf
    pd = estimator["delivery"]
    return 1.0 - pd if which < 0 else pd / (len(values) * kappa)


class _Joint:
    """All variables of a story: x_0, the noises, and a signal a step, as one Gaussian vector."""

    def __init__(self, world: Attackable, steps: int) -> None:
        self.world, self.steps = world, steps
        self.n, self.q = len(world.plant.A), world.plant.G.shape[1]
        self.size = self.n * steps + self.q * steps

    def posterior(
        self, attacks: tuple[int, ...], used: list[tuple[int, str, np.ndarray]], feedthrough: bool
    ) -> tuple[float, np.ndarray, np.ndarray]:
        n, q, plant = self.n, self.q, self.world.plant
        mean, covariance = np.zeros(self.size), np.zeros((self.size, self.size))
        mean[:n], covariance[:n, :n] = plant.initial_mean, plant.initial_covariance
        for k in range(1, self.steps):
            covariance[k * n : k * n + n, k * n : k * n + n] = plant.Q
        signal = [slice(n * self.steps + q * k, n * self.steps + q * k + q) for k in range(self.steps)]
        for k, which in enumerate(attacks):
            if which >= 0:
                law = self.world.prior[which]
                mean[signal[k]] = law.mean_vector(q)
                covariance[signal[k], signal[k]] = law.covariance_matrix(q)
        state = [np.zeros((n, self.size)) for _ in range(self.steps)]
        state[0][:, :n] = np.eye(n)
        for k in range(1, self.steps):
            state[k] = plant.A @ state[k - 1]
            state[k][:, k * n : k * n + n] += np.eye(n)
            state[k][:, signal[k - 1]] += plant.G
        rows, noise, values = [np.zeros((0, self.size))], [], []
        for k, name, value in used:
            sensor = self.world.sensors[name]
            row = sensor.C @ state[k]
            if feedthrough:
                row[:, signal[k]] += sensor.H
            rows.append(row)
            noise.append(sensor.R)
            values.append(value)
        target = state[-1]
        if attacks and attacks[-1] >= 0:
            chosen = np.zeros((q, self.size))
            chosen[:, signal[len(attacks) - 1]] = np.eye(q)
            target = np.vstack((target, chosen))
        m, P = target @ mean, target @ covariance @ target.T
        if not used:
            return 0.0, m, P
        E, y = np.vstack(rows), np.concatenate(values)
        R = np.zeros((len(y), len(y)))
        at = 0
        for block in noise:
            R[at : at + len(block), at : at + len(block)] = block
            at += len(block)
        S, cross = E @ covariance @ E.T + R, target @ covariance @ E.T
        gain = np.linalg.solve(S, cross.T).T
        log = float(multivariate_normal.logpdf(y, E @ mean, S))
        return log, m + gain @ (y - E @ mean), P - gain @ cross.T


def _summary(parts: dict[str, list[tuple[float, np.ndarray, np.ndarray]]]) -> SimpleNamespace:
    largest = max(log for part in parts.values() for log, _, _ in part)
    totals, moments = {}, {}
    for key, part in parts.items():
        weights = np.exp([log - largest for log, _, _ in part])
        totals[key] = weights.sum()
        if not len(part):
            continue
        weights = weights / weights.sum()
        mean = sum(w * m for w, (_, m, _) in zip(weights, part, strict=True))
        covariance = sum(
            w * (P + np.outer(m - mean, m - mean)) for w, (_, m, P) in zip(weights, part, strict=True)
        )
        moments[key] = mean, covariance
    return SimpleNamespace(r=totals["attacked"] / sum(totals.values()), **moments)
