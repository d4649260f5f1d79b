# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A ROS of one's own, for tests and timings: a master on the loopback with a private port, nodes,
bags, and a listener."""

import os
import pickle
import signal
import socket
import subprocess
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Collection
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

ROOT = Path(__file__).parents[2]
REPORTS = "/diagnostics"
"""Where nodes count what they do."""
# Limits of what hangs, not of what is slow: machines are busy.
PATIENCE_S = 300.0
_SETTLING_S = 900.0
_PLAYING_S = 1800.0
_PORTS = 5
_CORE_IS_THERE = "started core service"
_STEP_S = 0.1
_CONNECTED_S = "2"  # ten times rosbag's own


def _free_port() -> int:
    with socket.socket() as any_one:
        any_one.bind(("127.0.0.1", 0))
        return int(any_one.getsockname()[1])


class RosWorld:
    """Started by ``with``; everything that it started ends with it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.environment = {
            **os.environ,
            "ROS_IP": "127.0.0.1",
            "ROS_HOME": str(folder / "ros"),
            "ROS_LOG_DIR": str(folder / "ros" / "log"),
            "OPENBLAS_NUM_THREADS": "1",
            "PYTHONUNBUFFERED": "1",
        }
        self.environment.pop("ROS_HOSTNAME", None)
        self.processes: list[subprocess.Popen[Any]] = []
        self.nodes: dict[str, subprocess.Popen[Any]] = {}

    def __enter__(self) -> "RosWorld":
        self.core = self._first_core()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for process in reversed(self.processes):
            self.end(process)
        for name in self.nodes:
            if error is not None:
                error.add_note(f"{name} said:\n{self.log(name)}")

    def start_core(self) -> "subprocess.Popen[Any]":
        """The master, on the port of this world, which may have had another one before."""
        core = self._core()
        assert core.poll() is None, self.log("roscore")
        return core

    def _first_core(self) -> "subprocess.Popen[Any]":
        """On another port if someone else took it since it was free."""
        for _ in range(_PORTS):
            self.port = _free_port()
            self.environment["ROS_MASTER_URI"] = f"http://127.0.0.1:{self.port}"
            core = self._core()
            if core.poll() is None:
                return core
        raise AssertionError(self.log("roscore"))

    def _core(self) -> "subprocess.Popen[Any]":
        """A master that is there, or has ended."""
        before = self.log("roscore").count(_CORE_IS_THERE)
        core = self.run("roscore", ["roscore", "-p", str(self.port)])
        # Not by whether the port answers: another world's master may be what does.
        wait_until(
            lambda: self.log("roscore").count(_CORE_IS_THERE) > before or core.poll() is not None,
            "roscore",
        )
        return core

    def run(self, name: str, command: list[str], **more: Any) -> "subprocess.Popen[Any]":
        """A process in this world, whose output goes into the file ``name.log``."""
        with (self.folder / f"{name}.log").open("a") as log:
            process = subprocess.Popen(
                command,
                env=self.environment,
                cwd=self.folder,
                stderr=log,
                **{"stdout": log, **more},
                start_new_session=True,
            )
        self.processes.append(process)
        return process

    def node(self, name: str, *arguments: str, ready: bool = True) -> "subprocess.Popen[Any]":
        """One of our nodes, as the interpreter of these tests runs it."""
        script = ROOT / "ros" / "nodes" / name
        return self.start_node(name, [sys.executable, str(script), *arguments], ready=ready)

    def start_node(
        self, name: str, command: list[str], *, ready: bool = True
    ) -> "subprocess.Popen[Any]":
        """One of our nodes by its command; ready is one that says so."""
        before = self.log(name).count("is ready")
        process = self.nodes[name] = self.run(name, command)
        if ready:
            wait_until(
                lambda: self.log(name).count("is ready") > before or process.poll() is not None,
                f"{name} to be ready",
            )
            assert process.poll() is None, self.log(name)
        return process

    def log(self, name: str) -> str:
        """What a process said so far."""
        path = self.folder / f"{name}.log"
        return path.read_text() if path.exists() else ""

    def listen(self, *topics: str) -> "Listener":
        """Keep all messages of these topics from now on."""
        return Listener(self, topics)

    def play(self, bag: Path, *options: str) -> None:
        """Play a bag to its end, once the lines to those who listen already may be there."""
        player = self.start_player(bag, *options)
        assert player.wait(timeout=_PLAYING_S) == 0, self.log("rosbag")

    def start_player(self, bag: Path, *options: str) -> "subprocess.Popen[Any]":
        """Begin to play a bag, as ``play``."""
        command = ["rosbag", "play", "--quiet", "--delay", _CONNECTED_S, *options, str(bag)]
        return self.run("rosbag", command)

    def end(self, process: "subprocess.Popen[Any]", how: int = signal.SIGINT) -> int:
        """End a process as Ctrl-C does, or as told; returns its exit code."""
        if process.poll() is None:
            process.send_signal(how)
        try:
            return process.wait(timeout=PATIENCE_S)
        except subprocess.TimeoutExpired:
            process.kill()
            return process.wait()


