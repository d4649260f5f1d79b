# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Corrections of a map by hand: loops put in or taken out, keyframes held where a survey has them.

Each is a transaction with who, when and why, and the last one can be taken back.
"""

import base64
import getpass
import os
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from operator import index
from typing import Any, Protocol, get_args

import numpy as np

from fusionslam.base.arrays import Floats
from fusionslam.errors import ConfigError, DataError
from fusionslam.geometry.se3 import carry_covariance, inverse
from fusionslam.loop_closure.detector import LoopDetector
from fusionslam.loop_closure.verification import PairComparisons, verify_candidates
from fusionslam.mapping.edge import Edge, Kind, State, check_pose, measurement_errors, weigh_errors
from fusionslam.mapping.map_content import MapContent
from fusionslam.mapping.map_file import ORIGINS, MapFile
from fusionslam.mapping.map_settings import MapSettings
from fusionslam.registration.result import Refusal

_NAME = "correction"
"""Of the settings that hold them, followed by their numbers."""
_ACTIONS = ("link", "unlink", "fix", "undo")
_LONGEST_WHY = 500
_MOST_TIGHTENED = 10


@dataclass(frozen=True)
class Correction:
    """What a person changed.

    Attributes:
        number: from 1, in the order in which they were made.
        action: "link", "unlink", "fix" (of ``b``, from ``a``, where its part begins) or "undo".
        a, b: numbers of the keyframes.
        who: name of the user at the operating system.
        when: time in UTC, ISO 8601.
        why: in the user's words; may be empty.
        result: the reason of the edge, as of ``Edge``: what counts, or what was overruled.
        undone: number of the correction that an "undo" takes back; None for others.
    """

    number: int
    action: str
    a: int
    b: int
    who: str
    when: str
    why: str
    result: str
    undone: int | None = None

    def __str__(self) -> str:
        what = f"{self.action} {self.a} {self.b}"
        if self.undone is not None:
            what = f"undo of {self.undone}"
        words = [f"{self.number}: {what}, {self.who}, {self.when}", self.result, self.why]
        return "; ".join(word for word in words if word)


class CorrectedMap(Protocol):
    """What corrections ask of a ``PlaceMap``."""

    detector: LoopDetector
    file: MapFile

    @property
    def settings(self) -> MapSettings: ...

    def reload(self) -> None: ...


class Corrections:
    """What people changed of a map, in order; and how to change it.

    What a person decided stays, whatever comes later: drives, merges, solutions. It goes with the
    keyframes of a session that is forgotten. What was added while the map was open begins a drive
    anew, as if the map had been opened again.

    Each change raises ConfigError for a map that was opened read-only (code "read-only") or a
    reason that is not printable or longer than 500 characters ("why"), and DataError for a keyframe
    that is not there ("unknown-keyframe"), two that are the same ("same-keyframe"), or a file that
    cannot be written; nothing has changed then.

    Args:
        site: the map.
        lock: that lets one thread at a time into the map.
    """

    def __init__(self, site: CorrectedMap, lock: AbstractContextManager[Any]) -> None:
        self._site, self._lock = site, lock

    def __iter__(self) -> Iterator[Correction]:
        with self._lock:
            return iter(read_corrections(self._site.file))

    def link(
        self,
        a: int,
        b: int,
        pose: Any = None,
        *,
        metres: float = 0.1,
        degrees: float = 1.0,
        force: bool = False,
        why: str = "",
    ) -> Edge:
        """Put in a loop between two keyframes.

        Without a pose their clouds are registered, and judged as those of all loops are. A loop
        within a part of the map has to fit the graph, too. One between two parts joins them.

        Args:
            a, b: numbers of the keyframes.
            pose: float64 (4, 4), pose of the robot at b in its frame at a; None: by registration.
            metres, degrees: standard deviations of a pose that is given, or that is forced though
                its registration was refused.
            force: whether it counts even if clouds or graph contradict it.
            why: the reason, in words.

        Returns:
            The loop. If its state is "refused", nothing has changed, and its reason says by which
            number.

        Raises:
            ShapeError, DataError, ConfigError: see the class; a pose that is no rigid motion (codes
                "not-finite", "not-a-rotation"), a loop that is believed already
                ("already-linked"), clouds of which registration has no pose to judge ("no-pose"),
                or deviations that are not above 0 ("out-of-range").
        """
        with self._lock:
            content, a, b = self._begin(why, a, b), int(a), int(b)
            if any(each.state == "believed" for each in _between(content, a, b)):
                raise DataError(
                    f"a loop between keyframes {a} and {b} is believed already: unlink it first",
                    code="already-linked",
                    fields=(str(a), str(b)),
                )
            spread = _deviations(metres, degrees)
            one, other = (content.keyframes[content.row[number]] for number in (a, b))
            kind: Kind = "loop" if one.session == other.session else "merge"
            if pose is None:
                edge, doubt = self._register(content, a, b, kind, spread)
            else:
                mount = other.robot_from_cloud
                moved = inverse(one.robot_from_cloud) @ check_pose("pose", pose) @ mount
                spread = carry_covariance(inverse(mount), spread)
                given = Refusal("given", 0, "its pose was given by hand")
                edge = Edge(content.next_edge, kind, a, b, moved, spread, "believed", given)
                doubt = None
            return self._take("link", content, edge, doubt, force, why)

    def unlink(self, a: int, b: int, *, why: str = "") -> tuple[Edge, ...]:
        """Take out what loops there are between two keyframes, for good.

        A pose that ``fix`` holds is one, between the keyframe and the first of its part.

        Returns:
            The loops that count no more.

        Raises:
            DataError, ConfigError: see the class; there is no such loop, or it was taken out before
                (code "no-loop").
        """
        with self._lock:
            content, a, b = self._begin(why, a, b), int(a), int(b)
            reason = Refusal("unlinked", 0, "taken out by hand")
            gone = {
                each.number: replace(each, state="refused", reason=reason)
                for each in _between(content, a, b)
                if each.reason != reason
            }
            if not gone:
                raise DataError(
                    f"there is no loop between keyframes {a} and {b} that could be taken out",
                    code="no-loop",
                    fields=(str(a), str(b)),
                )
            self._write("unlink", a, b, gone, str(reason), why)
            return tuple(gone.values())

    def fix(
        self,
        keyframe: int,
        pose: Any,
        *,
        metres: float = 0.1,
        degrees: float = 1.0,
        force: bool = False,
        why: str = "",
    ) -> Edge:
        """Hold a keyframe where a survey has it, in the frame of its part of the map.

        The edge weighs so much that the keyframe ends within the deviations of the pose.

        Args:
            keyframe: its number.
            pose: float64 (4, 4), map_from_robot.
            metres, degrees: how far off the pose may be; by these as standard deviations the graph
                is asked whether it contradicts.
            force: whether it counts even if the graph contradicts it.
            why: the reason, in words.

        Returns:
            An edge from the first keyframe of the part, which stays where it is; as of ``link``.

        Raises:
            ShapeError, DataError, ConfigError: as of ``link``; the part begins at this keyframe,
                whose pose is its origin (code "origin").
        """
        with self._lock:
            content, keyframe = self._begin(why, keyframe), int(keyframe)
            first = content.part(keyframe)
            if first == keyframe:
                raise DataError(
                    f"keyframe {keyframe} is the origin of its part of the map: expected another "
                    "one, by its pose in the frame of the first",
                    code="origin",
                    fields=("keyframe", str(keyframe)),
                )
            if any(
                each.is_by_hand and each.state == "believed"
                for each in _between(content, first, keyframe)
            ):
                raise DataError(
                    f"keyframe {keyframe} is held already: take that out first, by unlink "
                    f"{first} {keyframe}",
                    code="already-linked",
                    fields=(str(first), str(keyframe)),
                )
            one, other = (content.keyframes[content.row[number]] for number in (first, keyframe))
            mount = other.robot_from_cloud
            moved = inverse(content.pose(first)) @ check_pose("pose", pose) @ mount
            spread = carry_covariance(inverse(mount), _deviations(metres, degrees))
            kind: Kind = "loop" if one.session == other.session else "merge"
            reason = Refusal("fixed", 0, "its pose is held by hand")
            ends = first, keyframe
            edge = Edge(content.next_edge, kind, *ends, moved, spread, "believed", reason)
            return self._take("fix", content, edge, None, force, why)

    def undo(self, *, why: str = "") -> Correction:
        """Take back the last correction that counts; return it.

        If no keyframes and no fixes of satellites came or went since, the file has the solution
        that it had before, to the bit. Else the graph is solved anew without the correction.

        Raises:
            DataError, ConfigError: see the class; there is none (code "no-correction").
        """
        with self._lock:
            self._begin(why)
            file = self._site.file
            known = read_corrections(file)
            gone = {each.undone for each in known} | {e.number for e in known if e.action == "undo"}
            last = next((each for each in reversed(known) if each.number not in gone), None)
            if last is None:
                raise DataError(
                    f"{file.path} has no correction by hand that could be taken back",
                    code="no-correction",
                    fields=(str(file.path),),
                )
            record = file.numbered_settings(_NAME)[last.number]
            before = record.pop("before", None)
            with file.decoding():
                is_same = before is not None and all(
                    before[name] == count for name, count in _counts(file).items()
                )
            edges = {edge.number: edge for edge in file.edges()}
            with file.transaction():
                with file.decoding():
                    for number, *stored in before["edges"] if is_same else record["edges"]:
                        if stored[0] is None:
                            del edges[number]
                            file.delete_edge(number)
                        else:
                            edges[number] = _with_state(edges[number], stored)
                            file.store_edge(edges[number])
                    if is_same:
                        file.restore_solution(_unpack(before["solution"]))
                        for name in (ORIGINS, "reason"):
                            file.store_setting(name, before[name])
                if not is_same:
                    self._solved(edges).save(file)
                file.store_setting(f"{_NAME} {last.number}", record)
                values = {"edges": [], "undone": last.number}
                _store(file, known, "undo", last.a, last.b, "", why, values)
            self._site.reload()
            return last

    def _begin(self, why: str, *numbers: int) -> MapContent:
        """Check what all corrections are given; return what the file contains."""
        file = self._site.file
        file.check_writable()
        if not isinstance(why, str) or (why and not why.isprintable()) or len(why) > _LONGEST_WHY:
            raise ConfigError(
                f"why is {why!r:.50}: expected printable characters, {_LONGEST_WHY} at most",
                code="why",
                fields=("why",),
            )
        content = self._content({edge.number: edge for edge in file.edges()})
        for number in numbers:
            if not isinstance(number, int | np.integer) or number not in content.row:
                raise DataError(
                    f"there is no keyframe {number!r:.50} in {file.path}: expected the number of "
                    f"one of {len(content)}",
                    code="unknown-keyframe",
                    fields=(f"{number!r:.50}",),
                )
        if len(set(numbers)) < len(numbers):
            raise DataError(
                f"both keyframes are {numbers[0]}: expected two",
                code="same-keyframe",
                fields=(str(numbers[0]),),
            )
        return content

    def _content(self, edges: dict[int, Edge]) -> MapContent:
        file = self._site.file
        placed = file.positions(), file.origins(), file.reason()
        return MapContent(
            file.sessions(), file.keyframes(), edges.values(), file.solution(), *placed
        )

    def _solved(self, edges: dict[int, Edge]) -> MapContent:
        content = self._content(edges)
        content.solve()
        return content

    def _register(
        self, content: MapContent, a: int, b: int, kind: Kind, spread: Floats
    ) -> tuple[Edge, Refusal | None]:
        """Compare the clouds of two keyframes as those of a loop, and say what is wrong with it."""
        stored = self._site.detector.stored_frame
        pairs = PairComparisons(stored(b).unpack(), stored)
        loop, rejected = verify_candidates(b, {a: 0.0}, pairs, self._site.settings.loops)
        if loop is None or loop.match_from_query is None:
            why = Refusal(*rejected[0][1:]) if loop is None else loop.reason
            raise DataError(
                f"registration of keyframes {a} and {b} has no pose ({why}): give one",
                code="no-pose",
                fields=(str(a), str(b)),
            )
        chance = loop.probability or 0.0
        mark = Refusal("linked", chance, f"linked by hand, with a probability of {chance:.2f}")
        spread = spread if loop.covariance is None else loop.covariance
        ends, pose = (a, b), loop.match_from_query
        return Edge(content.next_edge, kind, *ends, pose, spread, "believed", mark), loop.reason

    def _take(
        self,
        action: str,
        content: MapContent,
        edge: Edge,
        doubt: Refusal | None,
        force: bool,
        why: str,
    ) -> Edge:
        """Store an edge unless the clouds contradict it, or a graph in which it is like others."""
        edges = content.edges
        if doubt is None and content.part(edge.a) == content.part(edge.b):
            trial = replace(edge, state="pending", reason=None)
            doubt = self._solved(edges | {edge.number: trial}).edges[edge.number].reason
        if doubt is not None:
            if not force:
                return replace(edge, state="refused", reason=doubt)
            text = f"forced by hand: {doubt}"
            edge = replace(edge, reason=Refusal("forced", doubt.number, text))
        if action == "fix":
            edge = self._hold(edges, edge)
        self._write(action, edge.a, edge.b, {edge.number: edge}, str(edge.reason), why)
        return edge

    def _hold(self, edges: dict[int, Edge], edge: Edge) -> Edge:
        """Let an edge weigh so much that its keyframe ends within the deviations it has now."""
        stated = [edge]
        for _ in range(_MOST_TIGHTENED):
            ends = self._solved(edges | {edge.number: edge}).poses_of((edge.a, edge.b))
            if weigh_errors(measurement_errors(ends[None], stated), stated)[0] <= 1:
                break
            edge = replace(edge, covariance=edge.covariance / 4)
        return edge

    def _write(
        self, action: str, a: int, b: int, changed: dict[int, Edge], result: str, why: str
    ) -> None:
        file = self._site.file
        before = {edge.number: edge for edge in file.edges()}
        content = self._solved(before | changed)
        touched = sorted(content.unsaved.keys() | changed.keys())
        values = {
            "edges": [_state_of(number, before.get(number)) for number in changed],
            "before": _counts(file)
            | {
                "origins": file.setting(ORIGINS),
                "reason": file.setting("reason"),
                "edges": [_state_of(number, before.get(number)) for number in touched],
                "solution": _pack(file.solution_row()),
            },
        }
        with file.transaction():
            for edge in changed.values():
                file.store_edge(edge)
            content.save(file)
            _store(file, read_corrections(file), action, a, b, result, why, values)
        self._site.reload()


def read_corrections(file: MapFile) -> list[Correction]:
    """Return the corrections that a map's file has, in their order."""
    records = file.numbered_settings(_NAME)
    with file.decoding():
        return [_decode(number, record) for number, record in records.items()]


