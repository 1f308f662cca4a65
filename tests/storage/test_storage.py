"""Runs in storage: uploaded whole, read in place, and not lost when storage refuses, stalls or truncates."""

from __future__ import annotations

import json
import logging
import socket
import sqlite3
import threading
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import closing
from datetime import UTC, datetime, timedelta
from email.utils import format_datetime
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import boto3
import pandas as pd
import pytest
from botocore.exceptions import FlexibleChecksumError
from moto.server import ThreadedMotoServer
from typer.testing import CliRunner

from dataset.strokes import LAYOUT, measure_strokes
from rigctl.cli.main import app
from rigctl.dataset import (
    RunHeader,
    RunWriter,
    Source,
    annotate,
    find_run,
    list_runs,
    open_run,
    query,
    verify,
)
from rigctl.dataset.index.file import stored_index_path
from rigctl.dataset.storage import Store, upload
from rigctl.dataset.storage import store as store_module
from rigctl.dataset.storage.failure import describe
from rigctl.dataset.storage.sending import upload_if_wanted
from rigctl.dataset.storage.store import StoredFile
from rigctl.dataset.storage.verify import verify_stored
from rigctl.dataset.verification import Condition
from rigctl.errors import RigctlError

NAME = "20261121-093000-stroke"
MakeRun = Callable[..., Path]


@pytest.fixture(scope="module")
def server() -> Iterator[str]:
    """A server of S3's protocol on this computer."""
    running = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    running.start()
    host, port = running.get_host_and_port()
    yield f"http://{host}:{port}"
    running.stop()


