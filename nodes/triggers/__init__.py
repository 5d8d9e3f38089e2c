"""Event triggers: they decide at the sender which of its payloads are sent."""
