"""Impairments: what an indifferent network does to packets."""
