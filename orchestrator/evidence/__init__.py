"""What runs prove: one row an estimator of every trial, and the statistics over such rows."""
