# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""describe_dataset: the same vectors however it is run, and nothing finished is lost."""

import os
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fusionslam
from error_codes import has_code
from fusionslam import ConfigError, DataError, PipelineConfig, describe_dataset, open_dataset
from fusionslam.base.parallel import in_order
from fusionslam.config import with_settings
from fusionslam.datasets import Dataset
from fusionslam.descriptors import DESCRIPTORS, for_sequence
from fusionslam.evaluation import DescriptorRun, evaluate
from fusionslam.pipelines.describe import CHUNK, describable
from fusionslam.pipelines.recording import Recording
from fusionslam.pipelines.results import load_runs, run_path
from fusionslam.pipelines.reusable_runs import describe_recording
from kitti import write_sequence
from rows import rows
from stored import change_archive

FRAMES = CHUNK + 4
LARGEST = FRAMES - 1
NAMES = ("m2dp", "cm2dp", "cshot", "scan_context", "cscan_context", "bev_spectrum")


def scan_path(root: Path, number: int) -> Path:
    return root / f"velodyne/{number:06d}.bin"


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """A sequence of coloured stereo pairs and scans in KITTI odometry's layout."""
    counts = [900 if number == LARGEST else 600 for number in range(FRAMES)]
    return write_sequence(tmp_path, range(FRAMES), counts, metres=1, width=64)


def assert_same_vectors(a: list[DescriptorRun], b: list[DescriptorRun]) -> None:
    assert [run.descriptor for run in a] == [run.descriptor for run in b]
    for first, second in zip(a, b, strict=True):
        assert first.descriptors.tobytes() == second.descriptors.tobytes()
        assert np.array_equal(first.points, second.points)
        assert np.array_equal(first.stamps_ns, second.stamps_ns)
        assert np.array_equal(first.poses, second.poses)


def test_each_row_is_the_descriptor_of_that_frame(recording: Path, tmp_path: Path) -> None:
    dataset, out = open_dataset(recording), tmp_path / "out"
    runs = describe_dataset(dataset, NAMES, out)
    assert [run.descriptor for run in runs] == list(NAMES)
    first = fusionslam.fuse(dataset[0])
    config = for_sequence(fusionslam.DescriptorConfig(), NAMES, first)
    assert config.normal_radius == 5 * fusionslam.cloud_resolution(first.points)
    for run in runs:
        assert len(run) == FRAMES and run.source == "lidar"
        assert run.positions is not None and run.positions[:, 2].tolist() == list(range(FRAMES))
        for index in (0, CHUNK - 1, CHUNK, LARGEST):
            cloud = fusionslam.fuse(dataset[index])
            expected = fusionslam.describe(cloud, run.descriptor, config)
            assert np.array_equal(run.descriptors[index], expected)
            assert run.points[index] == len(cloud)
        assert set(run.seconds) == {"load", "fuse", "describe"}
    assert sorted(os.listdir(out)) == sorted(f"lidar-{name}.npz" for name in NAMES)
    assert_same_vectors([DescriptorRun.load(run_path(out, "lidar", name)) for name in NAMES], runs)
    assert {run.descriptor for run in load_runs(out)} == {*NAMES}


def test_one_or_two_jobs_give_the_same_vectors(recording: Path, tmp_path: Path) -> None:
    dataset = open_dataset(recording)
    one = describe_dataset(dataset, NAMES, tmp_path / "one", jobs=1)
    two = describe_dataset(dataset, NAMES, tmp_path / "two", jobs=2)
    assert_same_vectors(one, two)


def test_presets_of_one_descriptor_are_stored_side_by_side(recording: Path, tmp_path: Path) -> None:
    dataset, out = open_dataset(recording), tmp_path / "out"
    runs = describe_dataset(dataset, ("cm2dp", "cm2dp:author", "m2dp:paper", "cshot"), out)
    assert [(run.descriptor, run.preset) for run in runs] == [
        ("cm2dp", "robust"), ("cm2dp", "author"), ("m2dp", "paper"), ("cshot", None)
    ]  # fmt: skip
    assert [run.name for run in runs] == ["cm2dp", "cm2dp:author", "m2dp:paper", "cshot"]
    assert sorted(os.listdir(out)) == ["lidar-cm2dp-author.npz", "lidar-cm2dp.npz",
                                       "lidar-cshot.npz", "lidar-m2dp-paper.npz"]  # fmt: skip
    cloud = fusionslam.fuse(dataset[3])
    for run in runs[:3]:
        config = fusionslam.DescriptorConfig.model_validate({"preset": run.preset})
        expected = fusionslam.describe(cloud, run.descriptor, config)
        assert np.array_equal(run.descriptors[3], expected)
        assert np.array_equal(
            fusionslam.describe(cloud, f"{run.descriptor}:{run.preset}"), expected
        )
    assert {run.name for run in load_runs(out)} == {run.name for run in runs}


