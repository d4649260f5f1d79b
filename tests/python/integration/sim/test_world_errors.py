# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Worlds with something missing or damaged: what the error says, and what lenient loading keeps."""

import logging
import re
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

pytest.importorskip("collada", reason="the simulator is an extra")

from error_codes import has_code
from fusionslam.errors import DataError, FusionSlamError
from fusionslam.sim.worlds import load_world
from rows import rows
from worlds import ROOM, copy_room

WORLD = "worlds/room.world"
TABLE = "models/table/meshes/table.dae"
TOP = "models/table/materials/textures/top.png"
STACK = "models/stack/model.sdf"
LAMP = "models/lamp/meshes/lamp.obj"
LAMP_SDF = "models/lamp/model.sdf"
SIZE, BOX = "<size>2 1 1</size>", "<box><size>2 1 1</size></box>"
Change = Callable[[Path], object]


@pytest.fixture
def room(tmp_path: Path) -> Path:
    return copy_room(tmp_path)


def without(path: Path) -> None:
    shutil.rmtree(path) if path.is_dir() else path.unlink()


def content(data: bytes) -> Change:
    return lambda path: path.write_bytes(data)


def cut_in_half(path: Path) -> None:
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])


def edit(old: str, new: str) -> Change:
    def change(path: Path) -> None:
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new))

    return change


def expect_missing(folder: Path, *words: str) -> None:
    """Strict loading names all words in one message; lenient loading lists them, and loads."""
    with pytest.raises(DataError) as error:
        load_world(folder)
    world = load_world(folder, lenient=True)
    assert (error.value.code, error.value.fields) == ("unresolved", world.unresolved)
    for word in words:
        assert any(word in item for item in world.unresolved)
    assert len(set(world.unresolved)) == len(world.unresolved) > 0
    assert len(world.visual.mesh) > 0


@rows(
    "file, change, words",
    [
        (TABLE, without, "mesh model://table/meshes/table.dae, table_1/link/visual"),
        (TABLE, content(b"hello"), "table.dae"),
        (TABLE, cut_in_half, "table.dae"),
        (TABLE, edit('url="#top-mesh"', 'url="#other"'), "table.dae"),
        (TABLE, edit("<p>0 0 1 1 2 2 3 3</p>", "<p>0 0 1 1 2 2 9 3</p>"), "table.dae"),
        (TOP, without, "texture ../../../../photos/top.png, table.dae"),
        (TOP, content(b"no picture"), "top.png"),
        ("models/stack", without, "model model://stack"),
        (STACK, content(b"hello"), "model.sdf"),
        (
            STACK,
            edit("<pose>0 0 1", "<include><uri>model://stack</uri></include><pose>0 0 1"),
            "includes itself",
        ),
        ("models/lamp/meshes/shade.png", without, "texture shade.png, lamp.obj"),
        ("models/lamp/meshes/lamp.mtl", without, "material lamp.mtl, lamp.obj"),
        (LAMP, edit("v 1 0 -1", "v nan 0 -1"), "lamp.obj"),
        (LAMP_SDF, edit("<scale>2 2 -2</scale>", "<scale>2</scale>"), "scale of mesh of lamp"),
        (LAMP_SDF, edit("<scale>", "<submesh/><scale>"), "submesh of lamp"),
        (WORLD, edit("Gazebo/Grey", "My/Marble"), "material My/Marble"),
        (WORLD, edit(SIZE, "<size>2 one 1</size>"), "size of box of crate/link/visual"),
        (WORLD, edit(SIZE, "<size>2 -1 1</size>"), "size of box of crate/link/visual"),
        (WORLD, edit(SIZE, "<size>2 1</size>"), "size of box of crate/link/visual"),
        (WORLD, edit("0 0 0.5 0 0 0", "0 0 nan 0 0 0"), "pose of crate/link"),
        (WORLD, edit("0 0 0.5 0 0 0", "0 0 0.5"), "pose crate/link"),
        (
            WORLD,
            edit("<pose>0 0 0.5", "<pose relative_to='hall'>0 0 0.5"),
            "crate/link relative to hall",
        ),
        (WORLD, edit("<scale>1 1 1</scale>", "<scale>2 1 1</scale>"), "scale of crate"),
        (
            WORLD,
            edit("<diffuse>1 0.5 0.25 1</diffuse>", "<diffuse>red</diffuse>"),
            "diffuse of crate",
        ),
        (WORLD, edit("<normal>0 0 1</normal>", "<normal>0 0 0</normal>"), "normal of plane"),
        (WORLD, edit(BOX, "<heightmap/>"), "<heightmap> of crate/link/visual"),
        (WORLD, edit(BOX, ""), "geometry of crate/link/visual"),
        (WORLD, edit("model://table", "https://fuel/table"), "model https://fuel/table"),
    ],
)
def test_what_cannot_be_had_is_listed(
    tmp_path: Path, file: str, change: Change, words: str
) -> None:
    room = copy_room(tmp_path)
    change(room / file)
    expect_missing(room, *words.split(", "))


def test_a_mesh_of_an_unknown_kind_is_listed(room: Path) -> None:
    (room / "models/lamp/meshes/lamp.blend").write_text("")
    edit("meshes/lamp.obj", "meshes/lamp.blend")(room / LAMP_SDF)
    expect_missing(room, "lamp.blend")


