# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Find the files that an SDF world refers to, and collect what is missing or not supported."""

import logging
import os
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from fusionslam.errors import DataError
from fusionslam.sim.worlds.surfaces import rgb_of

log = logging.getLogger(__name__)

# Environment variables in which Gazebo, old and new, looks for models.
MODEL_PATHS = ("GAZEBO_MODEL_PATH", "GZ_SIM_RESOURCE_PATH")


class Unresolved:
    """Collects missing resources, so that one message can list them all.

    Attributes:
        items: each missing resource once, like
            "texture floor.png: no such file beside models/hall/meshes/hall.dae".
    """

    def __init__(self) -> None:
        self.items: list[str] = []
        self._seen: set[tuple[str, str]] = set()

    def add(self, kind: str, name: str, why: str) -> None:
        """Record that ``name`` is missing; the first reason is kept."""
        if (kind, name) not in self._seen:
            self._seen.add((kind, name))
            self.items.append(f"{kind} {name}: {why}")

    def settle(self, path: Path, lenient: bool) -> tuple[str, ...]:
        """If lenient, log and return the missing resources.

        Raises:
            DataError: not lenient and something is missing; the message lists all of it.
        """
        if self.items and not lenient:
            listed = "".join(f"\n  {item}" for item in self.items)
            raise DataError(
                f"{path}: {len(self.items)} resources are missing or not supported, lenient "
                f"loading (--lenient) skips them{listed}",
                code="unresolved",
                fields=tuple(self.items),
            )
        for item in self.items:
            log.warning("%s: skipped %s", path, item)
        return tuple(self.items)


class Library:
    """Finds models, meshes and textures for one world; decodes each image once.

    Args:
        world: the world's file. Models are searched in models/ beside it and above it, in its
            own folder, and in the folders of MODEL_PATHS.
        missing: records what cannot be found or read.
    """

    def __init__(self, world: Path, missing: Unresolved) -> None:
        here = world.resolve().parent
        self.root = here.parent
        self.missing = missing
        listed = [p for name in MODEL_PATHS for p in os.environ.get(name, "").split(os.pathsep)]
        self._roots = [here / "models", self.root / "models", here, self.root]
        self._roots += [Path(path) for path in listed if path]
        # Links are followed only in the world's own path: a folder of models may be linked.
        self._allowed = [Path(os.path.abspath(root)) for root in self._roots]
        self._images: dict[Path, NDArray[np.uint8] | None] = {}

    def find(self, uri: str, folder: Path) -> Path | None:
        """The file or folder of model://NAME/PATH, file://PATH, or a path relative to folder."""
        scheme, _, rest = uri.strip().rpartition("://")
        if scheme not in ("", "model", "file"):
            return None
        places = [root / rest.lstrip("/") for root in self._roots]
        if scheme == "file":  # AWS models use file://models/NAME/...
            places = [Path("/") / rest, self.root / rest, *places]
        elif not scheme:
            places.insert(0, folder / rest)
        allowed = (place for place in places if rest and self._is_allowed(place))
        return next((place for place in allowed if os.path.exists(place)), None)

    def _is_allowed(self, place: Path, *more: Path) -> bool:
        """Whether a path is in a folder of the world, of MODEL_PATHS, or of ``more``."""
        whole = Path(os.path.abspath(place))
        return any(whole.is_relative_to(root) for root in (*self._allowed, *more))

    def model_file(self, uri: str, folder: Path) -> Path | None:
        """The SDF file of an included model: the newest one listed in its model.config."""
        place = self.find(uri, folder)
        if place is None or place.is_file():
            return place
        config = place / "model.config"
        listed = _sdf_files(config) if config.is_file() else []
        names = [name for _, name in sorted(listed, reverse=True)]
        found = (place / name for name in [*names, "model.sdf"] if Path(name).name == name)
        return next((file for file in found if os.path.isfile(file)), None)

    def texture(self, written: str, mesh: Path) -> NDArray[np.uint8] | None:
        """An image that a mesh file refers to, uint8 (H, W, 3); None, and recorded, if missing."""
        for place in self.texture_places(written, mesh):
            if os.path.isfile(place):  # False, too, for a name that is too long
                return self.picture(place)
        self.missing.add("texture", written, f"named by {mesh}, not found")
        return None

    def picture(self, file: Path) -> NDArray[np.uint8] | None:
        """Decode an image, uint8 (H, W, 3); None, and recorded, if it cannot be decoded."""
        key = file.resolve()
        if key not in self._images:
            self._images[key] = None
            try:
                with Image.open(file) as image:
                    self._images[key] = rgb_of(image)
            except (OSError, ValueError, SyntaxError) as error:
                self.missing.add("texture", str(file), f"cannot be read: {error}")
        return self._images[key]

    def texture_places(self, written: str, mesh: Path) -> list[Path]:
        """Candidates: as written, the mesh's folder, ../materials/textures, parent folders.

        The last kind repairs paths with too many "../": "../../../../photos/a.jpg" is taken as
        photos/a.jpg in the first folder above the mesh that has it, up to the world's folder.
        """
        path = Path(written.removeprefix("file://").replace("\\", "/"))
        folder = mesh.resolve().parent
        inner = Path(*[part for part in path.parts if part not in ("..", ".", "/")])
        above = [p for p in folder.parents if p == self.root or self.root in p.parents]
        places = [
            folder / path,
            folder / path.name,
            folder.parent / "materials" / "textures" / path.name,
            *(place / inner for place in above),
        ]
        return [place for place in places if self._is_allowed(place, folder.parent)]


class MeshFolder:
    """Resolver for trimesh: reads a mesh's material and texture files, records missing ones."""

    def __init__(self, library: Library, mesh: Path) -> None:
        self._library = library
        self._mesh = mesh

    def get(self, name: str) -> bytes:
        """Content of a file that the mesh file refers to.

        Raises:
            FileNotFoundError: it does not exist; it is also recorded as missing.
        """
        for place in self._library.texture_places(name, self._mesh):
            if os.path.isfile(place):
                return place.read_bytes()
        kind = "material" if name.endswith(".mtl") else "texture"
        self._library.missing.add(kind, name, f"named by {self._mesh}, not found")
        raise FileNotFoundError(name)

    __getitem__ = get


def _sdf_files(config: Path) -> list[tuple[tuple[int, ...], str]]:
    """Version and name of the files listed in a model.config; empty if it cannot be read."""
    try:
        entries = ET.parse(config).getroot().findall("sdf")
    except (ET.ParseError, OSError, LookupError, ValueError):
        return []
    versions = (entry.get("version", "0").split(".") for entry in entries)
    numbers = [tuple(int(n) if n.isdigit() else 0 for n in version) for version in versions]
    return list(zip(numbers, ((entry.text or "").strip() for entry in entries), strict=True))
