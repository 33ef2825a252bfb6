"""Access control, refused requests, and that no content of a store becomes script in the web viewer."""

from __future__ import annotations

import hashlib
import http.client
import json
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import quote, urlsplit

import httpx
import pytest

pytest.importorskip("fastapi")

from dated_passes import FIRST, MAIN, UP
from serving import serving
from trackprofile.cli import main
from trackprofile.errors import FileError
from trackprofile.server import session
from trackprofile.server.serve import bind
from trackprofile.server.static_files import static_files
from trackprofile.store import Store, create

TOKEN = "a-token-of-many-letters-0123456789"
UPLOT_BANNER = "/*! https://github.com/leeoniya/uPlot (v1.6.32) */"
LEVEL = {"line": MAIN, "direction": UP, "day": str(FIRST), "band": "D1", "max_bins": "50"}


@pytest.fixture(scope="module")
def client(dated_store: Store) -> Iterator[httpx.Client]:
    """Client of a server without a token."""
    with serving(dated_store, names=["track.example.org"]) as running:
        yield running


@pytest.fixture(scope="module")
def locked(dated_store: Store) -> Iterator[httpx.Client]:
    """Client of a server that requires a token."""
    with serving(dated_store, TOKEN) as running:
        yield running


def raw(client: httpx.Client, target: str, *headers: str, method: str = "GET") -> tuple[int, str]:
    """Status and text of a request that a client library would not send."""
    where = urlsplit(str(client.base_url))
    with socket.create_connection((where.hostname, where.port), timeout=20) as line:
        lines = [f"{method} {target} HTTP/1.1", *headers, "Connection: close", "", ""]
        line.sendall("\r\n".join(lines).encode("latin-1"))
        answer = http.client.HTTPResponse(line)
        answer.begin()
        return answer.status, answer.read().decode("utf-8", "replace")


# --- paths --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "target",
    [
        "/static/../server/session.py",
        "/static/../../../../../../etc/passwd",
        "/static/%2e%2e/%2e%2e/store.json",
        "/static/..%2f..%2fstore.json",
        "/static/..%5c..%5cstore.json",
        "/static//etc/passwd",
        "/static/%00index.html",
        "/static/index.html%00.js",
        "/static/INDEX.HTML",
        "//etc/passwd",
        "/../store.json",
        "/store.json",
        "/profiles/",
        "/static/",
        "http://elsewhere.example/etc/passwd",
        "/static/" + 300 * "a",
    ],
)
def test_no_path_leads_out_of_the_static_files(client: httpx.Client, target: str) -> None:
    status, text = raw(client, target, "Host: 127.0.0.1")
    assert status in (307, 400, 404, 414)
    assert "root:" not in text
    assert "schema" not in text
    assert "def " not in text


@pytest.mark.parametrize("name", ["../../store.json", "..", "/etc/passwd", "a\x00b", "x\ny", ""])
def test_names_of_lines_are_never_paths(client: httpx.Client, name: str) -> None:
    answer = client.get("/api/passes", params={"line": name, "direction": "up"})
    assert answer.status_code in (404, 422)
    assert answer.json().keys() == {"error"}


# --- origin of a request -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("host", "status"),
    [
        ("127.0.0.1:1", 200),
        ("localhost", 200),
        ("[::1]:8000", 200),
        ("track.example.org", 200),
        ("TRACK.example.org:443", 200),
        ("evil.example", 421),
        ("track.example.org.evil.example", 421),
        ("localhost.evil.example", 421),
        ("evil.example@127.0.0.1", 421),
        ("127.0.0.1:8000:1", 421),
        ("127.0.0.1.evil.example", 421),
        ("", 421),
    ],
)
def test_an_unknown_host_name_is_refused(client: httpx.Client, host: str, status: int) -> None:
    assert raw(client, "/api/lines", f"Host: {host}")[0] == status
    assert raw(client, "/", f"Host: {host}")[0] == status


def test_a_request_without_host_or_with_two_is_refused(client: httpx.Client) -> None:
    assert raw(client, "/api/lines")[0] in (400, 421)
    assert raw(client, "/api/lines", "Host: 127.0.0.1", "Host: evil.example")[0] in (400, 421)


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"origin": "OWN"}, 200),
        ({"origin": "https://evil.example"}, 403),
        ({"origin": "null"}, 403),
        ({"origin": "http://127.0.0.1:1"}, 403),
        ({"sec-fetch-site": "same-origin"}, 200),
        ({"sec-fetch-site": "none"}, 200),
        ({"sec-fetch-site": "cross-site"}, 403),
        ({"sec-fetch-site": "same-site"}, 403),
        ({"sec-fetch-site": "cross-site", "sec-fetch-mode": "navigate"}, 403),
    ],
)
def test_a_page_of_another_origin_reads_nothing(
    client: httpx.Client, headers: dict[str, str], status: int
) -> None:
    own = str(client.base_url).rstrip("/")
    headers = {name: value.replace("OWN", own) for name, value in headers.items()}
    answer = client.get("/api/lines", headers=headers)
    assert answer.status_code == status
    assert not [name for name in answer.headers if name.startswith("access-control")]


