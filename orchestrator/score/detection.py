"""Detectors against the channel's truth: who was attacked, who was accused, and when.

A packet is known by (link, sequence). A delivered packet is *attacked* when the channel attacked that packet
no later than the step of its delivery, or injected it: an injected packet may have the number of a genuine
one, and the name of a node on another link, so it is known by (receiver, sequence, norm of its payload). A
delivered packet is *rejected* when the first verdict on it at or after its delivery is an alarm.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from bus.plan import Plan
from orchestrator.score.gather import Bools, Floats, Gathered, Ints, Packets
from orchestrator.score.link_results import AttackWindow, Confusion, Lockout


@dataclass(frozen=True)
class Judgement:
    """Deliveries, sorted by (link, step, sequence), with their fates; and what else detection needs.

    ``statistic`` is the test statistic of the verdict on each, NaN where there is none. ``judged`` (L,) marks
    links on which some verdict was given. ``hits`` are attacked deliveries by stage, on the links from those
    in whose names they came; ``hit_alarm`` tells whether each was rejected; ``alarms`` are the alarms, each
    at the step in which it was raised.
    """

    link: Ints
    step: Ints
    attacked: Bools
    alarm: Bools
    statistic: Floats
    judged: Bools
    hits: Packets
    hit_alarm: Bools
    alarms: Packets
    unmatched_verdicts: int


def _confusion(accepted: int, false_alarms: int, missed: int, caught: int) -> Confusion:
    """Return the confusion of genuine deliveries, accepted or rejected, and of attacked ones."""
    return Confusion.of(
        true_positive=caught,
        false_positive=false_alarms,
        false_negative=missed,
        true_negative=accepted,
    )


def _codes(gathered: Gathered, steps: int) -> tuple[Ints, Ints, Ints]:
    """Return codes of the deliveries, verdicts and events: code // steps is the packet, the rest its step."""
    tables = (gathered.deliveries, gathered.verdicts, gathered.events)
    dense, size = _dense(np.concatenate([table.sequence for table in tables]))
    packet = np.concatenate([table.link for table in tables]) * size + dense
    code = packet * steps + np.concatenate([table.step for table in tables])
    ends = np.cumsum([table.link.size for table in tables])
    return code[: ends[0]], code[ends[0] : ends[1]], code[ends[1] :]


def _dense(sequence: Ints) -> tuple[Ints, int]:
    """Return small numbers in the order of the sequence numbers, and one that is greater than all of them."""
    low, high = int(sequence.min(initial=0)), int(sequence.max(initial=0))
    if high - low <= 4 * sequence.size:  # as they are, unless somebody made up great ones
        return sequence - low, high - low + 1
    _, dense = np.unique(sequence, return_inverse=True)
    return dense, max(dense.size, 1)


def _before(codes: Ints, sorted_codes: Ints, steps: int) -> Bools:
    """Return whether the sorted codes hold the same packet at the same or an earlier step."""
    at = np.searchsorted(sorted_codes, codes, side="right") - 1
    found = np.append(sorted_codes, -steps)[at]
    same: Bools = found // steps == codes // steps
    return same & (at >= 0)


def _after(codes: Ints, sorted_codes: Ints, steps: int) -> tuple[Bools, Ints]:
    """Return whether the sorted codes hold the same packet at the same or a later step, and where first."""
    at = np.searchsorted(sorted_codes, codes, side="left")
    found = np.append(sorted_codes, -steps)[at]
    return found // steps == codes // steps, at


def _rows(packets: Packets, chosen: Bools | Ints) -> Packets:
    return Packets(*(getattr(packets, field.name)[chosen] for field in fields(packets)))


def _joined(one: Packets, other: Packets) -> Packets:
    return Packets(*(np.concatenate([getattr(one, f.name), getattr(other, f.name)]) for f in fields(Packets)))


def _paired(verdict: Ints, delivery_code: Ints, by_code: Ints, verdict_code: Ints) -> Ints:
    """Return the verdicts by delivery, given one by one where several deliveries have one code.

    They are taken in the order of the inbox, where a step holds as many verdicts as deliveries of a code.
    """
    in_order = delivery_code[by_code]
    if not (in_order[1:] == in_order[:-1]).any():
        return verdict
    codes, counts = np.unique(in_order, return_counts=True)
    judged, verdicts = np.unique(verdict_code, return_counts=True)
    several = np.intersect1d(codes[counts > 1], judged)
    if not several.size:
        return verdict
    fits = counts[np.searchsorted(codes, several)] == verdicts[np.searchsorted(judged, several)]
    of, by = by_code, np.argsort(verdict_code, kind="stable")
    of, by = of[np.isin(delivery_code[of], several[fits])], by[np.isin(verdict_code[by], several[fits])]
    paired = verdict.copy()
    paired[of] = by
    return paired


