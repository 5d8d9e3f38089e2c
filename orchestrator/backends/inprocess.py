"""The backend of one process: no bus and no other process, for Monte Carlo, debugging and profiling."""

from __future__ import annotations

from threadpoolctl import threadpool_limits

from bus.grants import inputs, paced
from bus.inprocess import Carrier, CarryingBus, InProcessBus, Sink
from bus.messages import Message, encode
from bus.plan import Plan
from channel.program import channel_programs
from nodes.build import node_program
from orchestrator.backends.contract import Progress, RunSettings, Timing
from orchestrator.interrupts import UNINTERRUPTED
from orchestrator.log.recorder import Recorder


def run_messages(plan: Plan, sink: Sink, window: int = RunSettings.window) -> None:
    """Run a plan in this process and hand every message to the sink; raises `bus.program.NodeError`.

    The order of the messages is that of the computation: deterministic, but not the log's.
    """
    with threadpool_limits(limits=1, user_api="blas"):
        _run(plan, InProcessBus(sink, paced(plan)), window)


def run_carried(plan: Plan, sink: Sink, carrier: Carrier, window: int = RunSettings.window) -> None:
    """Run as `run_messages` does, but without making messages of forms; BLAS must have one thread."""
    _run(plan, CarryingBus(sink, carrier, paced(plan)), window)


def _run(plan: Plan, bus: InProcessBus, window: int) -> None:
    for program, topics in channel_programs(bus, plan):
        bus.add(program, topics)
    for name in plan.node_names:
        bus.add(node_program(bus, plan, name, window), inputs(plan, name))
    bus.run()


def run_in_one_process(
    plan: Plan, recorder: Recorder, settings: RunSettings, progress: Progress, timing: Timing
) -> None:
    """Run a plan in this process, record every message and note the timing.

    Raises `bus.program.NodeError` when a node's code raises.
    """
    recorded = 0

    def store(topic: str, message: Message) -> None:
        nonlocal recorded
        with UNINTERRUPTED:
            now_recorded = recorder.store(topic, getattr(message, "round", 0), message.step, encode(message))
        if now_recorded > recorded:
            recorded = now_recorded
            timing.note_steps(recorded)
            progress(recorded)

    run_messages(plan, store, settings.window)
    timing.note_own_usage("orchestrator")
