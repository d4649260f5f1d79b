# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Walk the models of an SDF world: follow includes, chain poses, apply saved states."""

import logging
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from fusionslam.base.arrays import Matrix
from fusionslam.errors import DataError
from fusionslam.sim.worlds.resource_paths import Library
from fusionslam.sim.worlds.sdf_values import pose_of

log = logging.getLogger(__name__)

# Depth limit against models that include one another; real worlds nest two or three deep.
_DEEPEST = 16
# A model that includes two others, which include two others and so on, would be endless without it.
_MOST_MODELS = 10_000


@dataclass(frozen=True, eq=False)
class Shape:
    """A visual or a collision with its pose in the world.

    Attributes:
        element: the SDF element.
        model: name of the object: the outermost model that contains it.
        owner: path of names for messages, such as "chair_1/link/visual".
        folder: of the file that contains it.
        world_from_shape: (4, 4).
    """

    element: ET.Element
    model: str
    owner: str
    folder: Path
    world_from_shape: Matrix


def shapes_of(path: Path, library: Library) -> Iterator[Shape]:
    """All visuals and collisions of a world, in file order.

    Raises:
        DataError: the file cannot be read, is not XML, or contains no world.
    """
    root = _root(path)
    world = root.find("world")
    if world is None:
        world = root
        if root.find("model") is None:
            raise DataError(
                f"{path}: expected <world> or <model> inside <sdf>, found neither", code="not-sdf"
            )
    states = {state.get("name"): state for state in world.findall("state/model")}
    people = [actor.get("name") for actor in world.findall("actor")]
    if people:
        log.info("%s: actors move and are left out: %s", path, people)
    models = [e for e in world if e.tag in ("model", "include")]
    walk = _Walk(library, path.resolve().parent)
    for element in [*models, *world.findall("state/insertions/model")]:
        yield from walk.outermost(element, states)


class _Walk:
    """Recursive walk over models; holds the library and the folder of the world's file."""

    def __init__(self, library: Library, folder: Path) -> None:
        self._library = library
        self._missing = library.missing
        self._folder = folder
        self._visited = 0
        self._roots: dict[Path, ET.Element] = {}

    def outermost(
        self, element: ET.Element, states: dict[str | None, ET.Element]
    ) -> Iterator[Shape]:
        resolved = self._resolve(element, self._folder)
        if resolved is None:
            return
        model, folder = resolved
        name = element.findtext("name") or model.get("name") or "model"
        state = states.get(name)
        if state is not None and (state.findtext("scale") or "1 1 1").split() != ["1"] * 3:
            self._missing.add("state", f"scale of {name}", "not supported")
        holder = state if state is not None and state.find("pose") is not None else None
        if holder is None:
            holder = _pose_holder(element, model)
        pose = pose_of(holder, name, self._missing)
        yield from self._inside(model, folder, name, name, pose, depth=0)

    def _inside(
        self, model: ET.Element, folder: Path, top: str, owner: str, pose: Matrix, depth: int
    ) -> Iterator[Shape]:
        """Shapes of a model's links, then of its nested models; pose is world_from_model."""
        if depth > _DEEPEST:
            self._missing.add("model", owner, f"nested deeper than {_DEEPEST}: includes itself?")
            return
        for link in model.findall("link"):
            name = f"{owner}/{link.get('name')}"
            world_from_link = pose @ pose_of(link, name, self._missing)
            for element in (e for e in link if e.tag in ("visual", "collision")):
                inside = f"{name}/{element.get('name')}"
                placed = world_from_link @ pose_of(element, inside, self._missing)
                yield Shape(element, top, inside, folder, placed)
        for element in (e for e in model if e.tag in ("model", "include")):
            resolved = self._resolve(element, folder)
            if resolved is None:
                continue
            inner, inner_folder = resolved
            name = f"{owner}/{element.findtext('name') or inner.get('name')}"
            holder = _pose_holder(element, inner)
            world_from_inner = pose @ pose_of(holder, name, self._missing)
            yield from self._inside(inner, inner_folder, top, name, world_from_inner, depth + 1)

    def _resolve(self, element: ET.Element, folder: Path) -> tuple[ET.Element, Path] | None:
        """The model and the folder of its file; None, and recorded, if it cannot be read."""
        if element.tag == "model":
            return element, folder
        self._visited += 1
        if self._visited > _MOST_MODELS:
            raise DataError(
                f"{self._folder}: more than {_MOST_MODELS} models are included",
                code="too-many-models",
            )
        uri = (element.findtext("uri") or "").strip()
        file = self._library.model_file(uri, folder)
        if file is None:
            self._missing.add("model", uri, f"included by {folder}, not found")
            return None
        try:
            if file not in self._roots:
                self._roots[file] = _root(file)
            model = self._roots[file].find("model")
        except DataError as error:
            self._missing.add("model", uri, str(error))
            return None
        if model is None:
            self._missing.add("model", uri, f"{file} has no <model>")
            return None
        return model, file.parent


def _pose_holder(element: ET.Element, model: ET.Element) -> ET.Element:
    """The element whose pose applies: an include's own pose overrides the included model's."""
    return element if element.find("pose") is not None else model


def _root(path: Path) -> ET.Element:
    try:
        root = ET.parse(path).getroot()
    except (ET.ParseError, LookupError, ValueError) as error:  # an unknown or odd encoding
        raise DataError(f"{path}: not XML, expected SDF: {error}", code="not-xml") from error
    except OSError as error:
        raise DataError(f"{path}: {error.strerror}, expected SDF") from error
    if root.tag not in ("sdf", "gazebo"):
        raise DataError(f"{path}: its root is <{root.tag}>, expected <sdf>", code="not-sdf")
    return root
