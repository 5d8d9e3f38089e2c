"""The ways to run a plan: many processes on the bus, or all in this one. Both record the same messages."""
