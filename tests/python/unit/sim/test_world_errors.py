# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Worlds with something missing or damaged: what the error says, and what lenient loading keeps."""

import logging
import re
import shutil
import sys
from pathlib import Path

import pytest

from project import SMALL_DATA

pytest.importorskip("collada", reason="the simulator is an extra")

from error_codes import has_code
from fusionslam.errors import DataError, FusionSlamError
from fusionslam.sim.worlds import load_world

ROOM = SMALL_DATA / "worlds/room"
TABLE = "models/table/meshes/table.dae"


@pytest.fixture
def room(tmp_path: Path) -> Path:
    """A copy of the room that a test may damage."""
    return Path(shutil.copytree(ROOM, tmp_path / "room"))


def damage(folder: Path, file: str, old: str, new: str) -> None:
    text = (folder / file).read_text()
    assert old in text
    (folder / file).write_text(text.replace(old, new))


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


def test_a_missing_mesh_is_named_with_who_wants_it(room: Path) -> None:
    (room / TABLE).unlink()
    expect_missing(room, "mesh model://table/meshes/table.dae", "table_1/link/visual")


def test_a_missing_texture_is_named_and_lenient_loading_keeps_the_mesh(room: Path) -> None:
    (room / "models/table/materials/textures/top.png").unlink()
    expect_missing(room, "texture ../../../../photos/top.png", "table.dae")
    assert "table_1" in load_world(room, lenient=True).visual.names


def test_a_missing_texture_or_material_of_an_obj_is_named(room: Path) -> None:
    (room / "models/lamp/meshes/shade.png").unlink()
    expect_missing(room, "texture shade.png", "lamp.obj")
    (room / "models/lamp/meshes/lamp.mtl").unlink()
    expect_missing(room, "material lamp.mtl", "lamp.obj")


def test_an_obj_whose_texture_coordinates_lack_one_is_refused(room: Path) -> None:
    obj = room / "models/lamp/meshes/lamp.obj"
    obj.write_text(re.sub(r"^(vt \d) .*$", r"\1", obj.read_text(), flags=re.MULTILINE))
    with pytest.raises(DataError, match=r"lamp\.obj"):
        load_world(room)


def test_a_missing_model_is_named(room: Path) -> None:
    shutil.rmtree(room / "models/stack")
    expect_missing(room, "model model://stack")


def test_everything_missing_is_in_one_message_and_each_thing_once(room: Path) -> None:
    shutil.rmtree(room / "models/stack")
    (room / TABLE).unlink()
    twice = "<uri>model://lamp</uri>\n      <pose>-2 2 0 0 0 0</pose>\n    </include>"
    again = f"{twice}<include><uri>model://lamp</uri><name>lamp_2</name></include>"
    damage(room, "worlds/room.world", twice, again)
    (room / "models/lamp/meshes/lamp.obj").unlink()
    expect_missing(room, "model://stack", "table.dae", "lamp.obj")
    assert len(load_world(room, lenient=True).unresolved) == 3


def test_lenient_loading_logs_what_it_skips(room: Path, caplog: pytest.LogCaptureFixture) -> None:
    (room / TABLE).unlink()
    with caplog.at_level(logging.WARNING):
        load_world(room, lenient=True)
    assert any("table.dae" in record.message for record in caplog.records)


def test_a_world_that_is_no_xml_is_refused_whatever_one_asks(room: Path) -> None:
    (room / "worlds/room.world").write_text("not <xml")
    for lenient in (False, True):
        with pytest.raises(DataError, match=r"room\.world") as error:
            load_world(room, lenient=lenient)
        assert error.value.code == "not-xml"


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("<urdf/>", "not-sdf"),
        ("<sdf/>", "not-sdf"),
        ('<sdf><world name="w"/></sdf>', "empty-world"),
    ],
)
def test_xml_that_is_no_world_is_refused(room: Path, text: str, code: str) -> None:
    (room / "worlds/room.world").write_text(text)
    with pytest.raises(DataError, match=r"room\.world") as error:
        load_world(room)
    assert error.value.code == code


def test_a_model_or_mesh_that_is_no_xml_is_listed(room: Path) -> None:
    (room / TABLE).write_text("hello")
    (room / "models/stack/model.sdf").write_text("hello")
    expect_missing(room, "table.dae", "model.sdf")


