# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The index of a database of places: its recall is measured, and nothing is lost by it."""

from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.neighbors import NearestNeighbors

from artefacts import artefact, copy_artefact
from error_codes import has_code
from fleet_places import (
    LENGTH,
    NUMBERS,
    SEGMENT_ROWS,
    SETTINGS,
    VECTORS,
    made_places,
    made_segment,
    made_vectors,
)
from fusionslam.base.archive import dump_sealed
from fusionslam.base.arrays import Floats32
from fusionslam.errors import DataError
from fusionslam.fleet import vector_index
from fusionslam.fleet.place_database import PlaceDatabase
from fusionslam.fleet.places import PlaceFilter, Places
from fusionslam.fleet.row_search import Search
from fusionslam.fleet.segment import Segment, delete_segments, digest_of, size_of
from fusionslam.fleet.vector_index import IndexReport, Kind, write_report
from fuzz.bit_flips import flipped
from fuzz.crafted_files import HEADERS, with_header
from rows import rows

pytest.importorskip("lancedb", reason="the table of places is an extra")

COUNT = 8_000


def many_places() -> Places:
    """Places of eighty recordings by eight robots."""
    sessions = np.arange(COUNT) // 100
    return replace(
        made_places("all", COUNT),
        session=[f"s{session}" for session in sessions],
        robot=[f"r{session % 8}" for session in sessions],
    )


PARTITIONS: dict[Kind, int] = {"faiss": 89, "lance": 10}


@pytest.fixture(scope="module", params=PARTITIONS)
def kind(request: pytest.FixtureRequest) -> Kind:
    """Whose index."""
    found: Kind = request.param
    return found


mostly_faiss = pytest.mark.parametrize(
    "kind", ["faiss", pytest.param("lance", marks=pytest.mark.nightly)], indirect=True
)


def database_of(name: str, make: Callable[[], Places], kind: Kind = "faiss") -> Path:
    """A database of places with an index, which tests copy or only read."""

    def build(folder: Path) -> None:
        with PlaceDatabase.create(folder / "database", SETTINGS) as database:
            database.add(make())
            database.build_index(kind=kind)

    return artefact(name, build) / "database"


@pytest.fixture(scope="module")
def built(kind: Kind) -> Path:
    return database_of(f"places-of-{kind}", many_places, kind)


@pytest.fixture
def indexed(built: Path, tmp_path: Path) -> Iterator[PlaceDatabase]:
    with PlaceDatabase.open(copy_artefact(built, tmp_path / "database")) as database:
        yield database


@pytest.fixture(scope="module")
def segment() -> Path:
    """A smaller one, with an index of FAISS."""
    return database_of("places-of-a-segment", lambda: made_places("all", 5000))


@pytest.fixture
def segmented(segment: Path, tmp_path: Path) -> Iterator[PlaceDatabase]:
    with PlaceDatabase.open(copy_artefact(segment, tmp_path / "database")) as database:
        yield database


def share_found(database: PlaceDatabase, vectors: Floats32, k: int) -> float:
    """Of the nearest places by comparing all, the share that the index finds."""
    found = database.query(vectors, k=k)
    right = database.query(vectors, k=k, exact=True)
    assert [len(row) for row in found] == [len(row) for row in right]
    pairs = zip(found, right, strict=True)
    same = [len({x.key for x in a} & {x.key for x in b}) / len(b) for a, b in pairs]
    return float(np.mean(same))


def queries(count: int = 50) -> Floats32:
    """Stored vectors from all over with a little noise."""
    rng = np.random.default_rng(3)
    rows = made_vectors(COUNT)[rng.choice(COUNT, count, replace=False)]
    return (rows + 0.1 * rng.standard_normal(rows.shape)).astype(np.float32)


def test_the_report_tells_the_recall_that_scikit_learn_confirms(built: Path, kind: Kind) -> None:
    with PlaceDatabase.open(built, read_only=True) as database:
        report = database.index
        assert report is not None
        assert (report.rows, report.kind, report.partitions) == (COUNT, kind, PARTITIONS[kind])
        assert (report.queries, report.first) == (200, 1.0)
        assert report.recall >= 0.99
        peer = NearestNeighbors(n_neighbors=10, algorithm="brute").fit(made_vectors(COUNT))
        found = database.query(queries(), k=10)
    distances, rows = peer.kneighbors(queries())
    true = [{f"all:{row}" for row in some} for some in rows.tolist()]
    right = [len(keys & {one.key for one in row}) for keys, row in zip(true, found, strict=True)]
    assert np.mean(right) >= 9.9
    assert_allclose([row[0].distance for row in found], distances[:, 0], rtol=1e-4)