def test_names_of_meshes_and_textures_that_are_too_long_are_listed(room: Path) -> None:
    edit("meshes/lamp.obj", "meshes/" + "x" * 300)(room / LAMP_SDF)
    expect_missing(room, "x" * 300)


def test_a_mesh_without_its_texture_is_kept(room: Path) -> None:
    (room / TOP).unlink()
    assert "table_1" in load_world(room, lenient=True).visual.names


def test_an_obj_whose_texture_coordinates_lack_one_is_refused(room: Path) -> None:
    obj = room / LAMP
    obj.write_text(re.sub(r"^(vt \d) .*$", r"\1", obj.read_text(), flags=re.MULTILINE))
    with pytest.raises(DataError, match=r"lamp\.obj"):
        load_world(room)


def test_each_missing_thing_is_named_once(room: Path, caplog: pytest.LogCaptureFixture) -> None:
    shutil.rmtree(room / "models/stack")
    (room / TABLE).unlink()
    twice = "<uri>model://lamp</uri>\n      <pose>-2 2 0 0 0 0</pose>\n    </include>"
    again = f"{twice}<include><uri>model://lamp</uri><name>lamp_2</name></include>"
    edit(twice, again)(room / WORLD)
    (room / LAMP).unlink()
    expect_missing(room, "model://stack", "table.dae", "lamp.obj")
    caplog.clear()
    with caplog.at_level(logging.WARNING):
        assert len(load_world(room, lenient=True).unresolved) == 3
    assert any("table.dae" in record.message for record in caplog.records)


@rows(
    "text, code",
    [
        ("not <xml", "not-xml"),
        ("<urdf/>", "not-sdf"),
        ("<sdf/>", "not-sdf"),
        ('<sdf><world name="w"/></sdf>', "empty-world"),
    ],
)
def test_what_is_no_world_is_refused(tmp_path: Path, text: str, code: str) -> None:
    room = copy_room(tmp_path)
    (room / WORLD).write_text(text)
    for lenient in (False, True) if code == "not-xml" else (False,):
        with pytest.raises(DataError, match=r"room\.world", check=has_code(code)):
            load_world(room, lenient=lenient)


@rows("name, code", [("none.glb", "no-world"), (".", "not-one-world"), ("map.png", "not-a-world")])
def test_a_path_without_a_world_is_refused(tmp_path: Path, name: str, code: str) -> None:
    (tmp_path / "map.png").write_bytes(b"")
    with pytest.raises(DataError, check=has_code(code)):
        load_world(tmp_path / name)


def test_a_folder_of_several_worlds_wants_one_to_be_chosen(room: Path) -> None:
    shutil.copy(room / WORLD, room / "worlds/other.world")
    with pytest.raises(DataError) as error:
        load_world(room)
    assert error.value.fields == ("other.world", "room.world")


def test_without_pycollada_the_message_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "collada", None)
    missing = has_code("missing-extra", "sim")
    with pytest.raises(FusionSlamError, match=r"fusionslam\[sim\]", check=missing):
        load_world(ROOM)


def test_models_that_include_each_other_are_refused(
    room: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fusionslam.sim.worlds.models._MOST_MODELS", 500)
    for name in "ab":
        folder = room / "models" / name
        folder.mkdir()
        include = "".join(f"<include><uri>model://{other}</uri></include>" for other in "ab")
        (folder / "model.sdf").write_text(f"<sdf><model name='{name}'>{include}</model></sdf>")
    world = "<sdf><world name='w'><include><uri>model://a</uri></include></world></sdf>"
    (room / WORLD).write_text(world)
    with pytest.raises(DataError, check=has_code("too-many-models")):
        load_world(room)


def test_worlds_of_too_many_triangles_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fusionslam.sim.worlds.surfaces.MOST_TRIANGLES", 20)
    with pytest.raises(DataError, check=has_code("too-many-triangles")):
        load_world(ROOM)


@rows(
    "uri",
    [
        "model://../../secret.obj",
        "model://table/../../../../secret.obj",
        "../../../secret.obj",
        "file://{outside}/secret.obj",
        "{outside}/secret.obj",
        "model:///{outside}/secret.obj",
    ],
)
def test_meshes_outside_of_the_world_s_folders_are_not_read(tmp_path: Path, uri: str) -> None:
    room = copy_room(tmp_path)
    (tmp_path / "secret.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    written = uri.replace("{outside}", str(tmp_path))
    edit("model://table/meshes/table.dae", written)(room / "models/table/table.sdf")
    expect_missing(room, f"mesh {written}: named by table_1/link/visual, not found")


def test_textures_and_materials_outside_of_the_world_s_folders_are_not_read(room: Path) -> None:
    (room.parent / "secret.mtl").write_text("newmtl x\nKd 1 0 0\n")
    text = (room / LAMP).read_text()
    for name in ("../../../../secret.mtl", str(room.parent / "secret.mtl")):
        (room / LAMP).write_text(text.replace("lamp.mtl", name))
        expect_missing(room, f"material {name}")
    (room.parent / "photos").mkdir()
    (room / TOP).rename(room.parent / "photos/top.png")
    expect_missing(room, "texture ../../../../photos/top.png", "table.dae")