def test_a_link_on_another_site_opens_only_the_viewer(client: httpx.Client) -> None:
    link = {"sec-fetch-site": "cross-site", "sec-fetch-mode": "navigate"}
    assert client.get("/?view=line", headers=link).status_code == 200
    assert client.post("/logout", headers=link, json={}).status_code == 403
    framed = {"sec-fetch-site": "cross-site", "sec-fetch-mode": "no-cors"}
    assert client.get("/static/main.js", headers=framed).status_code == 403


def test_no_answer_allows_another_origin(client: httpx.Client) -> None:
    headers = {"origin": "https://evil.example", "access-control-request-method": "GET"}
    answer = client.options("/api/lines", headers=headers)
    assert answer.status_code == 403
    assert not [name for name in answer.headers if name.startswith("access-control")]


# --- the token ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "path", ["/api/lines", "/openapi.json", "/api/none", "/none", "/API/lines"]
)
@pytest.mark.parametrize(
    "headers",
    [
        {},
        {"authorization": "Bearer wrong"},
        {"authorization": f"Bearer {TOKEN[:-1]}"},
        {"authorization": f"Bearer {TOKEN}x"},
        {"authorization": f"Basic {TOKEN}"},
        {"authorization": "Bearer"},
        {"cookie": f"trackprofile={TOKEN}"},
        {"cookie": "trackprofile=99999999999.0"},
        {"cookie": "trackprofile=; ="},
    ],
)
def test_without_the_token_nothing_is_answered(
    locked: httpx.Client, path: str, headers: dict[str, str]
) -> None:
    locked.cookies.clear()
    answer = locked.get(path, headers=headers)
    assert answer.status_code == 401
    assert answer.headers["www-authenticate"] == "Bearer"
    assert answer.json().keys() == {"error"}


def test_a_token_in_the_address_is_ignored(locked: httpx.Client) -> None:
    locked.cookies.clear()
    for name in ("token", "access_token", "authorization"):
        assert locked.get("/api/lines", params={name: TOKEN}).status_code == 401


def test_the_token_in_the_header_gives_access(locked: httpx.Client) -> None:
    locked.cookies.clear()
    for kind in ("Bearer", "bearer"):
        answer = locked.get("/api/lines", headers={"authorization": f"{kind} {TOKEN}"})
        assert answer.status_code == 200
        assert answer.json()["token_required"] is True
        assert "set-cookie" not in answer.headers


def test_logging_in_gives_a_cookie_that_is_not_the_token(locked: httpx.Client) -> None:
    locked.cookies.clear()
    wrong = locked.post("/login", json={"token": "wrong"})
    assert (wrong.status_code, "set-cookie" in wrong.headers) == (401, False)
    cookie = locked.post("/login", json={"token": TOKEN}).headers["set-cookie"]
    assert TOKEN not in cookie
    assert "HttpOnly" in cookie
    assert "SameSite=strict" in cookie
    assert "Path=/" in cookie
    assert locked.get("/api/lines").status_code == 200
    locked.post("/logout", json={})
    assert locked.get("/api/lines").status_code == 401


def test_behind_a_tls_proxy_the_cookie_is_secure(locked: httpx.Client) -> None:
    answer = locked.post("/login", json={"token": TOKEN}, headers={"x-forwarded-proto": "https"})
    assert "Secure" in answer.headers["set-cookie"]
    locked.cookies.clear()


def test_sessions_expire_and_cannot_be_extended() -> None:
    value = session.new_session(TOKEN, now=1000.0)
    assert session.session_is_valid(TOKEN, value, now=1000.0 + session.SESSION_SECONDS - 1)
    assert not session.session_is_valid(TOKEN, value, now=1000.0 + session.SESSION_SECONDS + 1)
    ends, _, signature = value.partition(".")
    other = signature.translate(str.maketrans("0123456789", "1234567890"))
    for forged in (
        f"{int(ends) + 9999}.{signature}", f"{ends}.{other}", f"{ends}.{signature[:-1]}", f"{ends}.", "", "x.y",
        f"-1.{signature}", f"١٢.{signature}",
    ):  # fmt: skip
        assert not session.session_is_valid(TOKEN, forged, now=1000.0)


