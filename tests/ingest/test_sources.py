"""Sources: public address, wheel, mirror; no network but this machine's own."""

import functools
import hashlib
import http.server
import socket
import sys
import threading
import zipfile

import pytest

from imuloop.core.errors import ImuloopError
from imuloop.ingest.sources import fetch

CONTENT = b"t,ax\n0,1\n" * 1000
DIGEST = hashlib.sha256(CONTENT).hexdigest()
MEMBER = "tiny_recordings/data/log.csv"


@pytest.fixture
def server(tmp_path):
    folder = tmp_path / "served"
    folder.mkdir()
    (folder / "log.csv").write_bytes(CONTENT)

    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *words):
            pass

    handler = functools.partial(Quiet, directory=folder)
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as httpd:
        thread = threading.Thread(target=httpd.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{httpd.server_address[1]}"
        httpd.shutdown()
        thread.join()


@pytest.fixture
def closed():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    return f"http://127.0.0.1:{port}"


@pytest.fixture
def wheel(tmp_path, monkeypatch):
    """Make a wheel the only thing that pip can find; importing it would fail."""
    folder = tmp_path / "wheels"
    folder.mkdir()
    # data and metadata are all that pip download looks at
    with zipfile.ZipFile(folder / "tiny_recordings-1.0-py3-none-any.whl", "w") as archive:
        archive.writestr("tiny_recordings/__init__.py", "raise RuntimeError('was imported')")
        archive.writestr(MEMBER, CONTENT)
        info = "tiny_recordings-1.0.dist-info"
        archive.writestr(
            f"{info}/METADATA",
            "Metadata-Version: 2.1\nName: tiny-recordings\nVersion: 1.0\n"
            "Requires-Python: >=99\nRequires-Dist: no-such-package\n",
        )
        archive.writestr(
            f"{info}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
        )
        archive.writestr(f"{info}/RECORD", "")
    # neither the machine's pip settings nor a registry take part
    monkeypatch.setenv("PIP_CONFIG_FILE", "/dev/null")
    monkeypatch.delenv("PIP_EXTRA_INDEX_URL", raising=False)
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(folder))
    return {"wheel": "tiny-recordings==1.0", "member": MEMBER, "sha256": DIGEST}


@pytest.fixture
def target(tmp_path):
    return tmp_path / "cache" / "log.csv"


def nothing_left(target):
    return not target.parent.exists() or not list(target.parent.iterdir())


def test_a_url_is_fetched_whole_and_quietly(server, target, capfd):
    fetch({"url": f"{server}/log.csv?raw=1", "sha256": DIGEST.upper()}, target)
    assert target.read_bytes() == CONTENT
    assert [path.name for path in target.parent.iterdir()] == ["log.csv"]
    # no bar where nobody watches
    assert capfd.readouterr() == ("", "")


def test_a_wrong_hash_names_both_and_leaves_nothing(server, target):
    with pytest.raises(ImuloopError, match=r"none\.csv .*the server answers 404.*download http"):
        fetch({"url": f"{server}/none.csv", "sha256": DIGEST}, target)
    with pytest.raises(ImuloopError, match=rf"has SHA-256 {DIGEST}, expected 0{{64}}"):
        fetch({"url": f"{server}/log.csv", "sha256": "0" * 64}, target)
    assert nothing_left(target)


def test_offline_says_what_is_missing_where_it_is_and_where_to_put_it(closed, target):
    with pytest.raises(ImuloopError) as caught:
        fetch({"url": f"{closed}/log.csv", "sha256": DIGEST}, target)
    text = str(caught.value)
    for part in ("log.csv is not at hand", f"download {closed}/log.csv", "IMULOOP_MIRROR", DIGEST):
        assert part in text
    assert "\n" not in text
    assert nothing_left(target)


def test_a_mirror_is_taken_by_name_and_hash(closed, target, tmp_path):
    mirror = tmp_path / "mirror"
    for folder, content in (("a", b"other"), ("b/c", CONTENT)):
        (mirror / folder).mkdir(parents=True)
        (mirror / folder / "log.csv").write_bytes(content)
    # loops, and a link that leads nowhere
    (mirror / "b" / "up").symlink_to(mirror)
    (mirror / "b" / "c" / "self").symlink_to(mirror / "b" / "c")
    (mirror / "a" / "nowhere").symlink_to(mirror / "none")
    fetch({"url": f"{closed}/log.csv", "sha256": DIGEST}, target, mirror)
    assert target.read_bytes() == CONTENT
    assert not target.is_symlink()


def test_a_mirror_with_another_version_is_not_taken(server, target, tmp_path):
    (tmp_path / "mirror").mkdir()
    (tmp_path / "mirror" / "log.csv").write_bytes(b"other")
    fetch({"url": f"{server}/log.csv", "sha256": DIGEST}, target, tmp_path / "mirror")
    assert target.read_bytes() == CONTENT
    with pytest.raises(ImuloopError, match="is not a folder"):
        fetch({"url": f"{server}/log.csv", "sha256": DIGEST}, target, tmp_path / "none")


def test_a_member_of_a_wheel_is_fetched_and_nothing_of_it_is_imported(wheel, target):
    for changed, line in (
        (
            {"wheel": "tiny-recordings==2.0"},
            r"No matching distribution.*take tiny_rec.*log\.csv out",
        ),
        ({"member": "log.cvs"}, r"no member 'log\.cvs'"),
        ({"sha256": "1" * 64}, r"from the wheel tiny-recordings==1\.0 has SHA-256"),
    ):
        with pytest.raises(ImuloopError, match=line):
            fetch({**wheel, **changed}, target)
        assert nothing_left(target)
    fetch(wheel, target)
    assert target.read_bytes() == CONTENT
    assert "tiny_recordings" not in sys.modules