def forget_corrections(file: MapFile, keyframes: set[int]) -> None:
    """Delete corrections of keyframes that are deleted, within a transaction.

    Former solutions are of these keyframes, too, so that the others are undone by a new one.
    """
    with file.decoding():
        for number, record in file.numbered_settings(_NAME).items():
            if {record["a"], record["b"]} & keyframes:
                file.delete_setting(f"{_NAME} {number}")
            elif record.pop("before", None) is not None:
                file.store_setting(f"{_NAME} {number}", record)


def copy_corrections(
    file: MapFile, other: MapFile, keyframes: Mapping[int, int], edges: Mapping[int, int]
) -> None:
    """Append the corrections of another map, within a transaction.

    Args:
        file: that gets them.
        other: whose they are.
        keyframes, edges: new numbers by former ones.
    """
    first = max(file.numbered_settings(_NAME), default=0)
    with other.decoding():
        for number, record in other.numbered_settings(_NAME).items():
            _decode(number, record)  # raises for what is none
            record.pop("before", None)
            record["a"], record["b"] = keyframes[record["a"]], keyframes[record["b"]]
            # An edge that was put in and undone is gone.
            record["edges"] = [[edges[e[0]], *e[1:]] for e in record["edges"] if e[0] in edges]
            if record["undone"] is not None:
                record["undone"] += first
            file.store_setting(f"{_NAME} {first + number}", record)