@pytest.fixture
def bucket(server: str, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Any:
    """A separate bucket, accessed through another client."""
    access(monkeypatch, server)
    found = boto3.resource("s3", endpoint_url=server).Bucket(f"lab-{abs(hash(request.node.name)) % 10**9}")
    found.create(CreateBucketConfiguration={"LocationConstraint": "eu-central-1"})
    return found


def access(monkeypatch: pytest.MonkeyPatch, endpoint: str) -> None:
    monkeypatch.setattr("rigctl.dataset.storage.sending._PAUSE", 0.0)
    for name, value in {
        "AWS_ENDPOINT_URL": endpoint,
        "AWS_ACCESS_KEY_ID": "test",
        "AWS_SECRET_ACCESS_KEY": "test",
        "AWS_DEFAULT_REGION": "eu-central-1",
    }.items():
        monkeypatch.setenv(name, value)


@pytest.fixture
def make_run(tmp_path: Path) -> MakeRun:
    def make(run_id: str = NAME, runs: str = "runs", **facts: Any) -> Path:
        began = datetime(2026, 11, 21, 9, 30, tzinfo=UTC)
        known = {"procedure": Source("stroke"), "rig": Source("bench"), "layout": LAYOUT, "started": began}
        writer = RunWriter.create(tmp_path / runs, RunHeader(id=run_id, **(known | facts)))
        measure_strokes(writer, 2, 20)
        return writer.close("finished")

    return make


def address_of(kind: str, bucket: Any, tmp_path: Path) -> str:
    places = {"memory": f"memory://{bucket.name}/runs", "file": (tmp_path / "share").as_uri()}
    return places.get(kind, f"s3://{bucket.name}/runs")


@pytest.mark.parametrize("kind", ["s3", "memory", "file"])
def test_an_uploaded_run_is_read_in_place(kind: str, bucket: Any, tmp_path: Path, make_run: MakeRun) -> None:
    address = address_of(kind, bucket, tmp_path)
    first, second = make_run(), make_run("20261122-000000-heat")
    done = [upload(folder, Store(address)) for folder in (first, second)]
    assert all((one.sent, one.there) == (5, 0) for one in done)
    assert (upload(first, Store(address)).sent, upload(first, Store(address)).there) == (0, 5)

    here, there = open_run(first), open_run(f"{address}/{NAME}")
    assert dict(there.info) == dict(here.info)
    for ours, theirs in ((here.samples(), there.samples()), (here.records, there.records)):
        pd.testing.assert_frame_equal(ours, theirs)
    assert (there.record(1).channels["position"] == here.record(1).channels["position"]).all()
    assert there.switches == here.switches
    assert str(there.folder) == f"{address}/{NAME}"

    runs = list_runs(address)
    assert [(run.id, run.status, run.records) for run in runs] == [
        (NAME, "finished", 2),
        ("20261122-000000-heat", "finished", 2),
    ]
    assert open_run("latest", address).id == "20261122-000000-heat"
    assert open_run("20261121", address).id == NAME
    chosen = "id IN (SELECT run FROM channels WHERE name = 'position' AND high > 18) AND id LIKE '%heat'"
    assert [run.id for run in list_runs(address, where=chosen)] == ["20261122-000000-heat"]
    assert query("SELECT count(*), count(DISTINCT run) FROM samples", address).rows == ((84, 2),)
    assert verify_stored(Store(address).find(NAME)).condition is Condition.WHOLE
    with pytest.raises(RigctlError, match="only read"):
        find_run(f"{address}/{NAME}")
    with pytest.raises(RigctlError) as caught:
        open_run(f"{address}/20261121-093000-strook")
    assert caught.value.nearest == NAME


def test_an_interrupted_upload_is_not_listed_and_can_be_continued(
    bucket: Any, make_run: MakeRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    store, folder, sending = Store(f"s3://{bucket.name}/runs"), make_run(), StoredFile.send
    sent: list[str] = []

    def interrupted(self: StoredFile, path: str) -> None:
        if len(sent) == 2:
            raise KeyboardInterrupt
        sent.append(self.name)
        sending(self, path)

    with monkeypatch.context() as patch:
        patch.setattr(StoredFile, "send", interrupted)
        with pytest.raises(KeyboardInterrupt):
            upload(folder, store)
    assert list_runs(store.address) == []
    assert (upload(folder, store).there, len(list_runs(store.address))) == (2, 1)


def test_later_notes_are_uploaded_and_other_runs_never_overwritten(bucket: Any, make_run: MakeRun) -> None:
    store, folder = Store(f"s3://{bucket.name}/runs"), make_run()
    upload(folder, store)
    annotate(folder, "new seals")
    assert upload(folder, store).sent == 2  # annotations.jsonl, and run.json
    assert list_runs(store.address)[0].notes == 1
    other = make_run(runs="other", started=datetime(2026, 11, 21, 9, 30, 0, 5, tzinfo=UTC))
    with pytest.raises(RigctlError, match="another run of this name"):
        upload(other, store)
    assert list_runs(store.address)[0].notes == 1
    (folder / "samples.parquet").write_bytes(b"changed")
    with pytest.raises(RigctlError, match="has changed since"):
        upload(folder, store)


@pytest.mark.parametrize("kind", ["s3", "memory", "file"])
def test_one_of_two_runs_with_the_same_name_sent_at_once_is_refused(
    kind: str, bucket: Any, make_run: MakeRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither saw the other's run.json: both used to be reported as sent, and one was overwritten."""
    store = Store(address_of(kind, bucket, tmp_path))
    first = make_run()
    other = make_run(runs="other", started=datetime(2026, 11, 22, tzinfo=UTC))
    sending, refused = StoredFile.send, []

    def meanwhile(self: StoredFile, path: str) -> None:
        if not refused:
            refused.append("")
            with pytest.raises(RigctlError, match="another run of this name") as caught:
                upload(other, store)
            refused[0] = str(caught.value)
        sending(self, path)

    monkeypatch.setattr(StoredFile, "send", meanwhile)
    assert upload(first, store).sent == 5
    assert refused[0]
    assert open_run(f"{store.address}/{NAME}").info["started"] == open_run(first).info["started"]
    assert verify_stored(store.find(NAME)).good
    assert upload(first, store).there == 5


@pytest.mark.parametrize("kind", ["s3", "memory", "file"])
def test_foreign_objects_in_storage_are_not_taken_for_the_latest_run(
    kind: str, bucket: Any, make_run: MakeRun, tmp_path: Path
) -> None:
    """A folder marker, a note, or an upload in progress used to be taken for the newest run."""
    store = Store(address_of(kind, bucket, tmp_path))
    upload(make_run(), store)
    root = store.path("", "")[:-2]
    store.files.pipe_file(f"{root}/readme.txt", b"of this bench")
    store.files.makedirs(f"{root}/zz", exist_ok=True)
    store.files.pipe_file(f"{root}/zz/note.txt", b"")
    store.files.makedirs(f"{root}/20261130-000000-begun", exist_ok=True)
    store.files.pipe_file(f"{root}/20261130-000000-begun/samples.parquet", b"a part")
    assert store.newest() == NAME
    assert open_run("latest", store.address).id == NAME
    assert [run.id for run in list_runs(store.address)] == [NAME]


@pytest.mark.parametrize("name", ["a[1]", "what*", "ü +%2F#?"])
def test_a_prefix_may_have_any_characters(name: str, bucket: Any, make_run: MakeRun) -> None:
    """`[` and `*` used to be taken for patterns, and the upload ended with a traceback."""
    address = f"s3://{bucket.name}/{name}"
    upload(make_run(), Store(address))
    assert [run.id for run in list_runs(address)] == [NAME]
    assert open_run("latest", address).id == NAME
    assert verify_stored(Store(address).find(NAME)).good


def test_an_object_truncated_in_transit_is_sent_again(
    bucket: Any, make_run: MakeRun, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    store, folder, sending = Store(f"s3://{bucket.name}/runs"), make_run(), StoredFile.send
    short = tmp_path / "short"
    faults = iter([True, True])

    def cut(self: StoredFile, path: str) -> None:
        if self.name == "samples.parquet" and next(faults, False):
            short.write_bytes(Path(path).read_bytes()[:-100])
            path = str(short)
        sending(self, path)

    monkeypatch.setattr(StoredFile, "send", cut)
    upload(folder, store)
    assert verify_stored(store.find(NAME)).good
    faults = iter([True] * 9)
    worse = make_run("20261122-000000-x")
    with pytest.raises(RigctlError, match=r"has different data than were sent as samples\.parquet") as caught:
        upload(worse, store)
    assert "bytes" in str(caught.value.expected)
    assert [run.id for run in list_runs(store.address)] == [NAME]
    assert verify(worse).good


def test_truncated_and_missing_objects_are_reported(bucket: Any, make_run: MakeRun) -> None:
    store = Store(f"s3://{bucket.name}/runs")
    upload(make_run(), store)
    whole = bucket.Object(f"runs/{NAME}/samples.parquet").get()["Body"].read()
    bucket.Object(f"runs/{NAME}/samples.parquet").put(Body=whole[:-7])
    with pytest.raises(RigctlError, match="object in storage is incomplete") as caught:
        open_run(f"{store.address}/{NAME}").samples()
    assert (caught.value.value, caught.value.expected) == (f"{len(whole) - 7} bytes", f"{len(whole)} bytes")
    bucket.Object(f"runs/{NAME}/records.parquet").delete()
    with pytest.raises(RigctlError, match="object is missing"):
        _ = open_run(f"{store.address}/{NAME}").records
    found = verify_stored(store.find(NAME))
    assert (found.condition, len(found.problems)) == (Condition.BROKEN, 2)
    bucket.Object(f"runs/{NAME}/run.json").put(Body=b"{")
    assert list_runs(store.address)[0].status == "damaged"


def refusing() -> socket.socket:
    """A reserved port on which no process listens."""
    closed = socket.socket()
    closed.bind(("127.0.0.1", 0))
    return closed


def stalling() -> socket.socket:
    """A server that takes every connection and never answers."""
    silent = refusing()
    silent.listen(64)
    return silent


@pytest.mark.parametrize("broken", [refusing, stalling])
def test_no_run_is_lost_when_storage_refuses_or_stalls(
    broken: Callable[[], socket.socket],
    make_run: MakeRun,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setattr(store_module, "CONNECTS_WITHIN", 0.3)
    monkeypatch.setattr(store_module, "ANSWERS_WITHIN", 0.3)
    monkeypatch.setattr(store_module, "_ATTEMPTS", 1)
    (tmp_path / "rigctl.toml").write_text('runs = "s3://lab/runs"\n', encoding="utf-8")
    folder = make_run()
    with broken() as port:
        access(monkeypatch, f"http://127.0.0.1:{port.getsockname()[1]}")
        with pytest.raises(RigctlError, match="cannot read the runs") as caught:
            upload(folder, Store("s3://lab/runs"))
        assert "Nothing that was recorded here is lost" in str(caught.value.hint)
        with caplog.at_level(logging.WARNING):
            upload_if_wanted(folder)
        assert "not uploaded" in caplog.text
        assert "'rigctl runs upload' tries again" in caplog.text
        monkeypatch.chdir(tmp_path)
        listed = CliRunner().invoke(app, ["runs", "list"])
        assert (listed.exit_code, NAME in listed.stdout) == (0, True)
        assert "Only the runs of this computer are listed" in listed.stderr
        with pytest.raises(RigctlError, match="cannot list the runs"):
            query("SELECT count(*) FROM records")  # a result from half of the runs would be wrong
        assert open_run(NAME).id == NAME
    assert verify(folder).condition is Condition.WHOLE


def test_a_project_keeps_its_runs_in_storage(
    bucket: Any, make_run: MakeRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    address = f"s3://{bucket.name}/runs"
    (tmp_path / "rigctl.toml").write_text(f'runs = "{address}"\n', encoding="utf-8")
    (tmp_path / "oil.csv").write_text("oil_temperature [degC],viscosity [cSt]\n20,60\n40,30\n", "utf-8")

    def asked(*arguments: str, code: int = 0) -> dict[str, Any]:
        done = CliRunner().invoke(app, [*arguments, "--json"], catch_exceptions=False)
        assert done.exit_code == code, done.output
        document: dict[str, Any] = json.loads(done.stdout)
        return document

    imported = asked("import", "oil.csv")["run"]
    assert [run.id for run in list_runs(address)] == [imported]  # uploaded when it was closed
    upload(make_run(runs="another computer's"), Store(address))
    make_run("20261121-100000-here")
    told = asked("runs", "upload")["runs"]
    assert [(one["run"], one["problem"]) for one in told] == [
        ("20261121-100000-here", None),
        (imported, None),
    ]
    names = [run["id"] for run in asked("runs", "list")["runs"]]
    assert names == [NAME, "20261121-100000-here", imported]
    shown = asked("runs", "show", NAME)
    assert (shown["folder"], len(shown["records"])) == (f"{address}/{NAME}", 2)
    assert asked("runs", "verify", NAME, f"{address}/{NAME}")["broken"] == 0
    assert asked("runs", "sql", "SELECT count(DISTINCT run) FROM records")["rows"] == [[3]]
    assert open_run("latest").id == imported


# --- the index of a storage ---------------------------------------------------------------------------------


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The requests for ``run.json`` and samples from now on."""
    found: list[str] = []
    infos, opening = Store.infos, StoredFile.open

    def counted(self: Store, ids: Any) -> Any:
        found.extend(ids)
        return infos(self, ids)

    def opened(self: StoredFile) -> Any:
        found.append(f"{self.folder.name}/{self.name}")
        return opening(self)

    monkeypatch.setattr(Store, "infos", counted)
    monkeypatch.setattr(StoredFile, "open", opened)
    return found


@pytest.mark.parametrize("kind", ["s3", "memory", "file"])
def test_only_changed_objects_are_read_again(
    kind: str, bucket: Any, tmp_path: Path, make_run: MakeRun, asked: list[str]
) -> None:
    store = Store(address_of(kind, bucket, tmp_path))
    folders = [make_run(), make_run("20261122-000000-heat"), make_run("20261123-000000-cold")]
    for folder in folders:
        upload(folder, store)

    def listed(**how: Any) -> list[str]:
        asked.clear()
        return [run.id for run in list_runs(store.address, **how)]

    names = [folder.name for folder in folders]
    assert (listed(), sorted(asked)) == (names, names)
    assert (listed(), asked) == (names, [])
    assert (listed(last=1), asked) == (names[-1:], [])

    warm = "id IN (SELECT run FROM channels WHERE name = 'position' AND high > 18)"
    assert listed(where=warm) == names
    assert sorted(asked) == [f"{name}/samples.parquet" for name in names]
    assert (listed(where=warm), asked) == (names, []), "the ranges of channels are kept"

    annotate(folders[1], "new seals")
    upload(folders[1], store)
    assert (listed(where="notes = 1"), asked) == (names[1:2], names[1:2])
    store.files.rm(store.path(names[0], "run.json"))
    assert (listed(), asked) == (names[1:], [])
    upload(folders[0], store)
    assert (listed(), asked) == (names, names[:1])


@pytest.mark.parametrize("harm", ["garbage", "another version", "a table is missing"])
def test_an_unusable_storage_index_is_rebuilt_with_a_warning(
    harm: str, bucket: Any, make_run: MakeRun, asked: list[str], caplog: pytest.LogCaptureFixture
) -> None:
    store = Store(f"s3://{bucket.name}/runs")
    upload(make_run(), store)
    assert [run.id for run in list_runs(store.address)] == [NAME]
    path = stored_index_path(store.address)
    if harm == "garbage":
        path.write_bytes(b"no database" * 500)
    else:
        with closing(sqlite3.connect(path)) as index:
            index.execute("PRAGMA user_version = 99" if "version" in harm else "DROP TABLE channel")
            index.commit()
    asked.clear()
    with caplog.at_level(logging.WARNING, "rigctl"):
        assert [
            (run.id, run.records)
            for run in list_runs(store.address, where="id IN (SELECT run FROM channels)")
        ] == [(NAME, 2)]
    assert "made again" in caplog.text
    assert NAME in asked


@pytest.mark.parametrize("broken", [refusing, stalling])
def test_an_old_index_is_not_used_in_place_of_unreachable_storage(
    broken: Callable[[], socket.socket], bucket: Any, make_run: MakeRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    address = f"s3://{bucket.name}/runs"
    upload(make_run(), Store(address))
    assert len(list_runs(address)) == 1
    monkeypatch.setattr(store_module, "CONNECTS_WITHIN", 0.3)
    monkeypatch.setattr(store_module, "ANSWERS_WITHIN", 0.3)
    monkeypatch.setattr(store_module, "_ATTEMPTS", 1)
    with broken() as port, monkeypatch.context() as patch:
        patch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{port.getsockname()[1]}")
        with pytest.raises(RigctlError, match="cannot list the runs"):
            list_runs(address)
    assert len(list_runs(address)) == 1, "and nothing of it is forgotten"


class Cutting(BaseHTTPRequestHandler):
    """A proxy to a storage without checksums that truncates its answer for ``run.json``."""

    behind = ""  #: the storage
    claims_all = False  #: the header still states the full length
    cuts = True

    def do_GET(self) -> None:
        request = urllib.request.Request(
            self.behind + self.path, headers=dict(self.headers), method=self.command
        )
        try:
            with urllib.request.urlopen(request) as answer:
                status, headers, body = answer.status, answer.headers, answer.read()
        except urllib.error.HTTPError as problem:
            status, headers, body = problem.code, problem.headers, problem.read()
        sent = body[:-9] if self.cuts and self.path.endswith("run.json") else body
        self.send_response(status)
        for name, value in headers.items():
            if not name.lower().startswith(("content-length", "transfer-", "connection", "x-amz-checksum")):
                self.send_header(name, value)
        whole = headers["Content-Length"] if self.command == "HEAD" else len(body)
        self.send_header("Content-Length", str(len(sent) if sent != body and not self.claims_all else whole))
        self.send_header("Connection", "close")
        self.end_headers()
        self.wfile.write(sent)

    do_HEAD = do_GET  # noqa: N815 - the names that the class looks for

    def log_message(self, *_: object) -> None:
        """Nothing on stderr."""


@pytest.mark.parametrize("claims_all", [False, True])
def test_a_truncated_answer_is_not_stored(
    claims_all: bool, server: str, bucket: Any, make_run: MakeRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    address = f"s3://{bucket.name}/runs"
    upload(make_run(), Store(address))
    monkeypatch.setattr(Cutting, "behind", server)
    monkeypatch.setattr(Cutting, "claims_all", claims_all)
    with ThreadingHTTPServer(("127.0.0.1", 0), Cutting) as between:
        threading.Thread(target=between.serve_forever, daemon=True).start()
        monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{between.server_port}")
        if claims_all:
            with pytest.raises(RigctlError, match="cannot read the runs"):
                list_runs(address)
        else:
            assert list_runs(address)[0].status == "damaged"
        monkeypatch.setattr(Cutting, "cuts", False)
        assert list_runs(address)[0].status == "finished", "asked for again, though its mark is the same"
        between.shutdown()


class Elsewhen(BaseHTTPRequestHandler):
    """A server two hours ahead of this computer: it refuses every request, as S3, MinIO and Ceph do."""

    def _refuse(self) -> None:
        self.rfile.read(int(self.headers.get("Content-Length") or 0))
        now = datetime.now(UTC) + timedelta(hours=2, seconds=20)
        body = (
            b"<Error><Code>RequestTimeTooSkewed</Code><Message>The difference between the request time"
            b" and the current time is too large.</Message></Error>"
        )
        self.send_response_only(403)
        self.send_header("Date", format_datetime(now, usegmt=True))
        self.send_header("Content-Type", "application/xml")
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Connection", "close")
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)

    do_GET = do_HEAD = do_PUT = do_POST = _refuse  # noqa: N815 - names of http.server


@pytest.mark.parametrize(
    "command", [["upload", "--to", "s3://lab/runs"], ["show", f"s3://lab/runs/{NAME}"]], ids=["HEAD", "GET"]
)
def test_a_wrong_clock_of_this_computer_is_reported(
    command: list[str], make_run: MakeRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An upload used to report only `Forbidden` and `Is it there?`: an answer to HEAD has no text."""
    folder = make_run()
    monkeypatch.chdir(tmp_path)
    with ThreadingHTTPServer(("127.0.0.1", 0), Elsewhen) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        access(monkeypatch, f"http://127.0.0.1:{server.server_port}")
        try:
            done = CliRunner().invoke(app, ["runs", *command])
        finally:
            server.shutdown()
            thread.join()
    said = f"{done.output}{done.exception or ''}"
    assert "s3://lab/runs: cannot" in said
    assert "the clock of this computer is 2 h behind the server's. Set the clock" in said
    assert done.exit_code != 0
    assert verify(folder).condition is Condition.WHOLE


def test_uploads_stop_after_two_failures_of_unreachable_storage(
    make_run: MakeRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each of hundreds of runs used to take a minute."""
    monkeypatch.setattr(store_module, "_ATTEMPTS", 1)
    for day in range(21, 25):
        make_run(f"202611{day}-000000-x")
    monkeypatch.chdir(tmp_path)
    with refusing() as port:
        access(monkeypatch, f"http://127.0.0.1:{port.getsockname()[1]}")
        done = CliRunner().invoke(app, ["runs", "upload", "--to", "s3://lab/runs", "--json"])
    assert done.exit_code == 1
    tried = ["cannot" in one["problem"] for one in json.loads(done.stdout)["runs"]]
    assert tried == [True, True, False, False]


def test_an_object_that_changes_while_it_is_read_is_reported_in_one_sentence(
    bucket: Any, make_run: MakeRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A checksum failure while reading a table used to end `rigctl report` with a traceback."""
    store = Store(f"s3://{bucket.name}/runs")
    upload(make_run(), store)
    reading = type(store.files.open(store.path(NAME, "samples.parquet"), "rb"))._fetch_range

    def harmed(self: Any, start: int, end: int) -> bytes:
        if self.path.endswith("samples.parquet"):
            raise FlexibleChecksumError(error_msg="Expected checksum A did not match")
        content: bytes = reading(self, start, end)
        return content

    monkeypatch.setattr("s3fs.core.S3File._fetch_range", harmed)
    with pytest.raises(RigctlError, match=r"cannot read samples\.parquet of .*Expected checksum A"):
        open_run(f"{store.address}/{NAME}").samples()


class LoginPage(BaseHTTPRequestHandler):
    """The answer of a guest network to every request."""

    protocol_version = "HTTP/1.1"  # a client that sends Expect: 100-continue is answered

    def _show(self) -> None:
        self.rfile.read(int(self.headers.get("Content-Length") or 0))
        body = b"<html><body>Log in to the network</body></html>"
        self.send_response_only(200)
        self.send_header("Content-Type", "text/html")
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Connection", "close")
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)

    do_GET = do_HEAD = do_PUT = do_POST = _show  # noqa: N815 - names of http.server


def test_the_login_page_of_a_network_is_recognised_and_reported(
    make_run: MakeRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It used to be reported as `storage has another run of this name`."""
    folder = make_run()
    with ThreadingHTTPServer(("127.0.0.1", 0), LoginPage) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        access(monkeypatch, f"http://127.0.0.1:{server.server_port}")
        try:
            with pytest.raises(RigctlError, match="storage has other data than were sent") as caught:
                upload(folder, Store("s3://lab/runs"))
        finally:
            server.shutdown()
            thread.join()
    assert "login page of a network" in str(caught.value.hint)
    assert verify(folder).condition is Condition.WHOLE


def test_a_damaged_run_is_reported_by_its_address(bucket: Any, make_run: MakeRun) -> None:
    """It used to be shown as `s3:/bucket`, with one slash, as a path."""
    store = Store(f"s3://{bucket.name}/runs")
    upload(make_run(), store)
    bucket.Object(f"runs/{NAME}/run.json").put(Body=b"{")
    with pytest.raises(RigctlError, match="the file is damaged") as caught:
        open_run(f"{store.address}/{NAME}")
    assert str(caught.value.where) == f"{store.address}/{NAME}/run.json"
    assert verify_stored(store.find(NAME)).problems[0].startswith(f"{store.address}/{NAME}/run.json: ")


def test_an_answer_that_the_library_cannot_parse_is_reported_as_incomplete() -> None:
    """The S3 library raises this error when the body of an answer is cut short."""
    why, _ = describe(IndexError("tuple index out of range"))
    assert why == "its answer is incomplete, or not a storage's (IndexError: tuple index out of range)"