class Heard(NamedTuple):
    """A message, and when it arrived, by a clock that only rises."""

    topic: str
    type_name: str
    message: Any
    seconds: float


class Listener:
    """Keeps all messages of some topics, and what nodes report meanwhile."""

    command = (sys.executable, str(Path(__file__).with_name("listener.py")))

    @staticmethod
    def read(type_name: str, content: bytes) -> Any:
        """Deserialise a message."""
        from fusionslam.ros.messages.library import message_class

        message = message_class(type_name)()
        message.deserialize(content)
        return message

    def __init__(self, world: RosWorld, topics: tuple[str, ...]) -> None:
        self._world, self._topics = world, topics
        self._process = world.run(
            "listener",
            [*self.command, *{*topics, REPORTS}],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._answer() == "ready", world.log("listener")

    def count(self) -> int:
        """Number of messages so far, without reports."""
        return int(self._ask("count"))

    def settle(self, silence_s: float = 3.0) -> None:
        """Wait until nothing has come for a while and no node counts on: all is worked off.

        Nodes are those that this world started and that run; each has to report twice.
        """
        end = time.monotonic() + _SETTLING_S
        count, since = self.count(), time.monotonic()
        while time.monotonic() - since < silence_s or self._changes(since):
            assert time.monotonic() < end, self._unrest(silence_s)
            time.sleep(_STEP_S)
            now = self.count()
            if now != count:
                count, since = now, time.monotonic()

    def _changes(self, since: float) -> dict[str, str]:
        """What nodes at work counted between their last two reports since then."""
        counts: dict[str, list[dict[str, str]]] = defaultdict(list)
        for each in self._kept([REPORTS]):
            if each.seconds > since:
                (status,) = each.message.status
                values = {value.key: value.value for value in status.values}
                values.pop("processor time [s]")  # passes even without work
                counts[status.hardware_id].append(values)
        running = [name for name, process in self._world.nodes.items() if process.poll() is None]
        found = {name: _difference(counts[f"/{name}"][-2:]) for name in running}
        return {name: text for name, text in found.items() if text}

    def _unrest(self, span_s: float) -> str:
        """What has not settled: topics on which messages came last, and what nodes count."""
        since = time.monotonic() - span_s
        came = Counter(each.topic for each in self.heard() if each.seconds > since)
        changes = self._changes(since)
        return f"not idle after {_SETTLING_S:g} s: came lately {dict(came)}, nodes: {changes}"

    def heard(self) -> list[Heard]:
        """All messages in the order in which they came."""
        return self._kept(self._topics)

    def _kept(self, topics: Collection[str]) -> list[Heard]:
        path = self._world.folder / "kept.pickle"
        self._ask(f"keep {path}")
        found = []
        for topic, type_name, content, seconds in pickle.loads(path.read_bytes()):
            if topic in topics:
                found.append(Heard(topic, type_name, self.read(type_name, content), seconds))
        return found

    def messages(self) -> dict[str, list[Any]]:
        """The same by topic."""
        found: dict[str, list[Any]] = defaultdict(list)
        for each in self.heard():
            found[each.topic].append(each.message)
        return found

    def _ask(self, line: str) -> str:
        to = self._process.stdin
        assert to is not None  # a pipe was asked for
        to.write(f"{line}\n")
        to.flush()
        return self._answer()

    def _answer(self) -> str:
        answers = self._process.stdout
        assert answers is not None  # a pipe was asked for
        return str(answers.readline()).strip()


def _difference(reports: list[dict[str, str]]) -> str:
    """What two reports count differently; empty if nothing."""
    if len(reports) < 2:
        return f"{len(reports)} of 2 reports came"
    before, after = reports
    keys = [key for key in before | after if before.get(key) != after.get(key)]
    return ", ".join(f"{key}: {before.get(key)} to {after.get(key)}" for key in keys)


def wait_until(condition: Any, what: str) -> None:
    """Wait for something that has to happen; the test fails if it does not."""
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end, f"waited in vain for {what}"
        time.sleep(_STEP_S)
