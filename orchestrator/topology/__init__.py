"""Topology files: read, validated, resolved to plans. Start at `orchestrator.topology.load`."""
