"""Reading YAML: places, and everything that is refused."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigctl.errors import Location, RigctlError
from rigctl.files.yaml import MAX_BYTES, parse_document, read_document
from rigctl.rig import parse_rig

REPOSITORY = Path(__file__).parents[2]
RIG_TEXT = (REPOSITORY / "rigs" / "hl32-bench.yaml").read_text(encoding="utf-8")


def refused(text: str) -> RigctlError:
    with pytest.raises(RigctlError) as caught:
        parse_document(text, Path("x.yaml"))
    return caught.value


def test_equal_texts_in_two_files_have_the_locations_of_their_own_file() -> None:
    for path in (Path("one.yaml"), Path("two.yaml")):
        document = parse_document("a: [1, 2]\n", path)
        assert document.locate(("a", 1)) == Location(path, 1, 8)
        document.data["a"].clear()
        assert document.data == {"a": [1, 2]}
        with pytest.raises(RigctlError) as caught:
            parse_document("a: [1, 2\n", path)
        assert caught.value.where.file == path


def test_data_is_plain_python() -> None:
    text = "a: 1\nb: [x, 2.5, true, null, ~]\nc: {d: 30 bar, e: '1'}\nf: |\n  two\n  lines\n"
    assert parse_document(text).data == {
        "a": 1,
        "b": ["x", 2.5, True, None, None],
        "c": {"d": "30 bar", "e": "1"},
        "f": "two\nlines\n",
    }


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("yes", "yes"),
        ("on", "on"),
        ("No", "No"),
        ("TRUE", True),
        ("0o17", 15),
        ("017", 17),
        ("0x1F", 31),
        ("1e3", 1000.0),
        (".5", 0.5),
        ("5.", 5.0),
        ("12:30", "12:30"),
        ("2026-03-14", "2026-03-14"),
        ("-.inf", float("-inf")),
        ("1_000", "1_000"),
        ("", None),
    ],
)
def test_scalars_follow_the_core_schema_of_yaml_1_2(text: str, value: object) -> None:
    read = parse_document(f"a: {text}").data["a"]
    assert read == value
    assert type(read) is type(value)


def test_each_access_to_the_data_gives_a_new_copy() -> None:
    document = parse_document("a: &x [1]\nb: *x\n")
    data = document.data
    data["a"].append(2)
    assert data["b"] == [1]
    assert document.data == {"a": [1], "b": [1]}


def test_every_part_is_located() -> None:
    document = parse_document("steps:\n  - heat: {to: 40 degC}\n  - wait: 2 s\n", Path("p.yaml"))
    assert document.locate(("steps", 0, "heat", "to")) == Location(Path("p.yaml"), 2, 16)
    assert document.locate(("steps", 1, "wait"), of_key=True) == Location(Path("p.yaml"), 3, 5)
    assert document.locate(("steps", 1)) == Location(Path("p.yaml"), 3, 5)
    assert document.locate() == Location(Path("p.yaml"), 1, 1)


def test_a_missing_field_is_located_at_its_mapping() -> None:
    document = parse_document("a:\n  b: {c: 1}\n")
    assert document.locate(("a", "b", "nothing")) == Location(None, 2, 6)


def test_an_alias_is_located_at_its_anchor() -> None:
    document = parse_document("a: &x {b: 1}\nc: *x\n")
    assert document.locate(("c", "b")).line == 1


def test_the_scalar_is_kept_as_written() -> None:
    document = parse_document("a: 1.50\nb: [1]\n")
    assert document.written(("a",)) == "1.50"
    assert document.written(("b",)) is None


@pytest.mark.parametrize(
    ("text", "line", "column", "what"),
    [
        ("a: 1\na: 2", 2, 1, "given twice, first in line 1"),
        ("a: !!python/object/apply:os.system [ls]", 1, 4, "tags are not allowed"),
        ("a: !mine 1", 1, 4, "tags are not allowed"),
        ("1: 2", 1, 1, "a key must be text"),
        ("true: 2", 1, 1, "a key must be text"),
        ("? [a]\n: b", 1, 5, "a key must be text"),
        ("a: *x", 1, 4, "no such anchor"),
        ("a: &a [*a]", 1, 8, "no such anchor"),
        ("--- 1\n--- 2", 2, 1, "second document"),
        ("a: [", 1, 5, "not valid YAML"),
        ("a: b: c", 1, 5, "not valid YAML"),
        ("a:\n\t- 1", 2, 1, "not valid YAML"),
        ("ok: 1\nb: \x07", 2, 4, "control character"),
        ("[" * 101, 1, 101, "nested too deep"),
        ("a: " * 3, 1, 5, "not valid YAML"),
    ],
)
def test_refusals_have_their_location(text: str, line: int, column: int, what: str) -> None:
    error = refused(text)
    assert what in error.what
    assert error.where == Location(Path("x.yaml"), line, column)


def test_an_exponentially_growing_file_is_refused_before_expansion() -> None:
    bomb = "a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n"
    bomb += "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]\n" for i in range(1, 30))
    error = refused(bomb)
    assert "grows too large" in error.what
    assert error.expected == "at most 100000 values"


def test_nesting_by_aliases_counts_as_depth() -> None:
    text = "a0: &a0 [x]\n" + "".join(f"a{i}: &a{i} [*a{i - 1}]\n" for i in range(1, 120))
    assert "nested too deep" in refused(text).what


def test_deeply_nested_anchors_are_refused() -> None:
    assert "too" in refused("&a [" * 200_000).what


def test_a_large_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "big.yaml"
    path.write_bytes(b"#" * (MAX_BYTES + 1))
    with pytest.raises(RigctlError, match="at most 1 MiB"):
        read_document(path)


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="POSIX has this device, Windows has not")
def test_an_endless_device_file_is_refused() -> None:
    with pytest.raises(RigctlError, match="it is a pipe or a device, not a file"):
        read_document(Path("/dev/zero"))


def test_a_file_that_is_not_utf_8_is_located(tmp_path: Path) -> None:
    path = tmp_path / "latin.yaml"
    path.write_bytes("a: 1\nb: 20 °C\n".encode("latin-1"))
    with pytest.raises(RigctlError, match="not UTF-8") as caught:
        read_document(path)
    assert caught.value.where == Location(path, 2, 7)


def test_a_byte_order_mark_and_windows_line_ends_are_read(tmp_path: Path) -> None:
    path = tmp_path / "windows.yaml"
    path.write_bytes(b"\xef\xbb\xbfa: 1\r\nb: 2\r\n")
    document = read_document(path)
    assert document.data == {"a": 1, "b": 2}
    assert document.locate(("b",)) == Location(path, 2, 4)


def test_a_missing_file_is_reported(tmp_path: Path) -> None:
    with pytest.raises(RigctlError, match="no such file"):
        read_document(tmp_path / "none.yaml")


def test_a_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RigctlError, match="expected a YAML file"):
        read_document(tmp_path)


def test_an_invalid_path_is_refused() -> None:
    with pytest.raises(RigctlError, match="cannot read"):
        read_document(Path("a\0b"))


def test_the_data_of_an_empty_file_is_none() -> None:
    document = parse_document("# only a comment\n")
    assert document.data is None
    assert document.locate(("a",)) == Location(None, 1, 1)


def is_plain(value: object) -> bool:
    """Whether a value consists of nothing but mappings with texts as keys, lists, texts and numbers."""
    if isinstance(value, dict):
        return all(isinstance(key, str) and is_plain(one) for key, one in value.items())
    if isinstance(value, list):
        return all(is_plain(one) for one in value)
    return value is None or isinstance(value, str | int | float | bool)


@settings(max_examples=300)
@given(st.text(alphabet=st.sampled_from("ab1 :-[]{},&*!|>'\"%@`#?~\n\t\r\\<=°\x00\ufeff\u2028"), max_size=60))
def test_any_text_is_read_or_refused(text: str) -> None:
    try:
        document = parse_document(text)
    except RigctlError as error:
        assert str(error)
    else:
        assert document.locate() is not None
        assert is_plain(document.data), document.data


@settings(max_examples=150)
@given(
    start=st.integers(0, len(RIG_TEXT)),
    length=st.integers(0, 40),
    insert=st.text(alphabet=st.characters(codec="utf-8"), max_size=8)
    | st.sampled_from(
        ["[", "{", "}", ":", "- ", "&a ", "*a", "!!int ", "\t", "'", "1", "degC", "null", "[]"]
    ),
)
def test_a_broken_rig_file_never_gives_a_traceback(start: int, length: int, insert: str) -> None:
    text = RIG_TEXT[:start] + insert + RIG_TEXT[start + length :]
    try:
        rig = parse_rig(text, Path("broken.yaml"))
    except RigctlError as error:
        assert "broken.yaml" in str(error)
    else:
        assert rig.layout.columns
