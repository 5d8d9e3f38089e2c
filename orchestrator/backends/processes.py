"""The backend of many processes: one a node, one for the channel, and this one as router, recorder and supervisor."""

from __future__ import annotations

import contextlib
import queue
import secrets
import time
from collections import Counter
from pathlib import Path

import msgspec

from bus import keys
from bus.grants import grant, paced, process_names
from bus.intake import Intake
from bus.messages import Credit, Finished, decoder, encode
from bus.plan import Plan
from bus.process import Membership, rounds_of_topics
from bus.zenoh_bus import BusError, Router
from orchestrator.backends.contract import Progress, RunFailedError, RunSettings, Timing
from orchestrator.backends.proof import prove_the_rules
from orchestrator.fleet import Fleet, is_stopped
from orchestrator.log.order import wait_chain
from orchestrator.log.recorder import Recorder

_LOOK_EVERY_S = 0.2
_CREDITS_A_WINDOW = (
    4  # steps are granted in bunches: messages that travel together cost less, and wake fewer processes
)
_JOIN_S = 5.0
_LOG_TAIL_LINES = 25


class ProcessRun:
    """One run in many processes; see `run_in_processes`."""

    def __init__(
        self,
        plan: Plan,
        recorder: Recorder,
        settings: RunSettings,
        log_dir: Path,
        progress: Progress,
        timing: Timing,
    ) -> None:
        self._plan = plan
        self._recorder = recorder
        self._settings = settings
        self._log_dir = log_dir
        self._progress = progress
        self._prefix = keys.prefix(secrets.token_hex(4))
        self._run = self._prefix.split("/")[1]
        self._names = process_names(plan)
        self._credits = [self._prefix + keys.credit(name) for name in paced(plan)]
        self._mailbox: queue.SimpleQueue[tuple[str, bytes]] = queue.SimpleQueue()
        self._intake = Intake(rounds_of_topics(plan))
        self._finished: dict[str, Finished] = {}
        self._decode_finished = decoder(Finished).decode
        self._moved = self._looked = time.monotonic()
        self.timing = timing

    def run(self) -> None:
        """Carry the run out; raises `RunFailedError` when it cannot be finished."""
        grants = [grant(self._plan, self._run, name) for name in self._names]
        with Router(grants, stall_s=self._settings.stall_s) as router:
            members = [
                Membership(
                    self._run,
                    router.endpoint,
                    name,
                    router.password(name),
                    self._settings.stall_s,
                    self._settings.window,
                )
                for name in self._names
            ]
            with Fleet(self._plan, members, self._log_dir) as fleet:
                prove_the_rules(router, self._plan, self._run)
                router.subscribe(self._prefix + "**", lambda key, payload: self._mailbox.put((key, payload)))
                fleet.start()
                self._wait_until_alive(router, fleet)
                router.put(self._prefix + keys.START, b"{}")
                self._moved = time.monotonic()
                self._collect(router, fleet)
                router.put(self._prefix + keys.STOP, b"{}")
                fleet.wait_for_all(_JOIN_S)

    def _wait_until_alive(self, router: Router, fleet: Fleet) -> None:
        alive = {self._prefix + keys.alive(name): name for name in self._names}
        deadline = time.monotonic() + self._settings.stall_s
        while missing := router.wait_alive(alive, _LOOK_EVERY_S):
            self._look_after(fleet)
            if time.monotonic() > deadline:
                names = ", ".join(sorted(alive[key] for key in missing))
                raise RunFailedError(f"not on the bus after {self._settings.stall_s:g} s: {names}")

    def _collect(self, router: Router, fleet: Fleet) -> None:
        """Record what comes until all steps are whole and all processes have said their last words."""
        steps = self._plan.steps
        batch = max(1, self._settings.window // _CREDITS_A_WINDOW)
        recorded = credited = 0
        while recorded < steps or len(self._finished) < len(self._names):
            with contextlib.suppress(queue.Empty):
                self._take(*self._mailbox.get(timeout=_LOOK_EVERY_S))
            now = time.monotonic()
            if now - self._looked > _LOOK_EVERY_S:
                self._looked = now
                self._look_after(fleet)
                self._check_for_stall(fleet, now)
            if self._recorder.steps_recorded > recorded:
                recorded = self._recorder.steps_recorded
                self.timing.note_steps(recorded)
                self._progress(recorded)
            if recorded - credited >= batch:
                credited = recorded
                for topic in self._credits:
                    router.put(topic, encode(Credit(steps_recorded=recorded)))

    def _take(self, key: str, payload: bytes) -> None:
        """Record a message, or note a process's last words; anything else is refused and counted."""
        topic = key.removeprefix(self._prefix)
        if topic.startswith("control/"):
            self._take_last_words(topic, payload)
            return
        message = self._intake.admit(topic, payload)
        if message is not None:
            self._moved = time.monotonic()
            self._recorder.store(topic, getattr(message, "round", 0), message.step, payload)

    def _take_last_words(self, topic: str, payload: bytes) -> None:
        name = topic.rpartition("/")[2]
        if topic != keys.finished(name):
            return
        try:
            words = self._decode_finished(payload)
        except msgspec.MsgspecError:
            self._intake.rejected[topic] += 1
            return
        self._moved = time.monotonic()
        self._finished[name] = words
        self.timing.cpu_s[name] = words.cpu_s
        self.timing.peak_memory_bytes[name] = words.peak_memory_bytes
        if words.rejected:
            self.timing.rejected[name] = words.rejected

    def note_refusals(self) -> None:
        """Tell in the timing what the recorder refused: messages that are not the next slot of their topic."""
        refused = self._intake.rejected + Counter(self._recorder.rejected)
        if refused:
            self.timing.rejected["recorder"] = dict(refused)

    def _look_after(self, fleet: Fleet) -> None:
        """Raise `RunFailedError` for the first process that ended before it was done."""
        for name, code in fleet.failed().items():
            if name in self._finished:
                continue
            how = f"was killed by signal {-code}" if code < 0 else "failed"
            at = self._recorder.steps_recorded
            raise RunFailedError(f"{name} {how} while step {at} was under way{self._log_tail(name)}")

    def _check_for_stall(self, fleet: Fleet, now: float) -> None:
        if now - self._moved <= self._settings.stall_s:
            return
        step = self._recorder.steps_recorded
        pids = {name: fleet.pid(name) for name in self._names}
        stopped = [name for name, pid in pids.items() if pid is not None and is_stopped(pid)]
        causes = wait_chain(self._plan, step, self._recorder.missing())
        raise RunFailedError(
            f"nothing came for {self._settings.stall_s:g} s: "
            + "; ".join([*map(str, causes), *(f"{name} is stopped" for name in stopped)])
        )

    def _log_tail(self, name: str) -> str:
        try:
            lines = (self._log_dir / f"{name}.log").read_text(errors="replace").splitlines()
        except OSError:
            return ""
        return "".join(f"\n  {line}" for line in lines[-_LOG_TAIL_LINES:])


def run_in_processes(
    plan: Plan,
    recorder: Recorder,
    settings: RunSettings,
    log_dir: Path,
    progress: Progress,
    timing: Timing,
) -> None:
    """Run a plan as one process a node on the bus, record every message and note the timing.

    ``log_dir`` takes what each process prints. Raises `RunFailedError` when a process fails, dies or hangs, or the bus
    does not refuse what it must; no process is left behind.
    """
    run = ProcessRun(plan, recorder, settings, log_dir, progress, timing)
    try:
        run.run()
    except BusError as error:
        raise RunFailedError(str(error)) from error
    finally:
        run.note_refusals()
