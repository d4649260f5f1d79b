# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Configuration: one definition of each value, the same in the core, Python, YAML and --set."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from pydantic import ValidationError

import fusionslam
from fusionslam import ConfigError, GroundPlaneConfig, M2dpConfig, PipelineConfig, StereoConfig
from fusionslam.config import Section, merged, walk, with_file, with_settings
from fusionslam.descriptors import DescriptorConfig, find_descriptor
from fusionslam.errors import FusionSlamError
from fusionslam.evaluation.loops.protocols import find_protocol
from fusionslam.fusion import FusionConfig, PlaneSection, StereoSection
from fusionslam.pipelines.methods import find_method
from fusionslam.sim.catalogue import check_world
from fusionslam.sim.robot import robot_named
from fusionslam.views.recognisers import find_recogniser
from rows import rows

SECTIONS: list[tuple[type[Any], type[Section]]] = [
    (M2dpConfig, type(DescriptorConfig().m2dp)),
    (StereoConfig, StereoSection),
    (GroundPlaneConfig, PlaneSection),
]
CORE_OPTIONS = [(core, section, option) for core, section in SECTIONS for option in core.options()]
NUMBERS = ("int", "float")


# The core's options and the sections made of them


def test_problems_are_told_without_the_words_of_pydantic() -> None:
    for setting in ("voxel=abc", "voxel=-1", "ground=5"):
        with pytest.raises(ConfigError) as refused:
            with_settings(FusionConfig(), [setting])
        message = str(refused.value)
        assert setting.split("=")[0] in message and "expected" in message
        assert "Input" not in message and "type=" not in message and "pydantic" not in message


@rows("core, section, option", CORE_OPTIONS)
def test_an_option_of_a_section_has_default_help_and_unit_of_the_core(
    core: type[Any], section: type[Section], option: dict[str, Any]
) -> None:
    name = option["name"]
    assert option["help"] and not option["help"].endswith(".")
    assert option["default"] == getattr(core(), name)
    if option["kind"] == "choice":
        assert option["default"] in option["choices"]
    elif option["kind"] != "bool":
        assert option["minimum"] <= option["default"] <= option["maximum"]
        assert math.isfinite(option["minimum"]) and math.isfinite(option["maximum"])
    definition = section.model_fields[name]
    # where there are presets, values come from these and none is set by default; some of the
    # ground's depend on the frame, and say so
    by_frame = core is GroundPlaneConfig and name in ("distance", "max_tilt")
    is_set = core is GroundPlaneConfig and not by_frame
    assert getattr(section(), name) == (getattr(core(), name) if is_set else None)
    said = f"; null is {option['default']} in the scan's frame (a car's), " if by_frame else ""
    assert definition.description and definition.description.startswith(option["help"] + said)
    assert by_frame or definition.description == option["help"]
    assert definition.json_schema_extra == {"unit": option["unit"]}


@rows("core, section", SECTIONS)
def test_a_section_has_the_options_of_the_core_once_and_in_order(
    core: type[Any], section: type[Section]
) -> None:
    names = [option["name"] for option in core.options()]
    assert list(section.model_fields) == names and len(set(names)) == len(names)
    with pytest.raises(ConfigError, match=r"'azimuth_count'.* \w+, \w+"):
        core(azimuth_count=3)


@rows("core, section, option", CORE_OPTIONS)
def test_wrong_values_are_refused_by_the_core_and_by_the_section(
    core: type[Any], section: type[Section], option: dict[str, Any]
) -> None:
    name = option["name"]
    wrong: list[Any] = ["certainly", [1], {"a": 1}]
    if option["kind"] in NUMBERS:
        kind, step = (int, 1) if option["kind"] == "int" else (float, 0.5)
        limits = (option["minimum"], option["maximum"])
        beyond = (kind(limits[0] - step), kind(limits[1] + step))
        # Where a step changes nothing, no number is beyond this limit.
        wrong += [True, *(value for value in beyond if value not in limits)]
    for value in wrong:
        with pytest.raises(ConfigError, match=name):
            core(**{name: value})
        with pytest.raises(ConfigError, match=name):
            merged(section(), {name: value})


def test_keyword_arguments_set_single_values() -> None:
    config = M2dpConfig(preset="author", rings=5, axis_signs="largest_entry")
    assert (config.rings, config.axis_signs, config.drop_last_point) == (5, "largest_entry", True)
    assert (M2dpConfig(preset="paper").rings, M2dpConfig(preset="paper").sectors) == (8, 16)
    stereo = StereoConfig(method="sgbm", num_disparities=128, median_blur=False, max_range=30)
    assert (stereo.method, stereo.num_disparities, stereo.median_blur) == ("sgbm", 128, False)
    assert stereo.max_range == 30.0 and stereo.block_size == StereoConfig().block_size
    assert GroundPlaneConfig(distance=0.3).distance == 0.3
    assert "rings=5" in repr(config)


