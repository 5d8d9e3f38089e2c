"""The score: what a record says about the estimators, the detectors and the network that they met."""
