"""Topology files, launch, record, score, report and the command line."""
