# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Exports maps and trajectories to standard formats: JSON, TUM, g2o, GraphML.

The source is a ``RatSlamRun``, or a ``LiveMap`` while it grows.

Lengths are in metres, angles in radians counter-clockwise, stamps in nanoseconds, unless the
format itself says otherwise. Poses are in the map frame, whose origin is where the robot began;
only the true poses are in the world frame. Every file is written atomically.
"""

import os
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.archive import save_json
from fusionslam.base.arrays import Floats
from fusionslam.base.files import atomic_path
from fusionslam.datasets import graph_files
from fusionslam.datasets.graph_files import GraphEdge, GraphNode
from fusionslam.datasets.pose_files import write_poses_tum
from fusionslam.errors import ConfigError, DataError
from fusionslam.geometry.trajectory import ground_poses
from fusionslam.ratslam.map_snapshot import MapRecord

PathLike = str | os.PathLike[str]

MAP_FORMAT = "fusionslam.experience_map.1"
UNITS = {
    "x": "m",
    "y": "m",
    "heading": "rad",
    "distance": "m",
    "facing": "rad",
    "duration": "s",
    "sd_m": "m",
    "sd_rad": "rad",
    "stamp_ns": "ns",
}
"""Units of the fields of nodes and links; ids have none."""

TRAJECTORIES = {
    "final": "trajectory.txt",
    "live": "trajectory_live.txt",
    "dead_reckoning": "dead_reckoning.txt",
    "truth": "truth.txt",
}
"""Files that ``export_run`` writes, by the name of the trajectory."""

_GRAPHML = "http://graphml.graphdrawing.org/xmlns"


def export_run(folder: PathLike, run: MapRecord) -> list[Path]:
    """Write the map in every format and all known trajectories into a folder.

    Returns:
        The files: map.json, map.g2o, map.graphml, and those of ``TRAJECTORIES``.

    Raises:
        DataError: a value that is not finite, or a file that cannot be written.
    """
    base = Path(folder)
    maps = {"map.json": write_map_json, "map.g2o": write_g2o, "map.graphml": write_graphml}
    for name, write in maps.items():
        write(base / name, run)
    known = {which: name for which, name in TRAJECTORIES.items() if _poses(run, which) is not None}
    for which, name in known.items():
        write_trajectory(base / name, run, which)
    return [base / name for name in (*maps, *known.values())]


def write_map_json(path: PathLike, run: MapRecord) -> None:
    """Write the map and the trajectory as one JSON object.

    Its keys: ``format``; ``name``, ``views``, ``odometry``, ``preset``, ``config`` of the run;
    ``units`` by field; ``nodes``, a list of objects (id, x, y, heading, stamp_ns, view); ``links``,
    a list of objects (source and target ids; distance and heading of the displacement, and facing,
    the rotation, both relative to the source's heading; duration; the expected deviations of the
    displacement, along each axis, and of the rotation); ``trajectory``, lists of equal length:
    stamps_ns, node and view ids (-1 for none), and the poses [x, y, heading] live, final,
    dead_reckoning and truth. A list that was not kept is null; so is truth at steps where it is
    unknown.

    Raises:
        DataError: a value that is not finite, or the file cannot be written.
    """
    _check(run)
    content = {
        **_about(run),
        "config": dict(run.config),
        "units": UNITS,
        "nodes": _nodes(run),
        "links": _links(run),
        "trajectory": {
            "stamps_ns": run.stamps_ns.tolist(),
            "node": run.node_ids.tolist(),
            "view": run.view_ids.tolist(),
            **{which: _to_lists(_poses(run, which)) for which in TRAJECTORIES},
        },
    }
    save_json(path, MAP_FORMAT, content)


def write_trajectory(path: PathLike, run: MapRecord, which: str = "final") -> None:
    """Write a trajectory in TUM format: seconds, x y z, quaternion x y z w.

    Args:
        path: path of the file.
        run: the recorded run.
        which: "final" (poses on the final map), "live" (poses on the map at that time),
            "dead_reckoning" or "truth" (only the steps where it is known). The last of several
            steps with the same stamp counts.

    Raises:
        ConfigError: ``which`` is unknown.
        DataError: the run has no such poses, one is not finite, or the file cannot be written.
    """
    poses = _poses(run, which)
    if poses is None:
        raise DataError(f"{run.name}: the run has no trajectory {which!r} to write to {path}")
    _check(run)
    last = np.append(np.diff(run.stamps_ns) != 0, True)[: len(poses)]
    kept = last & ~_unknown(poses)
    write_poses_tum(path, run.stamps_ns[kept], ground_poses(*poses[kept].T))


def write_g2o(path: PathLike, run: MapRecord) -> None:
    """Write the map for pose graph optimisers: VERTEX_SE2 and EDGE_SE2, the first node fixed.

    An edge's measurement is the target's pose in the source's frame by odometry and view: x, y in
    metres, rotation in radians. Its information matrix (1/m^2, 1/rad^2), which relaxation uses as
    the weight, follows from the link's deviations.

    Raises:
        DataError: a value that is not finite, a deviation that is not positive, or the file cannot
            be written.
    """
    _check(run)
    nodes = [GraphNode(number, pose) for number, pose in enumerate(run.nodes)]
    deviations = np.stack([run.links["sd_m"], run.links["sd_rad"]], axis=1)
    if (wrong := np.flatnonzero((deviations <= 0).any(axis=1))).size:
        found = deviations[wrong[0]].tolist()
        raise DataError(
            f"links: row {wrong[0]} deviates by {found} m and rad, expected above 0",
            code="no-deviation",
            fields=(str(wrong[0]),),
        )
    rows = zip(run.links, link_offsets(run.links), deviations**-2.0, strict=True)
    edges = [
        GraphEdge(link["source"], link["target"], way, np.diag([place, place, rotation]))
        for link, way, (place, rotation) in rows
    ]
    graph_files.write_g2o(path, nodes, edges, fixed=[0] if nodes else [])


def link_offsets(links: NDArray[np.void]) -> Floats:
    """float64 (n, 3): x, y and rotation of each link's target in its source's frame."""
    c, s = np.cos(links["heading"]), np.sin(links["heading"])
    return np.stack([links["distance"] * c, links["distance"] * s, links["facing"]], axis=1)


def write_graphml(path: PathLike, run: MapRecord) -> None:
    """Write the map as a directed GraphML graph; attributes as in ``write_map_json``.

    Nodes are "n0", "n1", ...; integers have type long, other numbers double; metadata of the run
    are attributes of the graph.

    Raises:
        DataError: a value that is not finite, or the file cannot be written.
    """
    _check(run)
    ElementTree.register_namespace("", _GRAPHML)
    root = ElementTree.Element(f"{{{_GRAPHML}}}graphml")
    graph = ElementTree.Element(
        f"{{{_GRAPHML}}}graph", {"id": "experience_map", "edgedefault": "directed"}
    )
    keys: dict[tuple[str, str], str] = {}
    _put(root, keys, graph, _about(run))
    for node in _nodes(run):
        element = ElementTree.SubElement(graph, f"{{{_GRAPHML}}}node", {"id": f"n{node.pop('id')}"})
        _put(root, keys, element, node)
    for link in _links(run):
        ends = {end: f"n{link.pop(end)}" for end in ("source", "target")}
        _put(root, keys, ElementTree.SubElement(graph, f"{{{_GRAPHML}}}edge", ends), link)
    root.append(graph)
    ElementTree.indent(root)
    with atomic_path(path) as temporary:
        ElementTree.ElementTree(root).write(temporary, encoding="utf-8", xml_declaration=True)


def _put(
    root: ElementTree.Element,
    keys: dict[tuple[str, str], str],
    element: ElementTree.Element,
    values: dict[str, Any],
) -> None:
    """Add attributes to an element, and the keys that declare them to the file."""
    kind = element.tag.rpartition("}")[2]
    for name, value in values.items():
        key = keys.get((kind, name))
        if key is None:
            key = keys[kind, name] = f"{kind}_{name}"
            types = {str: "string", int: "long", float: "double"}
            declared = {"id": key, "for": kind, "attr.name": name, "attr.type": types[type(value)]}
            ElementTree.SubElement(root, f"{{{_GRAPHML}}}key", declared)
        data = ElementTree.SubElement(element, f"{{{_GRAPHML}}}data", {"key": key})
        data.text = value if isinstance(value, str) else repr(value)


def _about(run: MapRecord) -> dict[str, str]:
    return {name: getattr(run, name) for name in ("name", "views", "odometry", "preset")}


def _nodes(run: MapRecord) -> list[dict[str, Any]]:
    rows = zip(
        run.nodes.tolist(), run.node_stamps_ns.tolist(), run.node_views.tolist(), strict=True
    )
    return [
        {"id": node, "x": x, "y": y, "heading": heading, "stamp_ns": stamp, "view": view}
        for node, ((x, y, heading), stamp, view) in enumerate(rows)
    ]


def _links(run: MapRecord) -> list[dict[str, Any]]:
    names = run.links.dtype.names or ()
    return [dict(zip(names, link, strict=True)) for link in run.links.tolist()]


def _poses(run: MapRecord, which: str) -> Floats | None:
    if which not in TRAJECTORIES:
        raise ConfigError(f"unknown trajectory {which!r}: expected {', '.join(TRAJECTORIES)}")
    names = {"final": "final_poses", "live": "poses"}
    found: Floats | None = getattr(run, names.get(which, which))
    return found


def _to_lists(poses: Floats | None) -> list[list[float] | None] | None:
    """Poses as JSON values; None for unknown ones."""
    if poses is None:
        return None
    rows = zip(poses.tolist(), _unknown(poses).tolist(), strict=True)
    return [None if nowhere else pose for pose, nowhere in rows]


def _unknown(poses: Floats) -> NDArray[np.bool_]:
    """Bool (n,): True for unknown poses, which are NaN three times."""
    return np.asarray(np.isnan(poses).all(axis=1))


def _check(run: MapRecord) -> None:
    """Raise DataError, which names the first value that is not finite."""
    tables: dict[str, NDArray[Any] | None] = {"nodes": run.nodes, "offsets": run.offsets}
    tables |= {"poses": run.poses, "dead_reckoning": run.dead_reckoning}
    tables |= {f"links, {name}": run.links[name][:, None] for name in run.links.dtype.names or ()}
    if run.truth is not None:
        tables["truth"] = np.where(_unknown(run.truth)[:, None], 0.0, run.truth)
    for name, rows in tables.items():
        if rows is not None and (bad := np.flatnonzero(~np.isfinite(rows).all(axis=1))).size:
            raise DataError(f"{name}: row {bad[0]} is {rows[bad[0]].tolist()}, expected numbers")
