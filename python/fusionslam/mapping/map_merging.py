# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Takes the sessions of another map into a map, if enough loops between both agree."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Protocol

import numpy as np

from fusionslam.base.arrays import Floats32, Integers
from fusionslam.base.progress import Progress
from fusionslam.descriptors import describe_or_zeros, for_clouds
from fusionslam.descriptors.registry import FITTED_SECTIONS
from fusionslam.errors import ConfigError
from fusionslam.loop_closure.detector import LoopDetector
from fusionslam.loop_closure.observation import name_voter
from fusionslam.loop_closure.verification import PairComparisons, verify_candidates
from fusionslam.mapping.corrections import copy_corrections
from fusionslam.mapping.edge import Edge
from fusionslam.mapping.map_content import MapContent
from fusionslam.mapping.map_file import MapFile
from fusionslam.mapping.map_settings import MapSettings
from fusionslam.mapping.pose_graph import PoseGraph
from fusionslam.registration import PreparedCloud, Refusal
from fusionslam.sensors.frame import Cloud

Vectors = dict[str, tuple[Integers, Floats32]]
"""Numbers of keyframes, and their vectors, float32 (n, D), by descriptor."""
MOST_APART = 2.0
"""Factor between the lengths of maps whose clouds are still compared."""


class ComparedMap(Protocol):
    """What merging asks of a ``PlaceMap``."""

    content: MapContent
    detector: LoopDetector
    file: MapFile

    @property
    def settings(self) -> MapSettings: ...


@dataclass(frozen=True)
class Merge:
    """Whether another map was taken in.

    Attributes:
        sessions: names of the sessions that were taken in; none if there is a reason.
        believed, refused: loops between the maps; ``a`` is a keyframe of this map, ``b`` one of the
            other, by their numbers there.
        reason: why the other map was not taken in; None if it was.
    """

    sessions: tuple[str, ...]
    believed: tuple[Edge, ...]
    refused: tuple[Edge, ...]
    reason: Refusal | None = None


def check_mergeable(site: ComparedMap, other: ComparedMap) -> None:
    """Raise ConfigError for maps that cannot be compared, or with a session in common."""
    own, others = site.settings.comparable, other.settings.comparable
    differing = [key for key, value in own.items() if value != others[key]]
    if differing:
        raise ConfigError(
            f"both maps were made with other {' and '.join(differing)}: their keyframes cannot be "
            "compared",
            code="other-configuration",
            fields=tuple(differing),
        )
    lengths, other_lengths = site.settings.lengths, other.settings.lengths
    for key in lengths.keys() & other_lengths.keys():
        length, other_length = lengths[key], other_lengths[key]
        if not length / MOST_APART <= other_length <= length * MOST_APART:
            raise ConfigError(
                f"{key} of both maps is {length:.3g} and {other_length:.3g}: their keyframes "
                f"cannot be compared, expected a factor of {MOST_APART:g} at most",
                code="other-configuration",
                fields=(key, f"{other_length:.3g}"),
            )
    common = site.content.sessions.keys() & other.content.sessions.keys()
    if common:
        raise ConfigError(
            f"both maps have a session {min(common)!r}: expected other names",
            code="same-session",
            fields=("session", min(common)),
        )


def find_loops_between(
    site: ComparedMap,
    other: ComparedMap,
    vectors: Vectors,
    progress: Progress | None = None,
) -> list[Edge]:
    """Find keyframes of a map at those of another: edges from this map's numbers to the other's.

    Args:
        site, other: the maps.
        vectors: of the other, as ``vectors_as_of`` returns.
        progress: called with (keyframes compared, total).
    """
    numbers = other.content.numbers.tolist()
    lengths, loops = site.settings.registration, site.settings.loops
    edges: list[Edge] = []
    for done, number in enumerate(numbers, start=1):
        row = {name: rows[done - 1] for name, (_, rows) in vectors.items()}
        cloud = PreparedCloud.from_bytes(other.file.cloud(number).evidence, lengths)
        pairs = PairComparisons(cloud, site.detector.stored_frame)
        best, _ = verify_candidates(number, site.detector.nearest_frames(row), pairs, loops)
        if best is not None and best.reason is None and best.match_from_query is not None:
            pose, covariance = best.match_from_query, np.asarray(best.covariance)
            edges.append(Edge(len(edges), "merge", best.match, number, pose, covariance, "pending"))
        if progress is not None:
            progress(done, len(numbers))
    return edges