@mostly_faiss
def test_one_query_answers_as_many_do(built: Path) -> None:
    with PlaceDatabase.open(built, read_only=True) as database:
        together = database.query(queries(40), k=3)
        alone = [database.query(query, k=3)[0] for query in queries(40)]
        exact = database.query(queries(40), k=3, exact=True)
    keys = [row[0].key for row in together]
    assert [row[0].key for row in alone] == [row[0].key for row in exact] == keys


def test_places_of_a_filter_are_found_behind_others(
    built: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for few in (0, 20_000):  # with the index, and without
        monkeypatch.setattr("fusionslam.fleet.vector_index.FEWEST_ROWS", few)
        with PlaceDatabase.open(built, read_only=True) as database:
            where = PlaceFilter(session="s3")
            found = database.query(queries(3), k=100, where=where)
            assert [len(row) for row in found] == [100] * 3
            assert {one.session for row in found for one in row} == {"s3"}
            robot = PlaceFilter(robot="r5")
            rows = np.flatnonzero(np.arange(COUNT) // 100 % 8 == 5)
            peer = NearestNeighbors(n_neighbors=1, algorithm="brute")
            distances, _ = peer.fit(made_vectors(COUNT)[rows]).kneighbors(queries(20))
            nearest = [row[0].distance for row in database.query(queries(20), k=10, where=robot)]
            assert_allclose(nearest, distances[:, 0], rtol=1e-4)


def test_places_that_are_not_in_the_index_yet_are_found(indexed: PlaceDatabase) -> None:
    indexed.add(made_places("new", 60, seed=8))
    found = indexed.query(made_vectors(60, seed=8), k=1)
    assert [row[0].key for row in found] == [f"new:{row}" for row in range(60)]


@mostly_faiss
def test_deleted_places_are_not_found_by_the_index(indexed: PlaceDatabase) -> None:
    with PlaceDatabase.open(indexed.location, read_only=True) as reader:
        reader.query(queries(2))
        assert indexed.delete(PlaceFilter(robot="r2")) == COUNT // 8
        for _ in range(2):
            for database in (reader, indexed):
                rows = database.query(queries(30), k=50)
                assert "r2" not in {one.robot for row in rows for one in row}
                assert database.query(queries(1), where=PlaceFilter(robot="r2")) == [[]]
            indexed.compact(keep_s=0)


def test_a_database_that_was_emptied_takes_places_again(indexed: PlaceDatabase) -> None:
    assert indexed.delete(PlaceFilter(until_ns=10**18)) == COUNT
    indexed.compact(keep_s=0)
    assert indexed.query(queries(2), k=5) == [[], []]
    indexed.add(made_places("new", 20, seed=8))
    indexed.compact(keep_s=0)
    assert [len(row) for row in indexed.query(queries(2), k=30)] == [20, 20]


@mostly_faiss
def test_compaction_puts_new_places_into_the_index(indexed: PlaceDatabase) -> None:
    for day in range(4):
        indexed.add(made_places(f"day{day}", 200, seed=20 + day))
    indexed.compact()
    report = indexed.index
    assert report is not None
    assert (report.rows, report.first, report.last_row) == (COUNT + 800, 1.0, COUNT + 799)
    found = indexed.query(made_vectors(200, seed=22), k=1)
    assert [row[0].key for row in found] == [f"day2:{row}" for row in range(200)]
    indexed.compact()
    assert indexed.index == report  # nothing was to be done


@mostly_faiss
def test_an_unmeasured_index_is_searched_with_care(indexed: PlaceDatabase, kind: Kind) -> None:
    before = [row[0].key for row in indexed.query(queries())]
    assert indexed.index is not None
    write_report(indexed._table, replace(indexed.index, index="0123456789abcdef.faiss", rows=1))
    usual = vector_index.look_up(indexed._table, indexed.location, None).usual
    assert usual is None if kind == "faiss" else usual is not None and usual.candidates == 400
    after = [row[0].key for row in indexed.query(queries())]
    assert np.mean([one == other for one, other in zip(before, after, strict=True)]) >= 0.9
    indexed.compact()
    assert indexed.index is not None
    assert indexed.index.first == 1.0
    assert indexed.index.index != "0123456789abcdef.faiss"


def test_a_small_database_needs_no_index(tmp_path: Path) -> None:
    with PlaceDatabase.create(tmp_path / "small", SETTINGS) as database:
        database.add(made_places("one", 100))
        report = database.build_index()
        assert (report.rows, report.kind, report.recall) == (100, "exact", 1.0)
        assert database.index is None


@mostly_faiss
def test_an_index_is_built_anew(indexed: PlaceDatabase, kind: Kind) -> None:
    steps: list[str] = []
    indexed.add(made_places("more", 4000, seed=5))
    report = indexed.build_index(recall=0.9, kind=kind, progress=steps.append)
    assert isinstance(report, IndexReport)
    assert (report.rows, report.partitions) == (COUNT + 4000, {"faiss": 109, "lance": 15}[kind])
    assert indexed.index == report
    assert len(steps) > 3


def test_a_damaged_index_of_lance_is_named(segmented: PlaceDatabase) -> None:
    segmented.build_index(kind="lance")
    for path in (Path(segmented.location) / "places.lance" / "_indices").rglob("*.idx"):
        path.write_bytes(path.read_bytes()[:100])
    with (
        PlaceDatabase.open(segmented.location, read_only=True) as reader,
        pytest.raises(DataError, check=has_code("damaged", segmented.location)),
    ):
        reader.query(np.zeros(LENGTH))


@rows("suffix", [".faiss", ".npy"])
def test_a_flipped_bit_of_a_segment_is_found_before_it_is_parsed(
    tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = made_segment(tmp_path)
    digest, file = digest_of(path), path.with_suffix(suffix)
    content = file.read_bytes()
    with monkeypatch.context() as patched:
        patched.setattr(np, "load", None)
        for place in np.linspace(0, len(content) - 1, 9).astype(int).tolist():
            file.write_bytes(flipped(content, 8 * place + place % 8))
            with pytest.raises(DataError, check=has_code("damaged", path)):
                Segment(path, digest)
    file.write_bytes(content)
    assert len(Segment(path, digest)) == SEGMENT_ROWS


@rows("header", HEADERS)
def test_headers_that_fit_a_forged_digest_are_refused_by_type(
    tmp_path: Path, header: bytes
) -> None:
    path = made_segment(tmp_path)
    file = path.with_suffix(".npy")
    file.write_bytes(with_header(file.read_bytes(), header))
    with pytest.raises(DataError, check=has_code("damaged", path)):
        Segment(path, digest_of(path))


def test_a_report_of_another_file_is_no_report(
    segmented: PlaceDatabase, caplog: pytest.LogCaptureFixture
) -> None:
    assert segmented.index is not None
    report = asdict(segmented.index)
    texts = [dump_sealed(report).replace('"nprobes": ', '"nprobes": 1')]
    for index in ("../../victim.faiss", "/etc/x.faiss", "x.faiss", "", "0" * 16):
        texts.append(dump_sealed(report | {"index": index}))
    for text in texts:
        caplog.clear()
        with segmented._writing() as table:
            about = {"fusionslam.index": text}
            table.update_field_metadata({"path": "vector", "metadata": about})
        assert segmented.index is None and "report of an index" in caplog.text
    assert share_found(segmented, queries(5), 5) == 1


@rows("left", [None, 0, -1])
def test_without_a_whole_segment_all_places_are_compared(
    segment: Path, tmp_path: Path, left: int | None, caplog: pytest.LogCaptureFixture
) -> None:
    with PlaceDatabase.open(copy_artefact(segment, tmp_path / "database")) as database:
        assert database.index is not None
        name = database.index.index
        path = tmp_path / "database/segments" / name
        content = path.read_bytes()
        path.unlink()
        if left is not None:
            path.write_bytes(content[:left])
        with PlaceDatabase.open(database.location, read_only=True) as reader:
            assert share_found(reader, queries(), 5) == 1
        assert name in caplog.text
        if left is None:
            database.compact()  # builds anew what is gone
        else:
            database.build_index()
        assert database.index.first == 1.0
        assert {one.stem for one in path.parent.iterdir()} == {Path(database.index.index).stem}


def test_a_database_that_has_become_small_has_no_index(segmented: PlaceDatabase) -> None:
    segmented.delete(PlaceFilter(session="all"))
    segmented.add(made_places("few", 30, seed=4))
    segmented.compact(keep_s=0)
    assert segmented.index is not None and segmented.index.kind == "exact"
    assert not [*(Path(segmented.location) / "segments").iterdir()]
    found = segmented.query(made_vectors(3, seed=4))
    assert [row[0].key for row in found] == [f"few:{row}" for row in range(3)]
    segmented.add(made_places("more", 6000, seed=6))
    assert segmented.build_index().kind == "faiss"


def test_more_neighbours_are_found_in_more_lists(segmented: PlaceDatabase) -> None:
    for k in (100, 1000, 6000):
        assert len(segmented.query(made_vectors(1), k=k)[0]) == min(k, 5000)
        assert share_found(segmented, made_vectors(2), k) >= 0.98


def test_what_changes_while_a_reader_looks_is_looked_up_again(
    segmented: PlaceDatabase, monkeypatch: pytest.MonkeyPatch
) -> None:
    read, done = vector_index.read_report, list[IndexReport]()

    def read_late(table: object) -> IndexReport | None:
        found = read(table)
        if not done:
            done.append(segmented.build_index())
            assert len(reader) == 5000  # another thread's, which moves the table on
        return found

    with PlaceDatabase.open(segmented.location, read_only=True) as reader:
        monkeypatch.setattr(vector_index, "read_report", read_late)
        for _ in range(2):
            reader.query(made_vectors(1))
        assert reader._lookup is not None and reader._lookup.usual is not None


@mostly_faiss
def test_more_later_places_than_memory_should_hold_are_found(
    indexed: PlaceDatabase, monkeypatch: pytest.MonkeyPatch
) -> None:
    indexed.add(made_places("new", 60, seed=8))
    where = PlaceFilter(until_ns=10**18)
    expected = [
        indexed.query(made_vectors(60, seed=8), k=3, where=one, exact=True) for one in (None, where)
    ]
    monkeypatch.setattr("fusionslam.fleet.vector_index.FEWEST_ROWS", 0)
    for most in (20_000, 10):
        monkeypatch.setattr("fusionslam.fleet.row_search._LATER", most)
        with PlaceDatabase.open(indexed.location, read_only=True) as reader:
            for one, right in zip((None, where), expected, strict=True):
                found = reader.query(made_vectors(60, seed=8), k=3, where=one)
                assert [row[0].key for row in found] == [row[0].key for row in right]
                assert found[0][0].key == "new:0"


@mostly_faiss
def test_a_segment_knows_which_rows_are_gone_from_it(indexed: PlaceDatabase) -> None:
    """Each robot's places are near each other: without them, as many others have to be found."""
    with PlaceDatabase.open(indexed.location, read_only=True) as reader:
        for robot in ("r1", "r2", "r3"):
            indexed.delete(PlaceFilter(robot=robot))
            indexed.add(made_places(f"after {robot}", 10, seed=9))
            assert len(reader.query(queries(1), k=20)[0]) == 20
            assert share_found(reader, queries(20), 20) >= 0.95


def choose(
    shares: dict[int, tuple[float, float]], recall: float = 0.99, fewest: int = 0
) -> tuple[int, int]:
    """What is chosen if so many lists give these shares, and fewer rows than some too little."""

    def measured(search: Search) -> tuple[float, float]:
        if search.candidates < fewest:
            return 0.1, 0.1
        return shares[max((n for n in shares if n <= search.nprobes), default=0)]

    search, _ = vector_index._choose(16, recall, measured, lambda text: None)
    return search.nprobes, search.candidates


NOTHING = {0: (0.5, 0.5)}


def test_twice_the_lists_that_reach_the_recall_are_searched() -> None:
    assert choose(NOTHING | {4: (0.99, 1.0)}) == (8, 30)
    assert choose(NOTHING | {2: (0.999, 0.99), 3: (0.995, 1.0)}) == (6, 30)
    assert choose(NOTHING | {32: (1.0, 1.0)}) == (32, 30)


def test_as_few_rows_are_compared_exactly_as_do() -> None:
    assert choose(NOTHING | {4: (0.99, 1.0)}, fewest=31) == (8, 100)
    assert choose(NOTHING | {4: (0.99, 1.0)}, fewest=101) == (8, 400)


def test_without_the_recall_the_best_is_chosen() -> None:
    assert choose({0: (0.5, 0.5), 4: (0.97, 1.0), 9: (0.98, 1.0), 32: (0.9, 1.0)}) == (9, 30)


def test_rows_are_found_by_their_numbers_with_their_vectors(tmp_path: Path) -> None:
    path = made_segment(tmp_path / "segments")
    segment = Segment(path, digest_of(path))
    assert (len(segment), segment.lists) == (SEGMENT_ROWS, 77)
    assert_array_equal(segment.vectors[NUMBERS], VECTORS)
    assert not segment.vectors[1000:1500].any()
    queries = VECTORS[::300]
    peer = NearestNeighbors(n_neighbors=5, algorithm="brute").fit(VECTORS)
    near = NUMBERS[peer.kneighbors(queries, return_distance=False)]
    found = segment.search(queries, segment.lists, 30, None)
    assert all(set(right) <= set(some) for right, some in zip(near, found, strict=True))
    numbers = np.arange(NUMBERS[-1] + 1)
    found = segment.search(queries, segment.lists, 30, numbers % 2 == 1)
    assert (found % 2 == 1).all()
    (few,) = segment.search(queries[:1], segment.lists, 30, numbers < 3)
    assert_array_equal(np.sort(few[few >= 0]), [0, 1, 2])


def test_all_segments_but_one_are_deleted(tmp_path: Path) -> None:
    first, second = made_segment(tmp_path), made_segment(tmp_path)
    delete_segments(tmp_path, but=second.name)
    assert not first.exists() and size_of(second)
    delete_segments(tmp_path, but="")
    assert not [*tmp_path.iterdir()]