def _injected(plan: Plan, gathered: Gathered) -> tuple[Bools, Ints, Ints]:
    """Return which deliveries were injected, and pairs: where an injection landed, and which one it was.

    An injection lands where the first delivery from its step on that it is known by is not taken yet.
    """
    deliveries, injections = gathered.deliveries, gathered.injections
    injected = np.zeros(deliveries.link.size, dtype=bool)
    if not injections.link.size:
        return injected, np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    delivered, wanted = _identities(plan, deliveries, injections)
    order = np.argsort(delivered, kind="stable")
    begin, end = (np.searchsorted(delivered[order], wanted, side=side) for side in ("left", "right"))
    _, which_code, counts = np.unique(wanted, return_inverse=True, return_counts=True)
    alone = (end - begin == 1) & (counts[which_code] == 1)
    places, numbers = order[begin[alone]], np.flatnonzero(alone)
    in_time = deliveries.step[places] >= injections.step[numbers]
    landed, which = places[in_time].tolist(), numbers[in_time].tolist()
    injected[landed] = True
    for number in np.flatnonzero(~alone).tolist():
        candidates = order[begin[number] : end[number]]
        later = candidates[deliveries.step[candidates] >= injections.step[number]]
        fresh = later[~injected[later]]
        injected[later] = True
        landed += fresh[:1].tolist()
        which += [number] * len(fresh[:1])
    by_number = np.argsort(which, kind="stable")
    return injected, np.array(landed, dtype=np.int64)[by_number], np.array(which, dtype=np.int64)[by_number]


def _identities(plan: Plan, deliveries: Packets, injections: Packets) -> tuple[Ints, Ints]:
    """Return a number for each packet's (receiver, sequence, norm), equal for equal ones.

    A packet whose norm is not told is like no other: it has a negative number of its own.
    """
    index = {name: i for i, name in enumerate(plan.node_names)}
    receiver = np.array([index[link.destination] for link in plan.links], dtype=np.int64)
    tables = (deliveries, injections)
    number = np.concatenate([receiver[table.link] for table in tables])
    for column in ("sequence", "value"):
        joined = np.concatenate([getattr(table, column) for table in tables])
        values, dense = np.unique(joined, return_inverse=True)
        number = number * values.size + dense
    untold = np.isnan(joined)
    number[untold] = -1 - np.arange(untold.sum())
    return number[: deliveries.link.size], number[deliveries.link.size :]


def judge(plan: Plan, gathered: Gathered) -> Judgement:
    """Match verdicts and channel events with the packets that were delivered."""
    steps = plan.steps
    deliveries, verdicts, events = gathered.deliveries, gathered.verdicts, gathered.events
    delivery_code, verdict_code, event_code = _codes(gathered, steps)
    order = np.lexsort((~verdicts.mark, verdict_code))
    judged_in_time, at = _after(delivery_code, verdict_code[order], steps)
    verdict = np.where(judged_in_time, np.append(order, -1)[at], -1)
    by_code = np.argsort(delivery_code, kind="stable")
    verdict = _paired(verdict, delivery_code, by_code, verdict_code)
    alarm = np.append(verdicts.mark, False)[verdict]
    attack = events.mark
    attacked = _before(delivery_code, np.sort(event_code[attack]), steps)
    reached, at = _after(event_code[attack], delivery_code[by_code], steps)
    attacks = _rows(events, attack)
    landed = by_code[at[reached]]
    injected, places, which = _injected(plan, gathered)
    landed = np.concatenate([landed, places])
    hits = _joined(_rows(attacks, reached), _rows(gathered.injections, which))
    hits = replace(hits, step=deliveries.step[landed], link=deliveries.link[landed])
    judged = np.zeros(len(plan.links), dtype=bool)
    judged[verdicts.link[verdicts.link >= 0]] = True
    matched = (verdicts.link >= 0) & _before(verdict_code, delivery_code[by_code], steps)
    order = np.lexsort((deliveries.sequence, deliveries.step, deliveries.link))
    return Judgement(
        link=deliveries.link[order],
        step=deliveries.step[order],
        attacked=(attacked | injected)[order],
        alarm=alarm[order],
        statistic=np.append(verdicts.value, np.nan)[verdict[order]],
        judged=judged,
        hits=hits,
        hit_alarm=alarm[landed],
        alarms=_rows(verdicts, verdicts.mark),
        unmatched_verdicts=int(np.sum(~matched)),
    )


