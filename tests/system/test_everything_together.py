"""Every kind that an adversary or the network has, switched on together: the same bytes everywhere."""

from __future__ import annotations

import re

import pytest

from bus.messages import ChannelEvents
from orchestrator.log.reader import read_log
from orchestrator.registry import ROLES, registered
from tests.system.conftest import Gauntlet

LOOP = """
name: everything
seed: 11
period_s: 0.1
steps: 60
plant:
  model: linear
  A: [[0.92, 0.0, 0.12, 0.0], [0.0, 0.95, 0.0, 0.08], [0.0, 0.0, 0.88, 0.0], [0.0, 0.0, 0.0, 0.91]]
  B: [[0.232, 0.023], [0.012, 0.170], [0.0, 0.364], [0.268, 0.0]]
  G: [[1.0], [0.0], [0.0], [0.0]]
  process_noise: {std: 0.01}
  initial: {std: 0.1}
sensors:
  s1: {model: linear, C: [[0.5, 0.0, 0.0, 0.0]], noise: {std: 0.01}, H: [[0.5]]}
  s2..s5: {model: linear, C: [[0.0, 0.5, 0.0, 0.0]], noise: {std: 0.01}}
  t1..t2: {model: linear, C: [[0.5, 0.0, 0.0, 0.0]], noise: {std: 0.01}}
estimators:
  e1..e5: {method: secure_distributed, coupling: 0.004}
  k1: {method: kalman, sensors: [t1, t2], threshold: 6.63}
graph: {ring: {nodes: 5, neighbours: 4}}
controllers:
  c1:
    law: lqr
    estimator: k1
    state_weight: [1.0, 1.0, 0.0, 0.0]
    input_weight: [1.0, 1.0]
    watermark: {std: 0.1}
adversary: {knows: [topology, model, innovations, keys]}
integrity: {s1: mac, s2: crc}
channel:
  s*->*:
    - {gilbert_elliott: {failure: 0.05, recovery: 0.5}}
    - {delay: {delay: 0.6, jitter: 0.6, distribution: normal, correlation: 0.3}}
    - {duplicate: {probability: 0.1}}
    - {reorder: {probability: 0.1}}
    - {corrupt: {probability: 0.1}}
    - {rate: {rate: 1.5, limit: 4}}
  e*->e*:
    - perfect
    - {bernoulli: {loss: 0.1}}
    - {outage: {windows: [[30, 32]]}}
    - {jammer: {budget: 5, probability: 0.3, scope: shared}}
    - {quantise: {step: 0.001}}
    - {saturate: {low: -50, high: 50}}
attacks:
  - {signal: {value: [0.5]}, on: plant, steps: [20, 25]}
  - {bias: {value: 1}, on: s1, when: {periodic: {every: 9, steps_on: 2}}}
  - {drift: {rate: 0.1}, on: s2, when: {bernoulli: {probability: 0.3}}}
  - {converging_bias: {target: 0.5}, on: s3, when: {markov: {start: 0.2, stop: 0.3}}}
  - {scaling: {low: 0.5, high: 1.5}, on: s4, when: {state_crosses: {component: 0, value: 0.0, hold: 5}}}
  - {noise: {std: 0.1}, on: s5, when: {alarm: {of: e1, hold: 5}}}
  - {constant: {value: 0.2}, on: s2, steps: [10, 12]}
  - {hold: {}, on: s3, steps: [14, 18]}
  - {stale: {age: 2}, on: s4, steps: [20, 24]}
  - {series: {values: [[1], [2]]}, on: s5, steps: [30, 34]}
  - {flip: {}, on: s1, steps: [35, 37]}
  - {substitution: {probability: 0.5, values: {box: {low: [-1], high: 1}}}, on: s2, steps: [40, 50]}
  - {injection: {count: {poisson: 2}, values: {near: {spread: 0.3}}}, on: s3->e3, steps: [20, 50]}
  - {replay: {capture: [5, 15]}, on: s4, steps: [40, 55]}
  - {sybil: {identity: s1, count: 1, values: {box: {low: [-1], high: 1}}}, on: s2->e2, steps: [30, 50]}
  - {babbling: {count: 3}, on: e4, steps: [20, 40]}
  - {byzantine: {spread: 0.3, components: [0, 1, 2, 3]}, on: e5, steps: [20, 50]}
  - {zero_dynamics: {amplitude: 0.001}, on: c1->plant, steps: [30, 59]}
  - {covert: {value: [0.1, 0.0]}, on: [c1->plant, t*->k1], steps: [20, 40]}
  - {worst_case_bias: {budget: 1.0}, on: t*->k1, steps: [45, 59]}
  - {crash: {}, on: e2, steps: [50, 59]}
  - {hang: {}, on: s5, steps: [52, 59]}
"""
SMART = """
name: smart-sensors
seed: 11
period_s: 0.1
steps: 40
plant: {model: linear, A: [[0.95, 0.2], [-0.2, 0.95]], process_noise: {std: 0.1}, initial: {std: 1.0}}
sensors:
  s1: {model: innovation, C: [[1.0, 0.0]], noise: {std: 0.3}}
  s2:
    model: innovation
    C: [[1.0, 0.0]]
    noise: {std: 0.3}
    send: {deterministic_innovation: {threshold: 0.5}}
estimators:
  e1..e2: {method: innovation_kalman, threshold: 6.63}
adversary: {knows: [innovations]}
attacks:
  - {optimal_linear: {T: 0.5}, on: s1->e1, steps: [10, 30]}
"""
TRIGGERED = """
name: event-triggers
seed: 11
period_s: 0.1
steps: 40
plant: {model: linear, A: [[0.95, 0.2], [-0.2, 0.95]], process_noise: {std: 0.1}, initial: {std: 1.0}}
sensors:
  s1: {model: linear, C: [[1.0, 0.0]], noise: {std: 0.3}, send: {stochastic_innovation: {Y: 5}}}
  s2: {model: linear, C: [[1.0, 0.0]], noise: {std: 0.3}, send: {deterministic_innovation: {threshold: 1}}}
  s3: {model: linear, C: [[1.0, 0.0]], noise: {std: 0.3}, send: {send_on_delta: {threshold: 0.5}}}
  s4: {model: linear, C: [[1.0, 0.0]], noise: {std: 0.3}, send: {relative: {sigma: 0.1}}}
estimators:
  k1: {method: event_triggered_kalman, sensors: all}
  e1: {method: secure_distributed, coupling: 0.01, send: {periodic: {every: 2}}}
  e2: {method: secure_distributed, coupling: 0.01, send: {relative: {sigma: 0.05, components: [0, 1]}}}
  e3: {method: secure_distributed, coupling: 0.01, send: {send_on_delta: {threshold: 0.3}}}
  e4: {method: secure_distributed, coupling: 0.01, send: {stochastic_innovation: {Y: 5, loop: open}}}
  q1..q2: {method: kalman_consensus, send: {send_on_delta: {threshold: 0.3}}}
  i1..i2: {method: information_consensus, rounds_per_step: 3, send: {relative: {sigma: 0.01}}}
  d1..d2: {method: diffusion_kalman}
  x1..x2: {method: covariance_intersection}
graph: {edges: [[e1, e2], [e2, e3], [e3, e4], [e4, e1], [q1, q2], [i1, i2], [d1, d2], [x1, x2]]}
channel:
  s4->e4: {bernoulli: {loss: 0.2}}
  "*1->*2": {gilbert_elliott: {failure: 0.2, recovery: 0.5}}
attacks:
  - {bias: {value: 0.5}, on: s3->e3, steps: [10, 20]}
  - {hold: {}, on: s4->e4, steps: [10, 20]}
  - {replay: {capture: [5, 15]}, on: s3->e3, steps: [25, 30]}
  - {crash: {}, on: e4, steps: [30, 39]}
"""
DECEIVED = """
name: deceived-robots
seed: 11
period_s: 1.0
steps: 25
plant: {model: planar_robot, noise_bound: 3.0}
sensors:
  s1: {model: ceiling_camera, position: [0.6, 0.6], noise: {std: 1.0}}
  s2: {model: ceiling_camera, position: [0.6, 1.8], noise: {std: 1.0}}
  s3: {model: ceiling_camera, position: [1.2, 1.8], noise: {std: 1.0}, noise_bound: 1.4}
  s4: {model: ceiling_camera, position: [1.8, 1.8], noise: {std: 1.0}}
estimators:
  e1: {ROBOT, send: {relative: {sigma: 0.1}}, design: {riccati: nominal}}
  e2: {ROBOT, send: {relative: {sigma: 0.1}}, design: {riccati: residual}}
  e3: {ROBOT, send: {send_on_delta: {threshold: 1.0}}}
  e4: {ROBOT, design: {riccati: adversarial}}
  dead: {method: dead_reckoning, sensors: [s1]}
  k1: {method: extended_kalman, sensors: [s1, s2]}
graph: {complete: {nodes: 4}}
channel:
  s*->e*: {bernoulli: {loss: 0.1}}
  e*->e*: {gilbert_elliott: {failure: 0.1, recovery: 0.5}}
attacks:
  - {scaling: {low: 0.1, high: 1.5, value: 5.0}, on: "s*->e*"}
  - {byzantine: {spread: 0.3, components: [0, 1, 2, 3]}, on: e2, steps: [8, 12]}
  - {replay: {capture: [0, 5]}, on: s3->e3, steps: [12, 16]}
  - {crash: {}, on: e4, steps: [18, 24]}
""".replace(
    "ROBOT",
    "method: event_triggered_extended_kalman, initial: {std: [0.35, 0.35, 1.0]}, start_error: {std: 0.1}, "
    "assumed_attack: {low: 0.1, high: 1.5, value: 6.0}",
)


