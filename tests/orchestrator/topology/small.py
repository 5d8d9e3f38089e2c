"""A small topology that is all right, for tests to add to and to spoil."""

GOOD = """\
period_s: 0.1
steps: 20
plant:
  model: constant_acceleration
  process_noise: {std: 0.2}
  initial: {std: 1.0}
sensors:
  s1..s4: {model: linear, C: [[1.0, 0.0, 0.0]], noise: {std: 0.1}}
estimators:
  e1..e4: {method: secure_distributed, coupling: 0.01, threshold: 9}
graph: {ring: {nodes: 4}}
channel:
  e*->e*: {bernoulli: {loss: 0.1}}
"""