@rows("name", ["m2dp:papr", "shot:paper", "m2dp:", "m3dp:paper", "m3dp"])
def test_unknown_presets_and_descriptors_are_refused_before_anything_is_read(
    name: str, recording: Path, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError) as refused:
        describe_dataset(open_dataset(recording), ["m2dp", name], tmp_path / "out")
    assert not (tmp_path / "out").exists()
    assert "m3dp" in str(refused.value) or refused.value.fields[0] == "descriptors"


@rows("source", ["stereo", "cloud"])
def test_other_sources_are_described_too(recording: Path, tmp_path: Path, source: str) -> None:
    settings = [f"fusion.source={source}", "fusion.stereo.block_size=5",
                "fusion.stereo.num_disparities=16"]  # fmt: skip
    config = with_settings(PipelineConfig(), settings)
    (run,) = describe_dataset(open_dataset(recording), ["m2dp"], tmp_path / "out", config=config)
    assert run.source == source and run_path(tmp_path / "out", source, "m2dp").exists()
    assert run.config["fusion"]["source"] == source


class Interruption(BaseException):
    """What Ctrl-C is, without its side effects on the test runner."""


def interrupted(dataset: Dataset, out: Path, jobs: int) -> None:
    """Start, and be stopped after the first chunk."""

    def stop(done: int, total: int) -> None:
        assert (done, total) == (CHUNK, FRAMES)
        raise Interruption

    with pytest.raises(Interruption):
        describe_dataset(dataset, ("m2dp", "cm2dp"), out, jobs=jobs, progress=stop)


def spoil_unnoticed(path: Path) -> None:
    """Other bytes, but the size and time of before."""
    status = path.stat()
    path.write_bytes(b"\xff" * status.st_size)
    os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))


def test_a_file_that_changed_in_between_is_described_anew(recording: Path, tmp_path: Path) -> None:
    dataset, out = open_dataset(recording), tmp_path / "out"
    interrupted(dataset, out, 1)
    path = scan_path(recording, 3)
    path.write_bytes(path.read_bytes()[: 16 * 500])
    (resumed,) = describe_dataset(dataset, ["m2dp"], out)
    (fresh,) = describe_dataset(dataset, ["m2dp"], tmp_path / "fresh")
    assert_same_vectors([resumed], [fresh])


@pytest.mark.parametrize("jobs", [1, 2])
def test_an_interrupted_call_is_resumed(recording: Path, tmp_path: Path, jobs: int) -> None:
    dataset, out = open_dataset(recording), tmp_path / "out"
    whole = describe_dataset(dataset, ("m2dp", "cm2dp"), tmp_path / "whole")
    interrupted(dataset, out, jobs)
    assert not list(out.glob("*.npz")), "nothing half done looks finished"
    spoil_unnoticed(scan_path(recording, 3))  # a frame of the finished chunk is not read again
    calls: list[tuple[int, int]] = []
    names = ("m2dp", "cm2dp")
    resumed = describe_dataset(dataset, names, out, jobs=jobs, progress=lambda *c: calls.append(c))
    assert calls == [(CHUNK, FRAMES), (FRAMES, FRAMES)]
    assert_same_vectors(whole, resumed)
    assert sorted(os.listdir(out)) == ["lidar-cm2dp.npz", "lidar-m2dp.npz"]


def test_another_configuration_begins_anew(recording: Path, tmp_path: Path) -> None:
    dataset, out = open_dataset(recording), tmp_path / "out"
    interrupted(dataset, out, 1)
    config = with_settings(PipelineConfig(), ["descriptors.preset=author"])
    (author,) = describe_dataset(dataset, ["m2dp"], out, config=config)
    (fresh,) = describe_dataset(dataset, ["m2dp"], tmp_path / "fresh", config=config)
    assert_same_vectors([author], [fresh])


ONE_POINT = np.array([[5, 0, 0, 1]] * 9, np.float32).tobytes()