def test_the_stereo_defaults_are_those_of_image_undistort() -> None:
    config = StereoConfig()
    assert (config.method, config.min_disparity, config.num_disparities) == ("bm", 0, 64)
    assert (config.block_size, config.pre_filter_size, config.pre_filter_cap) == (21, 9, 31)
    assert (config.texture_threshold, config.uniqueness_ratio) == (10, 15)
    assert (config.speckle_range, config.speckle_window_size) == (0, 0)
    assert (config.p1, config.p2, config.disp12_max_diff) == (120, 240, -1)


def test_the_sgbm_preset_follows_the_advice_of_opencv() -> None:
    config = StereoConfig(preset="sgbm")
    area = config.block_size**2
    assert config.method == "sgbm" and config.block_size < StereoConfig().block_size
    assert (config.p1, config.p2) == (8 * area, 32 * area)
    assert StereoConfig(preset="sgbm", p2=999).p2 == 999


def test_a_core_configuration_cannot_be_changed() -> None:
    with pytest.raises(AttributeError):
        M2dpConfig().rings = 3


def test_unknown_presets_and_choices_name_those_there_are() -> None:
    with pytest.raises(ConfigError, match="'best'"):
        M2dpConfig(preset="best")
    with pytest.raises(ConfigError, match=r"stereo\.method .*'magic'.* bm, sgbm"):
        StereoConfig(method="magic")


@rows(
    "find, wrong, near",
    [
        (find_descriptor, "cm2pd", "cm2dp"),
        (find_recogniser, "alignmet", "alignment"),
        (find_method, "two_stage", "two_stages"),
        (find_protocol, "revisits", "revisit"),
        (check_world, "hous", "house"),
        (robot_named, "turtlebot3_waffle", "turtlebot3_waffle_pi"),
    ],
)
def test_the_nearest_name_is_offered_whatever_registry_refuses_one(
    find: Callable[[str], object], wrong: str, near: str
) -> None:
    with pytest.raises(FusionSlamError, match=f"'{near}'"):
        find(wrong)


# The whole configuration


def test_every_option_is_listed_once_with_help() -> None:
    entries = list(walk(PipelineConfig()))
    keys = [key for key, _, _ in entries]
    assert len(set(keys)) == len(keys)
    for key in ("fusion.stereo.method", "descriptors.m2dp.rings", "loop_closure.threshold",
                "evaluation.radius", "fusion.plane.distance"):  # fmt: skip
        assert key in keys
    for key, _, definition in entries:
        assert definition.description, key
        assert set(definition.json_schema_extra or {}) == {"unit"}, key


def test_every_default_survives_yaml_and_set() -> None:
    config = PipelineConfig()
    for key, value, _ in walk(config):
        text = yaml.safe_dump(value, default_flow_style=True).removesuffix("...\n").strip()
        assert with_settings(config, [f"{key}={text}"]) == config, key
    dumped = yaml.safe_load(yaml.safe_dump(config.model_dump(mode="json")))
    assert merged(config, dumped) == config


