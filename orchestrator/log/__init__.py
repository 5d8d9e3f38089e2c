"""The log: the canonical order of a run's messages, their recorder, and the MCAP file that holds them."""