@rows(
    "content, number, jobs",
    [
        *((ONE_POINT, number, jobs) for number in (5, CHUNK + 1) for jobs in (1, 2)),
        (bytes(33), 2, 1),  # cannot even be read
    ],
)
def test_a_frame_that_cannot_be_described_is_named_and_the_rest_is_kept(
    recording: Path, tmp_path: Path, content: bytes, number: int, jobs: int
) -> None:
    dataset, out = open_dataset(recording), tmp_path / "out"
    good = scan_path(recording, number).read_bytes()
    scan_path(recording, number).write_bytes(content)
    with pytest.raises(DataError, match=rf"03, \w+ {number}\b.*{number:06d}\.bin"):
        describe_dataset(dataset, ["m2dp"], out, jobs=jobs)
    assert bool(list(out.glob(".partial-*/000000.npz"))) == (number > CHUNK)
    scan_path(recording, number).write_bytes(good)
    mended = describe_dataset(dataset, ["m2dp"], out, jobs=jobs)
    assert_same_vectors(mended, describe_dataset(dataset, ["m2dp"], tmp_path / "whole"))


@rows("damage", ["cut", "encrypted", "other frames", "of a former version"])
def test_frames_of_a_damaged_file_are_described_again(
    recording: Path, tmp_path: Path, damage: str, caplog: pytest.LogCaptureFixture
) -> None:
    dataset, out = open_dataset(recording), tmp_path / "out"
    whole = describe_dataset(dataset, ("m2dp", "cm2dp"), tmp_path / "whole")
    interrupted(dataset, out, 1)
    (chunk,) = out.glob(".partial-*/000000.npz")
    content = bytearray(chunk.read_bytes())
    if damage == "cut":
        chunk.write_bytes(content[: len(content) // 2])
    elif damage == "encrypted":
        content[content.index(b"PK\x01\x02") + 8] |= 1
        chunk.write_bytes(content)
    elif damage == "other frames":
        change_archive(chunk, lambda _, arrays: arrays.update(rows=arrays["rows"] + 1))
    else:
        with np.load(chunk) as stored:
            np.savez(chunk, **{name: stored[name] for name in stored.files if name != "about"})
    assert_same_vectors(whole, describe_dataset(dataset, ("m2dp", "cm2dp"), out))
    assert ("000000.npz" in caplog.text) == (damage != "other frames")


def test_unusable_folders_are_named(recording: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(DataError, check=has_code("cannot-write")):
        describe_dataset(open_dataset(recording), ["m2dp"], tmp_path / "file" / "out")
    with pytest.raises(DataError, check=has_code("no-runs")):
        load_runs(tmp_path)


def test_scan_context_is_left_out_of_others_where_z_is_not_up(
    recording: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    dataset = open_dataset(recording)
    names, config = ["m2dp", "scan_context"], PipelineConfig()
    assert describable(dataset, names, config) == names
    assert not caplog.records
    ahead = with_settings(config, ["fusion.frame=camera"])
    assert describable(dataset, names, ahead) == ["m2dp"]
    assert "scan_context" in caplog.text
    assert describable(dataset, names[1:], ahead) == names[1:]
    with pytest.raises(ConfigError, check=has_code("not-up", "fusion.frame", "camera")):
        describe_dataset(dataset, names, tmp_path / "out", config=ahead)


def test_a_run_is_made_again_only_for_options_of_its_own_descriptor(
    recording: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    data, names = Recording.at(recording), ["m2dp", "cm2dp", "scan_context"]

    def describe_again(*settings: str) -> str:
        caplog.clear()
        config = with_settings(PipelineConfig(), list(settings))
        describe_recording(data, data.open("lidar"), tmp_path / "out", names, config=config)
        return caplog.text

    describe_again()
    assert "replaced" not in describe_again()
    for settings, replaced in [
        (["descriptors.scan_context.height=1.0"], {"scan_context"}),
        (["descriptors.scan_context.height=1.0", "descriptors.color_space=lab"], {"cm2dp"}),
    ]:
        said = describe_again(*settings)
        assert {name for name in names if f"lidar-{name}.npz is replaced" in said} == replaced


def make_bad(recording: Path) -> None:
    """An empty scan, one of NaN, one that is cut: the first frame, one in between, the last."""
    scan_path(recording, 0).write_bytes(b"")
    np.full((9, 4), np.nan, np.float32).tofile(scan_path(recording, 5))
    scan_path(recording, LARGEST).write_bytes(bytes(33))


@pytest.mark.parametrize("jobs", [1, 2])
def test_frames_that_cannot_be_described_are_left_out_on_request(
    recording: Path, tmp_path: Path, jobs: int, caplog: pytest.LogCaptureFixture
) -> None:
    whole = describe_dataset(open_dataset(recording), ["m2dp"], tmp_path / "whole")[0]
    make_bad(recording)
    dataset, out = open_dataset(recording), tmp_path / "out"
    with pytest.raises(DataError, match=r"03, \w+ 0 \(.*000000\.bin\): "):
        describe_dataset(dataset, ["m2dp"], out, jobs=jobs)
    (run,) = describe_dataset(dataset, ["m2dp"], out, jobs=jobs, bad_frames="skip")
    assert list(run.skipped) == [0, 5, LARGEST] and "000019.bin" in run.skipped[LARGEST]
    assert all(f"frame {number} left out" in caplog.text for number in run.skipped)
    left = [n for n in range(FRAMES) if n not in run.skipped]
    assert run.numbers.tolist() == run.frames.tolist() == left
    assert np.array_equal(run.descriptors, whole.descriptors[left])
    assert np.array_equal(run.stamps_ns, whole.stamps_ns[left])
    assert np.array_equal(run.poses, whole.poses[left])
    assert DescriptorRun.load(run_path(out, "lidar", "m2dp")).skipped == run.skipped


def test_normals_take_the_radius_of_the_first_good_frame(recording: Path, tmp_path: Path) -> None:
    for first in (0, 1):
        dataset, out = open_dataset(recording), tmp_path / f"out-{first}"
        (run,) = describe_dataset(dataset, ["shot"], out, bad_frames="skip")
        radius = 5 * fusionslam.cloud_resolution(fusionslam.fuse(dataset[first]).points)
        assert run.config["descriptors"]["normal_radius"] == pytest.approx(radius)
        make_bad(recording)


def test_a_recording_without_a_usable_frame_is_refused(recording: Path, tmp_path: Path) -> None:
    for number in range(FRAMES):
        scan_path(recording, number).write_bytes(b"")
    dataset = open_dataset(recording)
    for name in ("m2dp", "shot"):
        with pytest.raises(DataError, check=has_code("no-frame")):
            describe_dataset(dataset, [name], tmp_path / "out", bad_frames="skip")
    with pytest.raises(ConfigError, check=has_code("choice", "bad_frames", "skp")):
        describe_dataset(dataset, ["m2dp"], tmp_path / "out", bad_frames="skp")


def test_a_finished_run_removes_the_rest_of_other_settings(recording: Path, tmp_path: Path) -> None:
    dataset, out = open_dataset(recording), tmp_path / "out"
    interrupted(dataset, out, 1)
    describe_dataset(dataset, ["m2dp"], out)
    assert len(list(out.glob(".partial-*"))) == 1, "work on two descriptors may be taken up"
    config = with_settings(PipelineConfig(), ["descriptors.preset=author"])
    describe_dataset(dataset, ("m2dp", "cm2dp"), out, config=config)
    assert not list(out.glob(".partial-*"))


def test_every_descriptor_fits_into_the_names_of_files(recording: Path, tmp_path: Path) -> None:
    dataset, out = open_dataset(recording), tmp_path / "out"
    config = PipelineConfig(fusion=fusionslam.FusionConfig(source="cloud"))
    names = describable(dataset, tuple(DESCRIPTORS), config)
    # Few random points have no regions and no full cells. That costs the others nothing.
    with pytest.raises(DataError, match=r"CVFH|ndt_histogram"):
        describe_dataset(dataset, names, out, config=config)
    runs = describe_dataset(dataset, names, out, config=config, bad_frames="skip")
    assert [run.descriptor for run in runs] == names
    assert not list(out.glob(".partial-*"))
    for run in runs:
        assert len(run) == FRAMES and not run.skipped
        assert run.descriptors.any() == (run.metric != "regions") or "ndt" in run.descriptor
        assert evaluate(run, window=2).curves["revisit"].n_queries == FRAMES


def test_only_so_many_items_are_begun_before_they_are_asked_for() -> None:
    class Eager(ThreadPoolExecutor):
        """Does everything at once, in the order in which it is handed in."""

        def submit(self, work: Any, *items: Any) -> Future[Any]:  # type: ignore[override]
            begun.extend(items)
            done: Future[Any] = Future()
            done.set_result(work(*items))
            return done

    begun: list[int] = []
    with Eager(1) as pool:
        results = in_order(pool, lambda item: 2 * item, range(100), 8)
        assert [next(results) for _ in range(3)] == [0, 2, 4]
        assert begun == list(range(2 + 8))
        assert list(results) == [2 * item for item in range(3, 100)]
