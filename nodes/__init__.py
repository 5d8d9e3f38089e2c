"""Plants, sensors and estimators: pure mathematics, and the programs that run them as nodes."""