def _between(content: MapContent, a: int, b: int) -> list[Edge]:
    return [
        each
        for each in content.edges.values()
        if each.kind != "odometry" and {each.a, each.b} == {a, b}
    ]


def _deviations(metres: float, degrees: float) -> Floats:
    """Covariance (6, 6) of a pose by its standard deviations."""
    for name, value in (("metres", metres), ("degrees", degrees)):
        if not 0 < value < np.inf:
            raise ConfigError(
                f"{name} is {value}: expected a standard deviation above 0",
                code="out-of-range",
                fields=(name, str(value)),
            )
    return np.diag([metres] * 3 + [np.radians(degrees)] * 3) ** 2


def _user() -> str:
    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError):  # a container's user without a name
        return str(os.getuid())


def _store(
    file: MapFile,
    known: Sequence[Correction],
    action: str,
    a: int,
    b: int,
    result: str,
    why: str,
    values: dict[str, Any],
) -> None:
    """Write the next correction, within a transaction."""
    number = known[-1].number + 1 if known else 1
    when = datetime.now(UTC).isoformat(timespec="seconds")
    record = {"action": action, "a": a, "b": b, "who": _user(), "when": when, "why": why}
    file.store_setting(f"{_NAME} {number}", record | {"result": result, "undone": None} | values)


