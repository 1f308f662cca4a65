"""Cached results: bit-identical, found by content, not trusted if damaged, and bounded in size."""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays_of
from numpy.typing import NDArray

from rigctl.engine.result_cache import RESULTS_VARIABLE, TALLY, Opaque, Store, cached, digest, switched_off
from rigctl.engine.result_cache.coding import Damaged, decode, encode
from systems import needs_posix

Floats = NDArray[np.float64]


class Ending(StrEnum):
    COST = "cost"
    STEP = "step"


@dataclass(frozen=True)
class Inner:
    name: str
    value: float
    lower: float | None = None


@dataclass(frozen=True)
class Outcome:
    values: Floats
    own: tuple[Floats, ...]
    marks: NDArray[np.bool_]
    inner: Inner | None
    pairs: tuple[tuple[str, float], ...]
    by_name: Mapping[str, Inner]
    ending: Ending
    kind: Literal["quiet", "rig"]
    count: int
    flag: bool


def outcome() -> Outcome:
    return Outcome(
        values=np.array([0.1, -0.0, np.nan, np.inf]),
        own=(np.array([[1.0, 2.0], [3.0, 4.0]], order="F")[:, :1], np.empty(0)),
        marks=np.array([True, False]),
        inner=Inner("a", 1e-300),
        pairs=(("x", 0.5), ("y", -2.0)),
        by_name={"b": Inner("b", 3.0, 1.0)},
        ending=Ending.STEP,
        kind="rig",
        count=7,
        flag=True,
    )


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(RESULTS_VARIABLE, str(tmp_path / "results"))
    return tmp_path / "results"


def make(log: list[str]) -> Outcome:
    log.append("made")
    return outcome()


def same(one: Outcome, other: Outcome) -> bool:
    return digest(one) == digest(other)


def only_file(folder: Path) -> Path:
    (path,) = folder.iterdir()
    return path


def test_a_result_is_computed_once_and_bit_identical(folder: Path) -> None:
    log: list[str] = []
    before = replace(TALLY)
    first = cached("test", [1.0, "a"], Outcome, lambda: make(log))
    second = cached("test", [1.0, "a"], Outcome, lambda: make(log))
    with switched_off():
        third = cached("test", [1.0, "a"], Outcome, lambda: make(log))
    assert log == ["made", "made"]
    assert same(first, second)
    assert same(first, third)
    assert (TALLY.made - before.made, TALLY.reused - before.reused) == (1, 1)
    for one in (first, second, third):  # the memory layout influences the rounding of sums
        assert all(array.flags.c_contiguous and array.flags.owndata for array in (one.values, *one.own))
        assert type(one.inner) is Inner
        assert one.ending is Ending.STEP


@needs_posix("permissions of POSIX")
def test_a_result_that_others_could_have_written_is_not_believed(folder: Path) -> None:
    """A noise of eight times the size, in a folder of a group, used to change a verdict."""
    log: list[str] = []
    cached("test", [1.0], Outcome, lambda: make(log))
    folder.chmod(0o777)
    cached("test", [1.0], Outcome, lambda: make(log))
    assert (log, folder.stat().st_mode & 0o022) == (["made"], 0)
    only_file(folder).chmod(0o666)
    cached("test", [1.0], Outcome, lambda: make(log))
    assert log == ["made", "made"]
    assert only_file(folder).stat().st_mode & 0o022 == 0


