"""Campaigns: a grid of variants of one topology, each run in many trials, and all results in one table."""
