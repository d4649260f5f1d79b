# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command line: ratslam --live."""

import json
import socket
from pathlib import Path
from typing import Any

import pytest

from cli import error_of, fails, run, succeeds
from foxglove_client import Viewer, cloud_of
from fusionslam.report.live.rerun_view import RerunView
from scenes import LAPS, write_recording

pytest.importorskip("rerun", reason="rerun is not installed")
chunks = pytest.importorskip("rerun.chunk", reason="this rerun has no reader for Python")


@pytest.fixture
def words(tmp_path: Path) -> list[Any]:
    write_recording(tmp_path / "r.npz", LAPS)
    more = ["--views", "cm2dp", "--odometry", "truth", "--no-report", "--jobs", "1"]
    more += ["--set", "recording.shapes=visual"]
    return ["ratslam", tmp_path / "r.npz", "-o", tmp_path / "out", *more]


def count(path: Path, entity: str) -> int:
    stream = chunks.RrdReader(path).store().stream()
    return sum(c.num_rows for c in stream.to_chunks() if c.entity_path == entity)


@pytest.mark.slow
def test_a_live_view_is_written_and_changes_nothing(tmp_path: Path, words: list[Any]) -> None:
    succeeds(*words)
    plain = (tmp_path / "out/map.json").read_bytes()
    succeeds(*words, "--live", tmp_path / "live.rrd")
    assert (tmp_path / "out/map.json").read_bytes() == plain
    assert count(tmp_path / "live.rrd", "/cells/sheet") == len(LAPS)
    assert count(tmp_path / "live.rrd", "/way/truth") > 0


def test_ctrl_c_keeps_map_and_live_view(
    tmp_path: Path, words: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    step, looks = RerunView.step, []

    def pressed(self: RerunView, done: Any, *more: Any) -> None:
        step(self, done, *more)
        looks.extend([done] * done.looked)
        if len(looks) == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr(RerunView, "step", pressed)
    assert run(*words, "--live", tmp_path / "live.rrd").exit_code == 130
    assert count(tmp_path / "live.rrd", "/cells/sheet") == 2
    assert (tmp_path / "out/state.npz").exists()


@pytest.mark.slow
def test_a_live_view_that_cannot_be_written_costs_no_map(
    tmp_path: Path, words: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    write = Path.write_bytes

    def full(path: Path, data: bytes) -> int:
        if "live.rrd" in path.name:
            raise OSError(28, "No space left on device")
        return write(path, data)

    monkeypatch.setattr(Path, "write_bytes", full)
    line = fails(1, *words, "--live", tmp_path / "live.rrd")
    assert "No space left on device" in line and not (tmp_path / "live.rrd").exists()
    assert json.loads((tmp_path / "out/map.json").read_text())["nodes"]


def test_mistakes_are_named(
    tmp_path: Path, words: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert ".rrd" in fails(2, *words, "--live", "view")
    monkeypatch.setattr("fusionslam.cli.failures.find_spec", lambda name: name != "rerun" or None)
    assert error_of(1, *words, "--live", "live.rrd").fields == ("live",)
    text = " ".join(run("doctor").stdout.split())
    assert "ratslam --live" in text and "pip install 'fusionslam[live]'" in text


@pytest.mark.slow
def test_foxglove_is_served_live(words: list[Any], monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("foxglove", reason="foxglove-sdk is not installed")
    from fusionslam.report.live.foxglove_view import FoxgloveView

    step, seen = FoxgloveView.step, dict[str, Any]()
    viewers: list[Viewer] = []

    def watched(self: FoxgloveView, *more: Any) -> None:
        if not viewers:
            viewers.append(Viewer(self.url))
            viewers[0].follow(self._server, "map", "cloud", "image", "views")
        step(self, *more)

    def ended(self: FoxgloveView) -> None:
        seen.update(viewers[0].receive_shown())
        self._server.close()

    monkeypatch.setattr("fusionslam.report.live.foxglove_server._WAITING", 1000)
    monkeypatch.setattr(FoxgloveView, "step", watched)
    monkeypatch.setattr(FoxgloveView, "_end", ended)
    assert "ws://127.0.0.1:" in succeeds(*words, "--live", "ws://127.0.0.1:0").stderr
    assert len(seen["views"]) == len(LAPS)
    assert [each.id for each in seen["map"][-1].entities] == ["nodes", "links", "loops"]
    assert len(cloud_of(seen["cloud"][-1])[0])


def test_a_port_in_use_and_no_address_are_named(words: list[Any]) -> None:
    pytest.importorskip("foxglove", reason="foxglove-sdk is not installed")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        line = fails(2, *words, "--live", f"ws://127.0.0.1:{port}")
    assert str(port) in line and "--live" in line
    for live in ("ws://127.0.0.1", "ws://:8765", "ws://a:port", "ws://a:1/path"):
        assert error_of(2, *words, "--live", live).fields == (live,)