def test_the_cache_can_be_disabled(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(RESULTS_VARIABLE, "off")
    monkeypatch.chdir(tmp_path)
    assert same(cached("test", 1, Outcome, outcome), outcome())
    assert not list(tmp_path.iterdir())


def test_values_without_a_content_key_are_not_cached(folder: Path) -> None:
    log: list[str] = []
    for _ in range(2):
        cached("test", [make], Outcome, lambda: make(log))
    assert log == ["made", "made"]
    assert not folder.exists()


def test_failures_are_not_cached(folder: Path) -> None:
    def fail() -> Outcome:
        raise ValueError("no fit")

    for _ in range(2):
        with pytest.raises(ValueError, match="no fit"):
            cached("test", 1, Outcome, fail)
    assert not folder.exists()


DIFFERENT: tuple[Any, ...] = (
    0.0,
    -0.0,
    0,
    False,
    None,
    "0",
    "",
    (),
    ("",),
    ("a", "b"),
    ("ab",),
    ("a", ("b",)),
    {},
    {"a": 1},
    {"a": 1.0},
    np.zeros(2),
    np.zeros((2, 1)),
    np.zeros(2, dtype=np.int64),
    np.array([0.0, -0.0]),
    Ending.COST,
    "cost ",
    Inner("a", 1.0),
    Inner("a", 1.0, 1.0),
    ["a", 1.0, None, 2],
)


def test_different_values_have_different_digests() -> None:
    assert len({digest(value) for value in DIFFERENT}) == len(DIFFERENT)
    assert digest(np.asfortranarray(np.ones((3, 2)))) == digest(np.ones((3, 2)))
    assert digest(np.float64(0.5), np.nan) == digest(0.5, float("nan"))
    for opaque in (make, object(), Path(), np.array(["text"]), Inner):
        with pytest.raises(Opaque):
            digest({"a": [opaque]})


plain = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=3),
    lambda inner: (
        st.lists(inner, max_size=3).map(tuple) | st.dictionaries(st.text(max_size=2), inner, max_size=2)
    ),
    max_leaves=6,
)


@settings(max_examples=50)
@given(plain, plain)
def test_digests_are_equal_exactly_for_equal_values(one: Any, other: Any) -> None:
    # pickles of different values differ; JSON does not distinguish 1 and True, 0.0 and -0.0, or NaN
    assert (digest(one) == digest(other)) == (
        pickle.dumps(one) == pickle.dumps(other) or repr(one) == repr(other)
    )


@given(
    arrays_of.arrays(np.float64, arrays_of.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4)),
    st.floats(),
    st.text(max_size=5),
)
def test_numbers_and_text_survive_encoding(array: Floats, number: float, word: str) -> None:
    before = replace(outcome(), values=array, inner=Inner(word, number))
    arrays: list[np.ndarray] = []
    tree = json.loads(json.dumps(encode(before, arrays)))
    assert same(decode(Outcome, tree, iter(arrays)), before)


def flip(path: Path, place: int) -> None:
    content = bytearray(path.read_bytes())
    content[place] ^= 0x40
    path.write_bytes(bytes(content))


def test_every_damaged_byte_is_detected_or_harmless(folder: Path) -> None:
    cached("test", 1, Outcome, outcome)
    whole = only_file(folder).read_bytes()
    log: list[str] = []
    for place in range(0, len(whole), 7):
        only_file(folder).write_bytes(whole)
        flip(only_file(folder), place)
        assert same(cached("test", 1, Outcome, lambda: make(log)), outcome())
    assert len(log) > len(whole) / 7 / 2
    for size in (0, 1, 100, len(whole) - 1):
        only_file(folder).write_bytes(whole[:size])
        assert same(cached("test", 1, Outcome, outcome), outcome())
    assert only_file(folder).read_bytes() == whole


class Bomb:
    def __reduce__(self) -> tuple[Any, tuple[str]]:
        return os.mkdir, ("carried-out",)