def link_confusions(judgement: Judgement) -> list[Confusion | None]:
    """Return the confusion of each link of the plan; None where no verdict was given."""
    links = judgement.judged.size
    cell = 4 * judgement.link + 2 * judgement.attacked + judgement.alarm
    counts = np.bincount(cell, minlength=4 * links).reshape(links, 4).tolist()
    return [
        _confusion(*own) if judged else None for judged, own in zip(judgement.judged, counts, strict=True)
    ]


def _release(judgement: Judgement, link: int, last: int) -> int | None:
    """Return the steps from the first genuine packet after ``last`` to the first that was accepted."""
    genuine = (judgement.link == link) & (judgement.step > last) & ~judgement.attacked
    accepted = genuine & ~judgement.alarm
    if not accepted.any():
        return None
    return int(judgement.step[np.argmax(accepted)] - judgement.step[np.argmax(genuine)])


def attack_windows(plan: Plan, judgement: Judgement, grace: int) -> list[AttackWindow]:
    """Return what happened in the window of each stage that attacked a delivered packet, by link and stage.

    An alarm detects a window when it is raised on that link from the window's first step to ``grace`` steps
    after its last.
    """
    hits, alarms = judgement.hits, judgement.alarms
    windows = []
    for link, stage in sorted(set(zip(hits.link.tolist(), hits.stage.tolist(), strict=True))):
        rows = (hits.link == link) & (hits.stage == stage)
        steps = hits.step[rows]
        first, last = int(steps.min()), int(steps.max())
        raised = alarms.step[alarms.link == link]
        raised = raised[(raised >= first) & (raised <= last + grace)]
        judged = bool(judgement.judged[link])
        windows.append(
            AttackWindow(
                link=plan.links[link].name,
                stage=plan.stages[stage].label if stage >= 0 else "unknown",
                judged=judged,
                first=first,
                last=last,
                packets=int(steps.size),
                rejected=int(judgement.hit_alarm[rows].sum()),
                delay=int(raised.min()) - first if raised.size else None,
                censored=not raised.size and last + grace >= plan.steps - 1,
                release=_release(judgement, link, last) if judged else None,
            )
        )
    return windows


def find_lockouts(plan: Plan, judgement: Judgement, length: int) -> list[Lockout]:
    """Return the judged links whose last ``length`` or more genuine packets were all rejected."""
    genuine = ~judgement.attacked
    link, step, alarm = judgement.link[genuine], judgement.step[genuine], judgement.alarm[genuine]
    bounds = np.searchsorted(link, np.arange(judgement.judged.size + 1))
    lockouts = []
    for index in np.flatnonzero(judgement.judged):
        begin, end = bounds[index], bounds[index + 1]
        accepted = np.flatnonzero(~alarm[begin:end])
        run = int(end - begin - (accepted[-1] + 1 if accepted.size else 0))
        if run >= length:
            name, node = plan.links[index].name, plan.links[index].destination
            lockouts.append(Lockout(node=node, link=name, first_step=int(step[end - run]), packets=run))
    return lockouts


def attacked_steps(plan: Plan, judgement: Judgement) -> Bools:
    """Return (N, K): whether an attacked packet reached each estimator, or an attack the plant, in each step.

    What moves the plant concerns all estimators: a falsified input, and a signal in all of its window.
    """
    index = {estimator.name: i for i, estimator in enumerate(plan.estimators)}
    receiver = np.array([index.get(link.destination, len(index)) for link in plan.links], dtype=np.int64)
    marks = np.zeros((len(index) + 1, plan.steps), dtype=bool)
    marks[receiver[judgement.link[judgement.attacked]], judgement.step[judgement.attacked]] = True
    for signal in plan.signals:
        marks[-1, signal.timing.first : signal.timing.last + 1] = True
    return np.asarray(marks[:-1] | marks[-1])