def test_the_files_of_the_viewer_need_no_token_and_contain_no_data(locked: httpx.Client) -> None:
    locked.cookies.clear()
    assert locked.get("/session").json() == {"open": False}
    for path in ("/", "/static/main.js", "/static/viewer.css"):
        answer = locked.get(path)
        assert answer.status_code == 200
        assert MAIN not in answer.text


# --- size and form ------------------------------------------------------------------------------


def test_too_large_requests_are_refused(client: httpx.Client) -> None:
    assert client.get("/api/lines?" + "a" * 3000).status_code == 414
    assert raw(client, "/" + "a" * 30_000, "Host: 127.0.0.1")[0] in (400, 414, 431)
    assert raw(client, "/", "Host: 127.0.0.1", f"X-Long: {'a' * 30_000}")[0] in (400, 431)
    assert client.post("/login", content=b"a" * 5000).status_code == 413
    assert raw(client, "/login", "Host: 127.0.0.1", method="POST")[0] == 411
    assert raw(client, "/login", "Host: 127.0.0.1", "Content-Length: -5", method="POST")[0] in (
        400,
        411,
    )
    chunked = (b"{}" for _ in range(2))
    assert client.post("/login", content=chunked).status_code == 411


@pytest.mark.parametrize(
    "wrong",
    [
        {"max_bins": "1000000000"},
        {"max_bins": "-1"},
        {"max_bins": "1.5"},
        {"max_bins": ""},
        {"from": "nan"},
        {"from": "inf"},
        {"from": "1e400"},
        {"from": "-1e300"},
        {"from": "13000", "to": "12500"},
        {"from": "13000", "to": "13000"},
        {"band": "D4"},
        {"band": "../D1"},
        {"day": "2026-13-01"},
        {"day": "yesterday"},
        {"line": "x" * 201},
        {"line": "\x1b[2J"},
        {"direction": ""},
        {"entry": "../../store"},
        {"entry": "0" * 16},
        {"surprise": "1"},
    ],
    ids=str,
)
def test_malformed_requests_are_refused_with_one_sentence(
    client: httpx.Client, wrong: dict[str, str]
) -> None:
    answer = client.get("/api/level", params=LEVEL | wrong)
    assert answer.status_code == 422
    assert answer.json().keys() == {"error"}
    sentence = answer.json()["error"]
    assert sentence.endswith(".")
    assert "\n" not in sentence
    assert len(sentence) < 300
    assert "x" * 100 not in sentence


@pytest.mark.parametrize("method", ["POST", "PUT", "PATCH", "DELETE", "TRACE", "PROPFIND"])
def test_the_server_is_read_only(client: httpx.Client, method: str) -> None:
    for path in ("/api/lines", "/", "/static/main.js", "/openapi.json"):
        answer = client.request(method, path, headers={"content-length": "0"})
        assert answer.status_code == 405


def test_no_request_changes_the_store(dated_store: Store, client: httpx.Client) -> None:
    def bytes_of() -> dict[str, str]:
        root = Path(dated_store.url)
        return {
            str(path.relative_to(root)): hashlib.sha256(path.read_bytes()).hexdigest()
            for path in sorted(root.rglob("*"))
            if path.is_file()
        }

    before = bytes_of()
    for endpoint in (
        "lines",
        "passes",
        "level",
        "defects",
        "schematic",
        "sections",
        "quality",
        "development",
    ):
        client.get(f"/api/{endpoint}", params=LEVEL)
        client.post(f"/api/{endpoint}", json=LEVEL)
    assert bytes_of() == before


# --- security headers ---------------------------------------------------------------------


@pytest.mark.parametrize("path", ["/", "/static/main.js", "/api/lines", "/none", "/api/level"])
def test_every_answer_has_the_security_headers(client: httpx.Client, path: str) -> None:
    headers = client.get(path).headers
    parts = [one.strip().partition(" ") for one in headers["content-security-policy"].split(";")]
    policy = {name: sources for name, _, sources in parts}
    assert policy["default-src"] == "'none'"
    assert policy["script-src"] == policy["style-src"] == policy["connect-src"] == "'self'"
    assert policy["frame-ancestors"] == policy["base-uri"] == policy["form-action"] == "'none'"
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["cross-origin-resource-policy"] == "same-origin"
    assert "server" not in headers
    refused = client.get(path, headers={"origin": "https://evil.example"}).headers
    assert refused["content-security-policy"] == headers["content-security-policy"]
    assert refused["cache-control"] == "no-store"