def test_foreign_files_are_neither_executed_nor_trusted(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    cached("test", 2, Outcome, outcome)
    other = only_file(folder).read_bytes()
    only_file(folder).unlink()
    cached("test", 1, Outcome, outcome)
    path, mine = only_file(folder), only_file(folder).read_bytes()
    np.savez(tmp_path / "bomb.npz", tree=np.array([Bomb()], dtype=object), numbers=np.zeros(1))
    with (
        zipfile.ZipFile(tmp_path / "deep.npz", "w", zipfile.ZIP_DEFLATED) as file,
        zipfile.ZipFile(path) as own,
    ):
        for name in own.namelist():
            file.writestr(name, own.read(name))
    pickled = pickle.dumps(Bomb())
    for foreign in (
        other,
        pickled,
        (tmp_path / "bomb.npz").read_bytes(),
        (tmp_path / "deep.npz").read_bytes(),
    ):
        path.write_bytes(foreign)
        log: list[str] = []
        assert same(cached("test", 1, Outcome, lambda log=log: make(log)), outcome())
        assert log == ["made"]
        assert path.read_bytes() == mine
    assert not (tmp_path / "carried-out").exists()


def test_stored_results_of_the_wrong_type_are_rejected() -> None:
    arrays: list[np.ndarray] = []
    tree = encode(outcome(), arrays)
    for place in range(len(tree)):
        for wrong in ("no", 1.5, None, [], {"dtype": "<f8", "shape": [9]}):
            if (place, wrong) == (3, None):  # this field may be None
                continue
            spoilt = [*tree[:place], wrong, *tree[place + 1 :]]
            if (
                encode(outcome(), [])[place] != wrong
                and (place, wrong) != (5, [])
                and (place, wrong) != (4, [])
            ):
                with pytest.raises(Damaged):
                    decode(Outcome, spoilt, iter(arrays))


def test_the_least_recently_used_result_is_evicted(tmp_path: Path) -> None:
    store = Store(tmp_path, room=60_000)
    for number in range(5):
        store.write(f"r{number}", [], [np.zeros(1000)])
        os.utime(tmp_path / f"r{number}.npz", (number, number))
    assert store.read("r0") is not None  # which makes it the one used last
    (tmp_path / ".left.tmp").write_bytes(b"half")
    os.utime(tmp_path / ".left.tmp", (0, 0))
    store.write("r5", [], [np.zeros(3000)])
    names = {path.name for path in tmp_path.iterdir()}
    assert names >= {"r0.npz", "r5.npz", "r4.npz"}
    assert "r1.npz" not in names
    assert ".left.tmp" not in names
    assert sum(path.stat().st_size for path in tmp_path.iterdir()) <= 60_000


def test_the_folder_is_not_listed_again_for_each_small_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With thousands of results that took a twentieth of a diagnosis."""
    looked: list[Store] = []
    monkeypatch.setattr(Store, "_tidy", lambda store: looked.insert(0, store))
    for number in range(9):
        Store(tmp_path).write(f"r{number}", [], [np.zeros(10)])
    assert looked == [Store(tmp_path)]


def test_oversized_results_are_not_cached(tmp_path: Path) -> None:
    store = Store(tmp_path, room_of_one=1000)
    store.write("large", [], [np.zeros(1000)])
    assert not list(tmp_path.iterdir())


def test_an_unwritable_folder_only_disables_the_cache(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv(RESULTS_VARIABLE, str(tmp_path / "file" / "results"))
    assert same(cached("test", 1, Outcome, outcome), outcome())


WRITER = """
import sys
import numpy as np
from pathlib import Path
from rigctl.engine.result_cache import Store
store = Store(Path(sys.argv[1]), room=300_000)
for turn in range(60):
    name, value = f"r{turn % 9}", float(turn % 9)
    store.write(name, {"value": value}, [np.full(2000, value)])
    for number in range(9):
        found = store.read(f"r{number}")
        if found is not None:
            tree, arrays = found
            assert tree == {"value": number} and (next(arrays) == number).all()
"""


def test_concurrent_processes_see_complete_results_or_none(tmp_path: Path) -> None:
    command = [sys.executable, "-c", WRITER, str(tmp_path)]
    writers = [subprocess.Popen(command, stderr=subprocess.PIPE, text=True) for _ in range(3)]
    problems = [writer.communicate()[1] for writer in writers]
    assert [writer.returncode for writer in writers] == [0, 0, 0], problems
    assert not list(tmp_path.glob(".*"))
