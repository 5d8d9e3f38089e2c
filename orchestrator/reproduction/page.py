"""The page of a paper: its figures and tables as our campaigns give them, beside what it says."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from orchestrator.campaign.summary import tally
from orchestrator.report.contents import Link, Page, Section, Table, Tile
from orchestrator.reproduction.blocks import blocks_of
from orchestrator.reproduction.claims import Entry
from orchestrator.reproduction.judging import Word
from orchestrator.reproduction.listing import Listed, Listing
from orchestrator.reproduction.measuring import ENOUGH, FEWEST, RANGED, Results

REPORT = "report.html"
INDEX = "index.html"
_SAME = (Word.AGREES, Word.AS_ONE_RUN, Word.HOLDS)
_OTHER = (Word.DIFFERS, Word.FAILS)


def paper_page(listing: Listing) -> Page:
    """Return the page of what is listed; the campaigns must be finished, their reports stand beside it."""
    results = Results({own.name: listing.where / own.name for own in listing.campaigns})
    shown = [entry for entry in listing.entries if not _absent(entry, listing)]
    words: Counter[Word] = Counter()
    used: set[str] = set()
    sections = [Section("campaigns", "Campaigns", [_campaign_table(listing.campaigns, listing.where)])]
    for entry in shown:
        name = _anchor(entry.name, used)
        sections.append(Section(name, entry.name, blocks_of(entry, name, results, words), lead=entry.about))
    absent = [
        (entry.name, entry.about, _absent(entry, listing))
        for entry in listing.entries
        if _absent(entry, listing)
    ]
    if absent:
        table = Table("What no campaign here gives", ("", "what", "why"), absent, frozenset({0, 1, 2}))
        sections.append(Section("absent", "Not here", [table]))
    tallies = [part for own in listing.campaigns for part in tally(listing.where / own.name)]
    failed = sum(part.failed for part in tallies)
    return Page(
        title=listing.title,
        kind="Reproduction",
        word="PARTLY FAILED" if failed else "DONE",
        tone="warn" if failed or _warnings(listing) else "plain",
        headline=_headline(words, len(shown), failed),
        facts="Numbers in brackets are 95 % intervals over trials. Most single runs lie in the range beside "
        "them, from 5 to 95 % of the trials"
        + (": a paper that shows one run shows one of these." if _is_compared(words) else "."),
        tiles=_tiles(listing, words, len(shown), len(absent)),
        sections=sections,
        warnings=_warnings(listing),
    )


def _warnings(listing: Listing) -> list[str]:
    """Return what a page of few trials must not be taken for."""
    fewest = min((len(own.campaign.trials) for own in listing.campaigns), default=ENOUGH)
    if fewest >= ENOUGH:
        return []
    return [
        f"Few trials: a campaign has {fewest}. Below {FEWEST} there are no intervals and no verdicts, "
        f"below {RANGED} no range of single runs, and below {ENOUGH} bands of curves are too narrow. "
        f"Ask for {ENOUGH} or more."
    ]


def _absent(entry: Entry, listing: Listing) -> str:
    """Return why an entry is not shown, or nothing."""
    lacking = [name for name in entry.campaigns if name in listing.left_out]
    return entry.missing or (f"needs {', '.join(lacking)}, left out by --only" if lacking else "")


def _is_compared(words: Counter[Word]) -> bool:
    """Return whether anything of a paper is set beside ours."""
    return any(words[word] for word in (*_SAME, *_OTHER, Word.OPEN))


def _headline(words: Counter[Word], shown: int, failed: int) -> str:
    """Return in a sentence what there is, and how much of the paper holds, where it is set beside."""
    same, other = (sum(words[word] for word in of) for of in (_SAME, _OTHER))
    told = f"{shown} figures, tables and claims regenerated"
    if _is_compared(words):
        told += f". Of what the paper says in numbers or words, {same} {'holds' if same == 1 else 'hold'}"
        told += f" here and {other} {'does' if other == 1 else 'do'} not"
    told += f"; {words[Word.OPEN]} would need more trials" if words[Word.OPEN] else ""
    return told + (f"; {failed} trials came to no score." if failed else ".")


def _tiles(listing: Listing, words: Counter[Word], shown: int, absent: int) -> list[Tile]:
    trials = sum(len(own.campaign.trials) * len(own.campaign.variants) for own in listing.campaigns)
    left_out = f"{len(listing.left_out)} left out" if listing.left_out else ""
    tiles = [
        Tile("Campaigns", f"{len(listing.campaigns)}", left_out),
        Tile("Trials", f"{trials:,}"),
        Tile("Figures and tables", f"{shown}", f"{absent} not here" if absent else ""),
    ]
    if _is_compared(words):
        tiles.append(Tile("As in the paper", f"{sum(words[word] for word in _SAME)}"))
        tiles.append(Tile("Otherwise", f"{sum(words[word] for word in _OTHER)}"))
    return tiles


def _campaign_table(campaigns: Sequence[Listed], where: Path) -> Table:
    rows = []
    for own in campaigns:
        tallies = tally(where / own.name)
        trials, failed, passed = (
            sum(getattr(tally, name) for tally in tallies) for name in ("trials", "failed", "passed")
        )
        rows.append(
            (
                Link(own.name, f"{own.name}/{REPORT}"),
                own.about,
                f"{len(tallies)}",
                f"{trials:,}",
                f"{failed:,}",
                f"{passed:,}",
            )
        )
    columns = ("report", "what", "variants", "trials", "without score", "passed")
    return Table("What was run", columns, rows, frozenset({0, 1}))


def _anchor(name: str, used: set[str]) -> str:
    """Return a name for the page's and the pictures' use, each once."""
    plain = re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-") or "figure"
    anchor = plain
    while anchor in used:
        anchor += "-"
    used.add(anchor)
    return anchor
