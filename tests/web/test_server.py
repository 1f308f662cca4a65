"""The server itself: its address, its project, its start and its end."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import ssl
import subprocess
import sys
from datetime import UTC, datetime, timedelta
from http.client import HTTPSConnection
from ipaddress import ip_address
from pathlib import Path

import pytest

from rigctl.cli.commands.init import create_project
from rigctl.cli.commands.serve import PAGES
from rigctl.errors import RigctlError
from rigctl.project import find_project
from rigctl.web.parts import PARTS
from rigctl.web.server import Settings, host_names
from systems import needs_posix, own_state
from web.serving import Served, serving
from web.watched import wait_for


def refused(project: Path, state: Path, *options: str) -> str:
    """The message of a `rigctl serve` that ends at once."""
    done = subprocess.run(
        [sys.executable, "-m", "rigctl", "serve", str(project), "--no-browser", *options],
        env={**os.environ, **own_state(state)},
        check=False,
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode in (1, 2)
    assert "Traceback" not in done.stderr
    return done.stderr


def test_a_port_in_use_is_reported_with_an_alternative(served: Served, tmp_path: Path) -> None:
    said = refused(tmp_path, tmp_path / "state", "--port", str(served.port))
    assert f"127.0.0.1:{served.port}" in said
    assert "--port 0" in said


def test_a_project_has_one_server(served: Served) -> None:
    """With two servers, each would hand out the controls separately."""
    said = refused(served.project, served.state, "--port", "0")
    assert f"served already at {served.base}" in said
    assert served.token not in said


def test_other_computers_need_a_certificate_and_an_explicit_option(tmp_path: Path) -> None:
    project = find_project(tmp_path)
    for host in ("0.0.0.0", "192.0.2.1", "::", "bench.example"):
        for more in ({}, {"exposed": True}, {"certificate": tmp_path, "key": tmp_path}):
            with pytest.raises(RigctlError, match="other computers could reach"):
                Settings(project, host, **more).require_safe()  # type: ignore[arg-type]
        Settings(project, host, certificate=tmp_path, key=tmp_path, exposed=True).require_safe()
    with pytest.raises(RigctlError, match="a certificate and its key"):
        Settings(project, certificate=tmp_path).require_safe()
    for host in ("127.0.0.1", "localhost", "::1"):
        Settings(project, host).require_safe()
    names = host_names(Settings(project, "0.0.0.0", names=("bench.lan",)), 9000)
    assert "bench.lan:9000" in names
    assert not any(name.startswith(("0.0.0.0", "127.")) for name in names)
    assert host_names(Settings(project), 80)[-1] == "localhost"


def certificate(folder: Path) -> tuple[Path, Path]:
    """A certificate for this computer that signs itself."""
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec

    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, "bench")])
    now = datetime.now(UTC)
    made = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(1)
        .not_valid_before(now - timedelta(days=1))
        .not_valid_after(now + timedelta(days=1))
        .add_extension(x509.SubjectAlternativeName([x509.IPAddress(ip_address("127.0.0.1"))]), critical=False)
        .sign(key, hashes.SHA256())
    )
    paths = folder / "cert.pem", folder / "key.pem"
    paths[0].write_bytes(made.public_bytes(serialization.Encoding.PEM))
    paths[1].write_bytes(
        key.private_bytes(
            serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
        )
    )
    return paths


def test_a_server_with_a_certificate_sets_a_secure_cookie(tmp_path: Path) -> None:
    cert, key = certificate(tmp_path)
    project = tmp_path / "bench"
    project.mkdir()
    options = ("--port", "0", "--certificate", str(cert), "--key", str(key))
    with serving(project, *options, state=tmp_path / "state") as found:
        assert found.base.startswith("https://127.0.0.1:")
        line = HTTPSConnection("127.0.0.1", found.port, context=ssl.create_default_context(cafile=str(cert)))
        body = json.dumps({"token": found.token})
        line.request("POST", "/api/session", body, {"Origin": found.base.replace("https", "http")})
        assert line.getresponse().status == 403
        line.close()
        line.request("POST", "/api/session", body, {"Origin": found.base})
        answer = line.getresponse()
        assert answer.status == 204
        assert "; Secure" in answer.headers["Set-Cookie"]
        line.close()


def test_a_missing_project_folder_is_reported_until_it_is_back(served: Served, cookie: str) -> None:
    away = served.project.with_name("elsewhere")
    served.project.rename(away)
    try:
        assert served.get("/api/status", cookie)["there"] is False
        for path in ("/api/runs", "/api/runs/x", "/api/procedure", "/api/report/models"):
            status, _, text = served.ask("GET", path, cookie=cookie)
            assert (status, json.loads(text)["error"]["what"]) == (409, "the project's folder is missing")
        assert served.get("/api/live", cookie)["runs"] == []
        started = {"path": "procedures/quick-check.yaml", "bench": "simulated"}
        assert served.post("/api/procedure/start", started, cookie)[0] == 409
    finally:
        away.rename(served.project)
    assert served.get("/api/runs", cookie)["all"] > 0


def test_the_command_lists_the_pages_of_the_server() -> None:
    assert [part.name for part in PARTS] == list(PAGES)


def test_the_server_modules_import_no_heavy_library() -> None:
    imports = "rigctl.cli.commands.serve, rigctl.web.app, rigctl.web.server, uvicorn"
    code = f"import sys, {imports}; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    heavy = {"numpy", "pandas", "pyarrow", "pydantic", "jinja2", "scipy", "numba", "duckdb", "matplotlib"}
    assert heavy & set(loaded.split()) == set()


@needs_posix("a process that is killed by a signal")
def test_a_command_with_serve_ends_its_server_with_it(tmp_path: Path) -> None:
    project = tmp_path / "bench"
    create_project(project)
    process = subprocess.Popen(
        [sys.executable, "-m", "rigctl", "simulate", "procedures/stroke.yaml", "--speed", "1x", "--serve"],
        cwd=project,
        env={**os.environ, **own_state(tmp_path / "state")},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr is not None
    with process, process.stderr:
        line = process.stderr.readline()
        found = re.search(r"https?://[^/]+/live#[\w-]+", line)
        assert found is not None, line
        served = Served(project, found.group().replace("/live#", "/#"), process, tmp_path / "state")
        cookie = served.enter()
        wait_for(lambda: len(served.get("/api/live", cookie)["runs"]) == 1)
        os.kill(process.pid, signal.SIGKILL)
        process.wait(120)

    def gone() -> bool:
        try:
            socket.create_connection(("127.0.0.1", served.port), timeout=5).close()
        except OSError:
            return True
        return False

    wait_for(gone)