def test_the_viewer_has_no_inline_script_and_parses_no_markup() -> None:
    for name, file in static_files().items():
        text = file.content.decode("utf-8")
        assert not re.search(r"https?://", text.removeprefix(UPLOT_BANNER)), name
        if name.endswith(".html"):
            assert not re.search(r"<script(?![^>]*\bsrc=)|<style|\son\w+=|\sstyle=", text), name
        for risky in (
            "innerHTML", "outerHTML", "insertAdjacentHTML", "document.write", "eval(", "new Function",
            "srcdoc", "DOMParser", "createContextualFragment", "javascript:", "localStorage",
        ):  # fmt: skip
            assert risky not in text, name


def test_answers_that_contain_markup_are_json_and_never_html(client: httpx.Client) -> None:
    answer = client.get("/api/passes", params={"line": MAIN, "direction": UP})
    assert answer.headers["content-type"] == "application/json"
    assert answer.json()["passes"][0]["run"] == "<i>06:12</i>"
    unknown = client.get(
        "/api/passes", params={"line": "<script>alert(1)</script>", "direction": UP}
    )
    assert unknown.headers["content-type"] == "application/json"
    assert client.get(f"/{quote('<script>')}").headers["content-type"] == "application/json"


# --- listening ----------------------------------------------------------------------------------


def test_only_a_loopback_address_needs_no_token() -> None:
    for host, token, generated in (
        ("127.0.0.1", None, False), ("localhost", None, False), ("0.0.0.0", None, True), ("0.0.0.0", TOKEN, False),
        ("127.0.0.1", TOKEN, False),
    ):  # fmt: skip
        on = bind(host, 0, token)
        on.socket.close()
        assert on.token_generated is generated
        assert (on.settings.token is None) is (token is None and not generated)
        if generated:
            assert len(str(on.settings.token)) >= 40


def test_a_port_in_use_or_an_unknown_address_is_refused() -> None:
    on = bind("127.0.0.1", 0)
    with on.socket, pytest.raises(FileError, match="choose another with --port"):
        bind("127.0.0.1", on.socket.getsockname()[1])
    with pytest.raises(FileError, match="does not have the address"):
        bind("no.such.host.invalid", 0)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "cannot be read"),
        (b"short", "20 characters"),
        (b"two words of a long token", "one word"),
        (b"\xff" * 30, "cannot be read"),
    ],
)
def test_a_file_without_a_valid_token_is_refused(
    tmp_path: Path, content: bytes | None, words: str
) -> None:
    file = tmp_path / "token"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(FileError, match=words):
        session.read_token(file)


def exit_of(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[object, str, str]:
    with pytest.raises(SystemExit) as end:
        main(["serve", *arguments])
    out, err = capsys.readouterr()
    return end.value.code, out, err


def test_a_missing_or_newer_store_is_reported_in_one_sentence(tmp_path: Path, capsys) -> None:
    assert exit_of(capsys, "--store", str(tmp_path / "none"))[0] == 1
    create(str(tmp_path / "newer"))
    (tmp_path / "newer" / "store.json").write_text('{"schema": 99}')
    code, out, err = exit_of(capsys, "--store", str(tmp_path / "newer"))
    assert (code, out) == (1, "")
    assert err.startswith("trackprofile: ")
    assert err.count("\n") == 1
    assert "schema 99" in err


def test_missing_libraries_are_reported_with_the_command_to_install_them(
    dated_store: Store, capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [name for name in sys.modules if name.startswith("trackprofile.server")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    code, _, err = exit_of(capsys, "--store", dated_store.url)
    assert code == 1
    assert "pip install 'trackprofile[network]'" in err


@pytest.mark.parametrize(
    "host", ["0.0.0.0", pytest.param("127.0.0.1", marks=pytest.mark.acceptance)]
)
def test_serve_prints_its_address_and_ends_when_interrupted(dated_store: Store, host: str) -> None:
    command = [
        sys.executable,
        "-m",
        "trackprofile",
        "serve",
        "--store",
        dated_store.url,
        "--port",
        "0",
    ]
    with subprocess.Popen(
        [*command, "--host", host, "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as running:
        assert running.stdout is not None
        started = json.loads(running.stdout.readline())
        headers = {"authorization": f"Bearer {started['token']}"} if started["token"] else {}
        answer = httpx.get(
            started["address"] + "api/lines", headers=headers, trust_env=False, timeout=60
        )
        plain = httpx.get(started["address"] + "api/lines", trust_env=False, timeout=60)
        running.send_signal(signal.SIGINT)
        out, err = running.communicate(timeout=60)
    assert answer.status_code == 200
    assert plain.status_code == (200 if host == "127.0.0.1" else 401)
    assert (running.returncode, out, err) == (0, "", "")
    assert (started["token"] is None) is (host == "127.0.0.1")
