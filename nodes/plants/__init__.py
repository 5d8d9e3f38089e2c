"""Plants: how the true state moves."""
