"""Sensors: how the true state is measured."""
