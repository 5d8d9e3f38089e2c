"""Results for other tools: `load` gives a run or a campaign as frames and labelled arrays."""

from orchestrator.handoff.loading import load

__all__ = ["load"]
