"""Attacks: what an adversary on the link does to packets."""