def vectors_as_of(site: ComparedMap, other: ComparedMap) -> Vectors:
    """Return another map's numbers and vectors by descriptor, as a map would describe its clouds.

    What follows from the first cloud of each, they may describe differently.
    """
    vectors: Vectors = other.file.vectors()
    own, theirs = site.settings.describe, other.settings.describe
    for section in FITTED_SECTIONS:
        if getattr(own, section) == getattr(theirs, section):
            continue
        for key in vectors.keys() & {section, name_voter(section)}:
            numbers, _ = vectors[key]
            clouds = (
                PreparedCloud.from_bytes(
                    other.file.cloud(number).evidence, site.settings.registration
                )
                for number in numbers.tolist()
            )
            config = for_clouds(own, section, site.settings.fusion)
            rows = [describe_or_zeros(Cloud(each.points), section, config)[0] for each in clouds]
            vectors[key] = numbers, np.array(rows)
    return vectors


def judge_merge(site: ComparedMap, other: ComparedMap, between: list[Edge]) -> Merge:
    """Solve the graph of both maps with the loops between them."""
    graph = PoseGraph()
    rows: dict[tuple[str, int], int] = {}
    for name, each in (("site", site.content), ("other", other.content)):
        for keyframe in each.keyframes:
            rows[name, keyframe.id] = graph.add_node(keyframe.robot_from_cloud)
        for edge in each.edges.values():
            a, b = rows[name, edge.a], rows[name, edge.b]
            by_hand = edge.reason if edge.is_by_hand else None
            graph.add_edge(a, b, edge.pose, edge.covariance, edge.kind, by_hand)
    first = len(graph.edges)
    for edge in between:
        a, b = rows["site", edge.a], rows["other", edge.b]
        graph.add_edge(a, b, edge.pose, edge.covariance, "merge")
    solution = graph.solve()
    states = {edge.number: edge for edge in (*solution.believed, *solution.refused)}
    judged = [
        replace(edge, state=states[first + k].state, reason=states[first + k].reason)
        for k, edge in enumerate(between)
    ]
    believed = tuple(edge for edge in judged if edge.state == "believed")
    refused = tuple(edge for edge in judged if edge.state != "believed")
    if believed:
        return Merge(tuple(other.content.sessions), believed, refused)
    text = (
        f"{len(between)} loops between the maps, and no three of them agree: they show other "
        "places, or too little of the same"
    )
    return Merge((), (), refused, Refusal("few-merges", len(between), text))


def copy_sessions(
    site: ComparedMap, other: ComparedMap, vectors: Vectors, between: Sequence[Edge]
) -> None:
    """Write another map's keyframes, vectors and edges into a map's file, under new numbers."""
    content, file = other.content, site.file
    sessions = {number: file.add_session(name) for name, number in content.sessions.items()}
    known = site.content.keyframes
    first = known[-1].id + 1 if known else 0
    renamed = {number: first + row for number, row in content.row.items()}
    for row, keyframe in enumerate(content.keyframes):
        copied = keyframe._replace(id=first + row, session=sessions[keyframe.session])
        own = {name: rows[row] for name, (_, rows) in vectors.items()}
        file.add_keyframe(copied, other.file.cloud(keyframe.id), own)
        passed = other.file.frames_after(keyframe.id)
        if len(passed.numbers):
            file.add_frames(copied.id, 0, passed)
    own_nodes = {each.id: each.session for each in content.keyframes}
    told = other.file.positions()
    for name, number in content.sessions.items():
        mine = [replace(p, node=renamed[p.node]) for p in told if own_nodes[p.node] == number]
        if mine:
            file.store_positions(name, mine)
    edges = [replace(e, a=renamed[e.a], b=renamed[e.b]) for e in content.edges.values()]
    edges += [replace(edge, b=renamed[edge.b]) for edge in between]
    for number, edge in enumerate(edges, start=site.content.next_edge):
        file.store_edge(replace(edge, number=number))
    numbered = dict(zip(content.edges, count(site.content.next_edge), strict=False))
    copy_corrections(file, other.file, renamed, numbered)
