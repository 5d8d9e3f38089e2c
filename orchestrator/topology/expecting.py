"""From the section ``expect`` to expectations: what they name exists, and their bounds can hold."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence

from orchestrator.score.catalogue import find_metric, metric_names
from orchestrator.score.expectation import Expectation
from orchestrator.topology.draft import Draft
from orchestrator.topology.names import select
from orchestrator.topology.problems import PathKeys, did_you_mean
from orchestrator.topology.schema import Limit
from orchestrator.topology.targets import links_of_pattern


def read_expectations(draft: Draft, groups: Collection[str], links: Sequence[str]) -> tuple[Expectation, ...]:
    """Return the expectations that are in order, given the plant's state groups and all links."""
    found = []
    for metric, stated in (draft.sections.get("expect") or {}).items():
        if find_metric(metric, groups) is None:
            cure = did_you_mean(metric, metric_names(groups))
            draft.complain(("expect", metric), f"there is no metric '{metric}'", cure)
            continue
        limits = stated if isinstance(stated, list) else [stated]
        for index, limit in enumerate(limits):
            path: PathKeys = ("expect", metric, index) if isinstance(stated, list) else ("expect", metric)
            whole = limit if isinstance(limit, Limit) else Limit(equals=limit)
            _check_limit(draft, metric, whole, groups, path)
            found.append(_expectation(draft, metric, whole, path, links, groups))
    return tuple(found)


def _check_limit(draft: Draft, metric: str, limit: Limit, groups: Collection[str], path: PathKeys) -> None:
    if limit.at_most is None and limit.at_least is None and limit.equals is None:
        draft.complain(path, "expects nothing", "give 'at_most', 'at_least' or 'equals'")
    if limit.at_most is not None and limit.at_least is not None and limit.at_most < limit.at_least:
        draft.complain(
            path, f"nothing is at least {limit.at_least:g} and at most {limit.at_most:g}", "swap them"
        )
    known = find_metric(metric, groups)
    for selector in ("node", "link"):
        if known is not None and getattr(limit, selector) is not None and selector not in known.selectors:
            allowed = " or ".join(f"'{name}'" for name in known.selectors)
            draft.complain(
                (*path, selector), f"{metric} is not a figure of a {selector}", f"select by {allowed}"
            )


def _expectation(
    draft: Draft,
    metric: str,
    limit: Limit,
    path: PathKeys,
    links: Sequence[str],
    groups: Collection[str],
) -> Expectation:
    found = find_metric(metric, groups)
    is_of_senders = found is not None and found.scope == "sender"
    what = "node" if is_of_senders else "estimator"
    names = [*(draft.names("sensors") if is_of_senders else ()), *draft.names("estimators")]
    entry, _ = draft.root.nearest(path)
    return Expectation(
        metric,
        nodes=_chosen(
            draft, limit.node, (*path, "node"), what, names, lambda pattern: select(pattern, names)
        ),
        links=_chosen(
            draft,
            limit.link,
            (*path, "link"),
            "link",
            links,
            lambda pattern: links_of_pattern(pattern, links),
        ),
        at_most=limit.at_most,
        at_least=limit.at_least,
        equals=limit.equals,
        line=entry.origin.line or None,
    )


def _chosen(
    draft: Draft,
    stated: str | list[str] | None,
    path: PathKeys,
    what: str,
    names: Sequence[str],
    choose: Callable[[str], list[str]],
) -> tuple[str, ...]:
    patterns = [stated] if isinstance(stated, str) else stated or []
    chosen: dict[str, None] = {}
    for pattern in patterns:
        found = choose(pattern)
        if not found:
            draft.complain(path, f"there is no {what} '{pattern}'", did_you_mean(pattern, names))
        chosen.update(dict.fromkeys(found))
    return tuple(chosen)
