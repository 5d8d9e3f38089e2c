"""A ring of nodes with feedback each step on mosaik 3, one simulator a node.

    python benchmarks/reference/mosaik_ring.py --mode processes --nodes 20 --steps 300
    python benchmarks/reference/mosaik_ring.py --mode inprocess --nodes 20 --steps 300

`processes` starts each simulator with the `cmd` starter, `inprocess` with the `python` starter. What was
chosen so that mosaik runs as fast as it can:

- time-based simulators, and time-shifted connections with initial data: there are no events to look for;
- `AsyncWorld`, so that the simulators' processes start side by side and not one after the other;
- `cache=False`: mosaik then pushes values and prunes no cache each step;
- no progress bar, debug graph or logging; `lazy_stepping=False`, which waits for fewer simulators;
- a simulator's process imports only `mosaik_api_v3` and the ring.
"""

import argparse
import asyncio
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import mosaik_api_v3
from ring import agrees, neighbours, report, update

if TYPE_CHECKING:
    from mosaik.async_scenario import AsyncWorld, Entity

META = {
    "api_version": "3.0",
    "type": "time-based",
    "models": {
        "Node": {"public": True, "params": ["node"], "attrs": ["received", "value", "first_s", "last_s"]},
    },
}
TIMEOUT_S = 60.0


class RingNode(mosaik_api_v3.Simulator):
    """One simulator with one entity: a node of the ring."""

    def __init__(self) -> None:
        super().__init__(META)  # type: ignore[no-untyped-call]
        self.node = 0
        self.outputs: dict[str, float] = {"value": 0.0}

    def create(self, num: int, model: str, **model_params: Any) -> list[Any]:
        """Make the only entity, the node of the given number."""
        self.node = model_params["node"]
        return [{"eid": "node", "type": model}]

    def step(self, time_step: int, inputs: dict[str, Any], max_advance: int) -> int:
        """Average what the neighbours had one step before; note when the first and last step were done."""
        self.outputs["value"] = update(time_step, self.node, inputs["node"]["received"].values())
        self.outputs["last_s"] = time.monotonic()
        self.outputs.setdefault("first_s", self.outputs["last_s"])
        return time_step + 1

    def get_data(self, outputs: dict[str, list[str]]) -> dict[str, dict[str, float]]:
        """Return the attributes that are asked for."""
        return {eid: {name: self.outputs[name] for name in names} for eid, names in outputs.items()}


def start_config(mode: str) -> dict[str, Any]:
    """Return mosaik's description of how a simulator starts."""
    if mode == "inprocess":
        return {"Ring": {"python": f"{__name__}:RingNode"}}
    command = f'"%(python)s" "{Path(__file__).resolve()}" --connect %(addr)s'
    return {"Ring": {"cmd": command, "posix": True}}


async def build(world: "AsyncWorld", nodes: int) -> list["Entity"]:
    """Start the simulators side by side and connect them as a ring, one step delayed."""
    factories = await asyncio.gather(*(world.start("Ring") for _ in range(nodes)))
    entities = await asyncio.gather(*(factory.Node(node=i) for i, factory in enumerate(factories)))
    for i, entity in enumerate(entities):
        for j in neighbours(i, nodes):
            world.connect(
                entities[j], entity, ("value", "received"), time_shifted=True, initial_data={"value": 0.0}
            )
    return list(entities)


async def simulate(mode: str, nodes: int, steps: int, since_s: float) -> str:
    """Run the ring once and return its JSON line."""
    from mosaik.async_scenario import AsyncWorld, MosaikConfig

    config: MosaikConfig = {
        "addr": ("127.0.0.1", None),
        "start_timeout": TIMEOUT_S,
        "stop_timeout": TIMEOUT_S,
    }
    async with AsyncWorld(start_config(mode), config, cache=False) as world:
        entities = await build(world, nodes)
        started_s = time.monotonic()
        await world.run(until=steps, print_progress=False, lazy_stepping=False)
        found = await world.get_data(entities, "value", "first_s", "last_s")
        results = [found[entity] for entity in entities]
    return report(
        f"mosaik {mode}",
        nodes,
        steps,
        start_up_s=max(result["first_s"] for result in results) - since_s,
        run_s=max(result["last_s"] for result in results) - started_s,
        checked=agrees((result["value"] for result in results), steps),
    )


def main() -> None:
    """Run the ring, or one simulator of it when mosaik calls with `--connect`."""
    entered_s = time.monotonic()
    parser = argparse.ArgumentParser(description="A ring with feedback each step on mosaik.")
    parser.add_argument("--mode", choices=["processes", "inprocess"], default="processes")
    parser.add_argument("--nodes", type=int, default=20)
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument("--timeout", type=float, default=300.0, help="seconds after which to give up")
    parser.add_argument(
        "--since", type=float, help="monotonic time from which the start-up counts; default: now"
    )
    parser.add_argument("--connect", metavar="HOST:PORT", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.connect:
        host, port = options.connect.split(":")
        asyncio.run(mosaik_api_v3.run_as_client(RingNode(), host, int(port)))
        return
    since_s = entered_s if options.since is None else options.since
    run = simulate(options.mode, options.nodes, options.steps, since_s)
    sys.stdout.write(asyncio.run(asyncio.wait_for(run, options.timeout)) + "\n")


if __name__ == "__main__":
    main()