def test_a_yaml_file_changes_what_it_names(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("fusion:\n  voxel: 0.2\n  stereo: {method: sgbm}\nloop_closure: {window: 7}\n")
    config = with_file(PipelineConfig(), path)
    assert (config.fusion.voxel, config.fusion.stereo.method) == (0.2, "sgbm")
    assert config.fusion.stereo.block_size is None and config.loop_closure.window == 7
    assert config.descriptors == PipelineConfig().descriptors
    path.write_text(yaml.safe_dump(config.model_dump(mode="json")))
    assert with_file(PipelineConfig(), path) == config
    path.write_text("")
    assert with_file(PipelineConfig(), path) == PipelineConfig()


def test_settings_change_what_they_name_in_order() -> None:
    config = with_settings(
        PipelineConfig(),
        [
            "fusion.voxel=0.5",
            "descriptors.m2dp.rings=4",
            "descriptors.normal_radius=0.7",
            "descriptors.preset=paper",
            "fusion.stereo.median_blur=false",
            "fusion.voxel=0.25",
            "fusion.up=-x",
        ],
    )
    assert (config.fusion.voxel, config.descriptors.m2dp.rings) == (0.25, 4)
    assert (config.descriptors.normal_radius, config.descriptors.preset) == (0.7, "paper")
    assert config.fusion.stereo.median_blur is False and config.fusion.up == "-x"
    config = with_settings(config, ["descriptors.normal_radius=null"])
    assert config.descriptors.normal_radius is None


@rows("text", ["2.5e-1", "25e-2", ".25E0", "2.5e-01", "0.25"])
def test_powers_of_ten_are_numbers_as_people_write_them(tmp_path: Path, text: str) -> None:
    assert from_setting(f"fusion.voxel={text}", tmp_path).fusion.voxel == 0.25
    assert from_file(f"fusion:\n  voxel: {text}\n", tmp_path).fusion.voxel == 0.25


def test_the_original_is_never_changed() -> None:
    config = PipelineConfig()
    with_settings(config, ["fusion.voxel=3"])
    assert config == PipelineConfig()
    with pytest.raises(ValidationError, match="voxel"):
        config.fusion.voxel = 3.0


def from_setting(setting: str, _: Path) -> PipelineConfig:
    return with_settings(PipelineConfig(), [setting])


def from_file(text: str, folder: Path) -> PipelineConfig:
    (folder / "wrong.yaml").write_text(text)
    return with_file(PipelineConfig(), folder / "wrong.yaml")


@rows(
    "make, text, message",
    [
        (from_setting, "fusion.voxle=1", "'fusion.voxle'.*'voxel'"),
        (from_setting, "fusoin.voxel=1", "'fusoin'.*'fusion'"),
        (from_setting, "descriptors.m2dp.ring=1", "'descriptors.m2dp.ring'.*'rings'"),
        (from_setting, "fusion.stereo.metod=bm", "'fusion.stereo.metod'.*'method'"),
        (from_setting, "quux=1", "'quux'.* fusion, descriptors"),
        (from_setting, "fusion.voxel=-1", "fusion.voxel .*-1.*0"),
        (from_setting, "fusion.voxel=.nan", "fusion.voxel .*nan"),
        (from_setting, "fusion.voxel=tall", "fusion.voxel .*'tall'"),
        (
            from_setting,
            "fusion.source=radar",
            "fusion.source .*'radar'.*'lidar', 'stereo' or 'cloud'",
        ),
        (from_setting, "fusion.stereo.block_size=1.5", "fusion.stereo.block_size .*1.5"),
        (from_setting, "fusion.stereo.median_blur=7", "fusion.stereo.median_blur .*7"),
        (from_setting, "loop_closure.window=true", "loop_closure.window .*True"),
        (from_setting, "loop_closure.threshold=.inf", "loop_closure.threshold .*inf"),
        (from_setting, "fusion=3", "fusion .*3.* source, interpolation"),
        (from_setting, "fusion.voxel", "fusion.voxel.*stage.key=value"),
        (from_setting, "fusion.voxel=[1", "fusion.voxel=.*YAML"),
        (from_setting, "fusion.up=25e", r"fusion\.up .*'25e'"),
        (from_file, "fusion: {voxle: 1}", "'fusion.voxle'.*'voxel'"),
        (from_file, "- fusion\n- voxel\n", "wrong.yaml.* list"),
        (from_file, "fusion: [1, 2]", r"fusion .*\[1, 2\]"),
        (from_file, "fusion: {voxel: 1", "wrong.yaml.*line 1"),
        (from_file, "3: 4", "'3'"),
    ],
)
def test_a_wrong_setting_or_file_names_its_key_and_what_was_expected(
    make: Callable[[str, Path], PipelineConfig], text: str, message: str, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError, match=message):
        make(text, tmp_path)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"nowhere\.yaml"):
        with_file(PipelineConfig(), tmp_path / "nowhere.yaml")


def test_a_changed_value_reaches_the_core() -> None:
    import numpy as np

    points = np.random.default_rng(0).normal(size=(200, 3)).astype(np.float32) * [5, 2, 1]
    config = with_settings(
        PipelineConfig(), ["descriptors.preset=paper", "descriptors.m2dp.rings=4"]
    )
    given = fusionslam.describe(fusionslam.Cloud(points), "m2dp", config.descriptors)
    core = M2dpConfig(preset="paper", rings=4)
    assert np.array_equal(given, fusionslam.m2dp(points, config=core))
    assert len(given) == 64 + 4 * 16


@rows(
    "make, code, fields, near",
    [
        (lambda: FusionConfig(voxl=0.2), "unknown-key", ("voxl",), "'voxel'"),
        (lambda: FusionConfig(source="sterio"), "config", ("source",), "'stereo'?"),
        (lambda: FusionConfig(voxel=-1.0), "config", ("voxel",), "at least 0"),
        (
            lambda: FusionConfig(stereo={"metod": "bm"}),
            "unknown-key",
            ("metod",),
            "stereo: .*'method'",
        ),
    ],
)
def test_a_section_made_in_python_refuses_wrong_values_with_our_error(
    make: Callable[[], Section], code: str, fields: tuple[str, ...], near: str
) -> None:
    with pytest.raises(ConfigError, match=near) as error:
        make()
    assert (error.value.code, error.value.fields) == (code, fields)
    assert "pydantic" not in str(error.value)


@rows("value", [2**63, -(2**63) - 1, 10**400])
def test_integers_beyond_64_bits_are_refused(value: int) -> None:
    with pytest.raises(ConfigError):
        fusionslam.LoopConfig(window=value)
    with pytest.raises(ConfigError):
        fusionslam.DescriptorConfig(threads=2000)