def _decode(number: int, record: Mapping[str, Any]) -> Correction:
    who, when, why, result = texts = [record[key] for key in ("who", "when", "why", "result")]
    if record["action"] not in _ACTIONS or not all(
        isinstance(text, str) and (text.isprintable() or not text) for text in texts
    ):
        raise ValueError(f"{_NAME} {number} is none")
    ends, undone = (index(record["a"]), index(record["b"])), record["undone"]
    undone = None if undone is None else index(undone)
    return Correction(number, record["action"], *ends, who, when, why, result, undone)


def _state_of(number: int, edge: Edge | None) -> list[Any]:
    """Number, state, and code, number and text of the reason; None for an edge that was not."""
    if edge is None:
        return [number, None, None, None, None]
    reason = edge.reason
    parts = [None] * 3 if reason is None else [reason.code, float(reason.number), reason.text]
    return [number, edge.state, *parts]


def _with_state(edge: Edge, stored: Sequence[Any]) -> Edge:
    state, code, value, text = stored
    if state not in get_args(State):
        raise ValueError(f"the former state of edge {edge.number} is {state!r}")
    reason = None if code is None else Refusal(str(code), float(value), str(text))
    return replace(edge, state=state, reason=reason)


def _counts(file: MapFile) -> dict[str, int]:
    """Of what a former solution depends on, beside edges."""
    return {"keyframes": len(file.keyframes()), "fixes": len(file.positions())}


def _pack(row: tuple[Any, ...] | None) -> list[str] | None:
    """The blobs of a solution's row, as text."""
    if row is None:
        return None
    return [base64.b64encode(zlib.compress(blob)).decode() for blob in row[1:]]


def _unpack(texts: Sequence[str] | None) -> tuple[Any, ...] | None:
    if texts is None:
        return None
    return (0, *(zlib.decompress(base64.b64decode(text)) for text in texts))