def test_no_registered_kind_is_left_out() -> None:
    """A smart sensor cannot be told of an input, so what needs one stands in a file of its own."""
    named = {"perfect", *re.findall(r"(\w+)(?=: \{)", LOOP + SMART + TRIGGERED)}
    for role in ROLES:
        if role in ("impairments", "attacks", "signals", "faults", "schedules", "triggers"):
            assert set(registered(role)) <= named


@pytest.mark.parametrize(
    "text", [LOOP, SMART, TRIGGERED, DECEIVED], ids=["loop", "smart", "triggered", "deceived"]
)
def test_everything_together_writes_the_same_bytes_in_one_process_and_in_many(
    gauntlet: Gauntlet, text: str
) -> None:
    topology = gauntlet.write(text)
    one = gauntlet.log(topology, "--backend", "inprocess", out="one")
    assert gauntlet.log(topology, out="many") == one


@pytest.mark.parametrize(
    "variant", ["nominal", *(pytest.param(name, marks=pytest.mark.slow) for name in ("moment", "sector"))]
)
def test_gains_by_semidefinite_programs_are_the_same_in_one_process_and_in_many(
    gauntlet: Gauntlet, variant: str
) -> None:
    pytest.importorskip("cvxpy", reason="the extra 'lmi' is not installed")
    text = DECEIVED.partition("attacks:")[0].replace("riccati: nominal", f"lmi: {variant}")
    topology = gauntlet.write(text.replace("steps: 25", "steps: 4"))
    one = gauntlet.log(topology, "--backend", "inprocess", out="one")
    assert gauntlet.log(topology, "--set", "process.stall_s=120", out="many") == one


def test_everything_together_is_accounted_for(gauntlet: Gauntlet) -> None:
    gauntlet.log(gauntlet.write(LOOP), "--backend", "inprocess", out="one")
    balance: dict[str, int] = {}
    actions: set[str] = set()
    for _, message in read_log(gauntlet.home / "one" / "run.mcap").records():
        if not isinstance(message, ChannelEvents):
            continue
        actions.update(message.event_action)
        zeros = [0] * len(message.link)
        rows = zip(
            message.link,
            message.sent,
            message.injected or zeros,
            message.duplicated or zeros,
            message.delivered,
            message.lost,
            message.refused or zeros,
            message.in_flight or zeros,
            strict=True,
        )
        for link, sent, injected, duplicated, delivered, lost, refused, in_flight in rows:
            balance[link] = balance.get(link, 0) + sent + injected + duplicated - delivered - lost - refused
            assert balance[link] == in_flight
    assert actions == {"lost", "attacked", "injected", "duplicated", "altered", "delayed"}
