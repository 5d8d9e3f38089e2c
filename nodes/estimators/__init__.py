"""Estimators, one file a method."""
