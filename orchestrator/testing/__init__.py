"""Topologies as tests: every expectation of many files, and assertions over many seeds in pytest."""
