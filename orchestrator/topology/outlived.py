"""Which nodes a run may outlive."""

from __future__ import annotations

from collections.abc import Sequence

from bus.plan import StagePlan
from orchestrator.topology.draft import Draft
from orchestrator.topology.names import matches, select
from orchestrator.topology.problems import did_you_mean
from orchestrator.topology.targets import PLANT_NAME, senders


def outlived_nodes(draft: Draft, stages: Sequence[StagePlan]) -> frozenset[str]:
    """Return the nodes whose death does not stop the run; the last pattern that fits a node holds.

    Nothing goes on without the plant, or without a node that a trigger of the channel watches.
    """
    nodes = senders(draft)
    policy: dict[str, str] = {}
    for pattern, chosen in draft.sections["process"].on_crash.items():
        path = ("process", "on_crash", pattern)
        if matches(pattern, PLANT_NAME) and not select(pattern, nodes):
            draft.complain(path, "nothing goes on without the plant", "name sensors, estimators, controllers")
        elif not select(pattern, nodes):
            draft.complain(path, f"there is no node '{pattern}'", did_you_mean(pattern, nodes))
        policy.update(dict.fromkeys(select(pattern, nodes), chosen))
    outlived = frozenset(name for name, chosen in policy.items() if chosen == "silence")
    for watched in sorted({stage.timing.watches for stage in stages} & outlived):
        message = f"a trigger watches {watched}, and would wait for it for ever"
        draft.complain(("process", "on_crash"), message, f"add '{watched}: stop'")
    return outlived
