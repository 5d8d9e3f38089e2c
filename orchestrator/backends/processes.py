"""The backend of many processes: one a node, one for the channel, and this one as router and recorder."""

from __future__ import annotations

import secrets
import signal
import threading
import time
from collections import Counter
from functools import partial
from pathlib import Path

import msgspec

from bus import keys
from bus.grants import grant, paced, process_names
from bus.intake import Intake
from bus.messages import Credit, Finished, decoder, encode
from bus.plan import Plan
from bus.process import Membership, rounds_of_topics
from bus.zenoh.router import Router
from bus.zenoh.session import BusError
from orchestrator.backends.contract import Progress, RunFailedError, RunSettings, Timing
from orchestrator.backends.departures import Departures, dependents
from orchestrator.backends.fleet import Fleet, is_stopped
from orchestrator.backends.proof import prove_the_rules
from orchestrator.log.order import canonical_topics, wait_chain
from orchestrator.log.recorder import Recorder

_LOOK_EVERY_S = 0.2
_CREDITS_A_WINDOW = (
    2  # steps are granted in bunches: messages that travel together cost less, and wake fewer processes
)
_JOIN_S = 5.0
_LOG_TAIL_LINES = 25


class ProcessRun:
    """One run in many processes; see `run_in_processes`.

    The bus's own thread records what comes, message by message; this one only looks after the processes.
    Handing each message from one thread to the other would cost more than recording it.
    """

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
        self._run = secrets.token_hex(4)
        self._prefix = keys.prefix(self._run)
        self._names = process_names(plan)
        self._doomed = {fault.node for fault in plan.faults}
        self._credits = [self._prefix + keys.credit(name) for name in paced(plan)]
        self._credit_batch = max(1, settings.window // _CREDITS_A_WINDOW)
        self._credited = 0
        self._recorded = 0
        self._intake = Intake(rounds_of_topics(plan))
        self._turnstiles = {
            self._prefix + topic: (topic, self._intake.turnstile(topic).admit)
            for topic in canonical_topics(plan)
        }
        self._finished: set[str] = set()
        self._leaving: set[str] = set()
        self._departures = Departures(plan, recorder)
        self._departed_topics: frozenset[str] = frozenset()
        self._decode_finished = decoder(Finished).decode
        self._moved = time.monotonic()
        self._over = threading.Event()
        self._fault: BaseException | None = None
        self.timing = timing

    def run(self) -> None:
        """Carry the run out; raises `RunFailedError` when it cannot be finished."""
        grants = [grant(self._plan, self._run, name) for name in self._names]
        with Router(grants, stall_s=self._settings.stall_s) as router:
            members = [self._membership(router, name) for name in self._names]
            with Fleet(self._plan, members, self._log_dir) as fleet:
                prove_the_rules(router, self._plan, self._run)
                end_recording = router.subscribe(self._prefix + "**", partial(self._record, router))
                try:
                    fleet.start()
                    self._wait_until_alive(router, fleet)
                    router.put(self._prefix + keys.START, b"{}")
                    self._moved = time.monotonic()
                    self._look_after_all(router, fleet)
                    router.put(self._prefix + keys.STOP, b"{}")
                    fleet.wait_for_all(_JOIN_S, without=self._doomed)
                finally:
                    self._over.set()
                    end_recording()

    def _membership(self, router: Router, name: str) -> Membership:
        stall_s, window = self._settings.stall_s, self._settings.window
        return Membership(self._run, router.endpoint, name, router.password(name), stall_s, window)

    def _wait_until_alive(self, router: Router, fleet: Fleet) -> None:
        alive = {self._prefix + keys.alive(name): name for name in self._names}
        deadline = time.monotonic() + self._settings.stall_s
        while missing := router.wait_alive(alive, _LOOK_EVERY_S):
            self._refuse_failures(fleet)
            if time.monotonic() > deadline:
                names = ", ".join(sorted(alive[key] for key in missing))
                raise RunFailedError(f"not on the bus after {self._settings.stall_s:g} s: {names}")

    def _look_after_all(self, router: Router, fleet: Fleet) -> None:
        """Wait until all is recorded and all have said their last words; raise what goes wrong."""
        while not self._over.wait(_LOOK_EVERY_S):
            self._let_the_dead_go(router, fleet)
            self._refuse_failures(fleet)
            self._refuse_a_stall(fleet)
        if self._fault is not None:
            raise self._fault

    def _record(self, router: Router, key: str, payload: bytes) -> None:
        """Record one message, in the bus's thread; what goes wrong is raised in the other one.

        Of a plan's topics everything is looked up beforehand: this stands in the way of every message.
        """
        if self._over.is_set():
            return
        try:
            known = self._turnstiles.get(key)
            if known is None:
                self._take_other(router, key, payload)
                return
            topic, admit = known
            if topic in self._departed_topics:
                return
            message = admit(payload)
            if message is not None:
                recorded = self._recorder.store(topic, getattr(message, "round", 0), message.step, payload)
                if recorded > self._recorded:
                    self._note_progress(router, recorded)
        except BaseException as error:
            self._fault = error
            self._over.set()

    def _take_other(self, router: Router, key: str, payload: bytes) -> None:
        """Note a process's last words, or that it is gone; anything else is refused and counted."""
        topic = key.removeprefix(self._prefix)
        name = topic.rpartition("/")[2]
        if topic == keys.departed(name):
            self._take_leave(router, name)
        elif topic.startswith("control/"):
            self._take_last_words(topic, payload)
        elif (message := self._intake.admit(topic, payload)) is not None:
            self._recorder.store(topic, getattr(message, "round", 0), message.step, payload)

    def _take_leave(self, router: Router, name: str) -> None:
        """Go on without a node of which everything that it sent is recorded."""
        for gone in dependents(self._plan, name):
            self._departures.note(gone)
            self._doomed.add(gone)
        self._departed_topics = self._departures.topics
        if self._recorder.steps_recorded > self._recorded:
            self._note_progress(router, self._recorder.steps_recorded)
        else:
            self._speak_for_the_departed(router)
            self._end_when_done()

    def _speak_for_the_departed(self, router: Router) -> None:
        for topic, slot in self._departures.due(self._recorded + self._settings.window):
            router.put(self._prefix + topic, encode(slot))

    def _note_progress(self, router: Router, recorded: int) -> None:
        self._recorded = recorded
        self._moved = time.monotonic()
        self.timing.note_steps(recorded)
        self._progress(recorded)
        if recorded - self._credited >= self._credit_batch:
            self._credited = recorded
            for topic in self._credits:
                router.put(topic, encode(Credit(steps_recorded=recorded)))
        if self._departed_topics:
            self._speak_for_the_departed(router)
        self._end_when_done()

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
        self._finished.add(name)
        self.timing.cpu_s[name] = words.cpu_s
        self.timing.peak_memory_bytes[name] = words.peak_memory_bytes
        if words.rejected:
            self.timing.rejected[name] = words.rejected
        self._end_when_done()

    def _end_when_done(self) -> None:
        if len(self._finished) + len(self._doomed) == len(self._names) and self._recorder.complete:
            self._over.set()

    def note_own_part(self) -> None:
        """Tell in the timing what this process used up, and refused as not the next slot of its topic."""
        self.timing.note_own_usage("orchestrator")
        refused = self._intake.rejected + Counter(self._recorder.rejected)
        if refused:
            self.timing.rejected["recorder"] = dict(refused)

    def _let_the_dead_go(self, router: Router, fleet: Fleet) -> None:
        """Note the dead that the topology lets the others outlive, once all is in that they ever sent.

        The note goes the way of all messages, so that it is read after the last of theirs.
        """
        for name in fleet.failed():
            if name in self._settings.outlived and name not in self._finished | self._leaving | self._doomed:
                self._leaving.add(name)
                router.wait_gone(self._prefix + keys.alive(name), self._settings.stall_s)
                router.tell_self(self._prefix + keys.departed(name), b"{}")

    def _refuse_failures(self, fleet: Fleet) -> None:
        """Raise `RunFailedError` for the first process that ended before it was done."""
        for name, code in fleet.failed().items():
            if name in self._finished | self._leaving or (name in self._doomed and code == -signal.SIGKILL):
                continue
            how = f"was killed by signal {-code}" if code < 0 else "failed"
            at = self._recorder.steps_recorded
            raise RunFailedError(f"{name} {how} while step {at} was under way{self._log_tail(name)}")

    def _refuse_a_stall(self, fleet: Fleet) -> None:
        """Raise `RunFailedError` when no step became whole for too long, saying who waits for whom."""
        if time.monotonic() - self._moved <= self._settings.stall_s:
            return
        step = self._recorder.steps_recorded
        pids = {name: fleet.pid(name) for name in self._names}
        stopped = [name for name, pid in pids.items() if pid is not None and is_stopped(pid)]
        causes = wait_chain(self._plan, step, self._recorder.missing())
        raise RunFailedError(
            f"no step was completed for {self._settings.stall_s:g} s: "
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

    ``log_dir`` takes what each process prints. Raises `RunFailedError` when a process fails, dies or hangs,
    or the bus does not refuse what it must; no process is left behind.
    """
    run = ProcessRun(plan, recorder, settings, log_dir, progress, timing)
    try:
        run.run()
    except BusError as error:
        raise RunFailedError(str(error)) from error
    finally:
        run.note_own_part()
