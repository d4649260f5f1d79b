# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Where the files lie that a world in SDF names."""

import os
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from fusionslam.sim.worlds.missing_resources import Unresolved
from fusionslam.sim.worlds.surfaces import rgb_of

# Where Gazebo, old and new, looks for models.
MODEL_PATHS = ("GAZEBO_MODEL_PATH", "GZ_SIM_RESOURCE_PATH")


class Library:
    """Finds models, meshes and textures for one world, and keeps each picture once.

    Args:
        world: the world's file. Models are looked for in models/ beside it and above it, in its
            own folder, and in the folders of MODEL_PATHS.
        missing: notes what cannot be had.
    """

    def __init__(self, world: Path, missing: Unresolved) -> None:
        here = world.resolve().parent
        self.root = here.parent
        self.missing = missing
        listed = [p for name in MODEL_PATHS for p in os.environ.get(name, "").split(os.pathsep)]
        self._roots = [here / "models", self.root / "models", here, self.root]
        self._roots += [Path(path) for path in listed if path]
        self._images: dict[Path, NDArray[np.uint8] | None] = {}

    def find(self, uri: str, folder: Path) -> Path | None:
        """The file or folder of model://NAME/PATH, file://PATH, or a path as seen from folder."""
        scheme, _, rest = uri.strip().rpartition("://")
        if scheme not in ("", "model", "file"):
            return None
        places = [root / rest for root in self._roots]
        if scheme == "file":  # models of AWS say file://models/NAME/...
            places = [Path("/") / rest, self.root / rest, *places]
        elif not scheme:
            places.insert(0, folder / rest)
        return next((place for place in places if rest and place.exists()), None)

    def model_file(self, uri: str, folder: Path) -> Path | None:
        """The SDF file of an included model: the newest that its model.config lists."""
        place = self.find(uri, folder)
        if place is None or place.is_file():
            return place
        config = place / "model.config"
        listed = _sdf_files(config) if config.is_file() else []
        names = [name for _, name in sorted(listed, reverse=True)]
        found = (place / name for name in [*names, "model.sdf"])
        return next((file for file in found if file.is_file()), None)

    def texture(self, written: str, mesh: Path) -> NDArray[np.uint8] | None:
        """The picture that a mesh's file names, uint8 (H, W, 3); None, and noted, if not found."""
        for place in self.texture_places(written, mesh):
            if place.is_file():
                return self.picture(place)
        self.missing.add("texture", written, f"named by {mesh}, not found")
        return None

    def picture(self, file: Path) -> NDArray[np.uint8] | None:
        """A picture, uint8 (H, W, 3); None, and noted, if it cannot be decoded."""
        key = file.resolve()
        if key not in self._images:
            self._images[key] = self._decoded(file)
        return self._images[key]

    def texture_places(self, written: str, mesh: Path) -> list[Path]:
        """As written; in the mesh's folder; in ../materials/textures; below a folder above it.

        The last one mends paths with too many "../" in them: "../../../../photos/a.jpg" is
        photos/a.jpg in the first of the folders above the mesh that has it, up to the world's.
        """
        path = Path(written.removeprefix("file://").replace("\\", "/"))
        folder = mesh.resolve().parent
        inner = Path(*[part for part in path.parts if part not in ("..", ".", "/")])
        above = [p for p in folder.parents if p == self.root or self.root in p.parents]
        return [
            folder / path,
            folder / path.name,
            folder.parent / "materials" / "textures" / path.name,
            *(place / inner for place in above),
        ]

    def _decoded(self, file: Path) -> NDArray[np.uint8] | None:
        try:
            with Image.open(file) as image:
                return rgb_of(image)
        except (OSError, ValueError, SyntaxError) as error:
            self.missing.add("texture", str(file), f"cannot be read: {error}")
            return None


class MeshFolder:
    """Gives trimesh the files that a mesh names (materials and textures), noting the others."""

    def __init__(self, library: Library, mesh: Path) -> None:
        self._library = library
        self._mesh = mesh

    def get(self, name: str) -> bytes:
        """Content of a file that the mesh's file names.

        Raises:
            FileNotFoundError: it does not exist; noted.
        """
        for place in self._library.texture_places(name, self._mesh):
            if place.is_file():
                return place.read_bytes()
        kind = "material" if name.endswith(".mtl") else "texture"
        self._library.missing.add(kind, name, f"named by {self._mesh}, not found")
        raise FileNotFoundError(name)

    __getitem__ = get


def _sdf_files(config: Path) -> list[tuple[tuple[int, ...], str]]:
    """Version and name of the files that a model.config lists; none if it cannot be read."""
    try:
        entries = ET.parse(config).getroot().findall("sdf")
    except (ET.ParseError, OSError):
        return []
    return [(_version(entry.get("version", "0")), (entry.text or "").strip()) for entry in entries]


def _version(text: str) -> tuple[int, ...]:
    return tuple(int(number) if number.isdigit() else 0 for number in text.split("."))