def test_a_mesh_cut_in_half_is_listed(room: Path) -> None:
    data = (room / TABLE).read_bytes()
    (room / TABLE).write_bytes(data[: len(data) // 2])
    expect_missing(room, "table.dae")


def test_geometry_that_collada_loses_is_listed(room: Path) -> None:
    damage(room, TABLE, 'url="#top-mesh"', 'url="#other"')
    expect_missing(room, "table.dae")


def test_a_picture_that_is_none_is_listed(room: Path) -> None:
    (room / "models/table/materials/textures/top.png").write_bytes(b"no picture")
    expect_missing(room, "top.png")


def test_corners_that_are_no_numbers_are_listed(room: Path) -> None:
    damage(room, "models/lamp/meshes/lamp.obj", "v 1 0 -1", "v nan 0 -1")
    expect_missing(room, "lamp.obj")


def test_a_corner_that_a_face_names_and_nobody_gives_is_listed(room: Path) -> None:
    damage(room, TABLE, "<p>0 0 1 1 2 2 3 3</p>", "<p>0 0 1 1 2 2 9 3</p>")
    expect_missing(room, "table.dae")


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ("Gazebo/Grey", "My/Marble", "material My/Marble"),
        ("<size>2 1 1</size>", "<size>2 one 1</size>", "size of box of crate/link/visual"),
        ("<size>2 1 1</size>", "<size>2 -1 1</size>", "size of box of crate/link/visual"),
        ("<size>2 1 1</size>", "<size>2 1</size>", "size of box of crate/link/visual"),
        ("0 0 0.5 0 0 0", "0 0 nan 0 0 0", "pose of crate/link"),
        ("0 0 0.5 0 0 0", "0 0 0.5", "pose crate/link"),
        ("<pose>0 0 0.5", "<pose relative_to='hall'>0 0 0.5", "crate/link relative to hall"),
        ("<scale>1 1 1</scale>", "<scale>2 1 1</scale>", "scale of crate"),
        ("<diffuse>1 0.5 0.25 1</diffuse>", "<diffuse>red</diffuse>", "diffuse of crate"),
        ("<normal>0 0 1</normal>", "<normal>0 0 0</normal>", "normal of plane"),
        ("<box><size>2 1 1</size></box>", "<heightmap/>", "<heightmap> of crate/link/visual"),
        ("<box><size>2 1 1</size></box>", "", "geometry of crate/link/visual"),
        ("model://table", "https://fuel/table", "model https://fuel/table"),
    ],
)
def test_what_sdf_says_and_we_cannot_do_is_listed(
    room: Path, old: str, new: str, word: str
) -> None:
    damage(room, "worlds/room.world", old, new)
    expect_missing(room, word)


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ("meshes/lamp.obj", "meshes/lamp.blend", "lamp.blend"),
        ("<scale>2 2 -2</scale>", "<scale>2</scale>", "scale of mesh of lamp"),
        ("<scale>", "<submesh/><scale>", "submesh of lamp"),
    ],
)
def test_what_a_model_says_and_we_cannot_do_is_listed(
    room: Path, old: str, new: str, word: str
) -> None:
    (room / "models/lamp/meshes/lamp.blend").write_text("")
    damage(room, "models/lamp/model.sdf", old, new)
    expect_missing(room, word)


def test_a_model_that_includes_itself_is_listed(room: Path) -> None:
    damage(
        room,
        "models/stack/model.sdf",
        "<pose>0 0 1",
        "<include><uri>model://stack</uri></include><pose>0 0 1",
    )
    expect_missing(room, "includes itself")


def test_a_path_without_a_world_is_refused(tmp_path: Path) -> None:
    (tmp_path / "map.png").write_bytes(b"")
    for name, code in (
        ("none.glb", "no-world"),
        (".", "not-one-world"),
        ("map.png", "not-a-world"),
    ):
        with pytest.raises(DataError) as error:
            load_world(tmp_path / name)
        assert error.value.code == code


def test_a_folder_of_several_worlds_wants_one_to_be_chosen(room: Path) -> None:
    shutil.copy(room / "worlds/room.world", room / "worlds/other.world")
    with pytest.raises(DataError) as error:
        load_world(room)
    assert error.value.fields == ("other.world", "room.world")


def test_without_pycollada_the_message_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "collada", None)
    with pytest.raises(
        FusionSlamError, match=r"fusionslam\[sim\]", check=has_code("missing-extra", "sim")
    ):
        load_world(ROOM)


def test_models_that_include_each_other_again_and_again_are_refused(
    room: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fusionslam.sim.worlds.models._MOST_MODELS", 500)
    for name in "ab":
        folder = room / "models" / name
        folder.mkdir()
        include = "".join(f"<include><uri>model://{other}</uri></include>" for other in "ab")
        (folder / "model.sdf").write_text(f"<sdf><model name='{name}'>{include}</model></sdf>")
    world = next(room.glob("*/*.world"))
    world.write_text("<sdf><world name='w'><include><uri>model://a</uri></include></world></sdf>")
    with pytest.raises(DataError, check=has_code("too-many-models")):
        load_world(room)


@pytest.mark.parametrize(
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
def test_meshes_outside_of_the_world_s_folders_are_not_read(room: Path, uri: str) -> None:
    (room.parent / "secret.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    written = uri.replace("{outside}", str(room.parent))
    damage(room, "models/table/table.sdf", "model://table/meshes/table.dae", written)
    expect_missing(room, f"mesh {written}: named by table_1/link/visual, not found")


def test_a_texture_that_lies_above_the_world_s_folders_is_not_read(room: Path) -> None:
    (room.parent / "photos").mkdir()
    (room / "models/table/materials/textures/top.png").rename(room.parent / "photos/top.png")
    expect_missing(room, "texture ../../../../photos/top.png", "table.dae")


def test_textures_and_materials_outside_of_the_world_s_folders_are_not_read(room: Path) -> None:
    (room.parent / "secret.mtl").write_text("newmtl x\nKd 1 0 0\n")
    lamp = room / "models/lamp/meshes/lamp.obj"
    text = lamp.read_text()
    for name in ("../../../../secret.mtl", str(room.parent / "secret.mtl")):
        lamp.write_text(text.replace("lamp.mtl", name))
        expect_missing(room, f"material {name}")


def test_worlds_of_too_many_triangles_are_refused(
    room: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fusionslam.sim.worlds.surfaces.MOST_TRIANGLES", 20)
    with pytest.raises(DataError, check=has_code("too-many-triangles")):
        load_world(room)
