"""Sources: public address, wheel, mirror; no network but this machine's own."""

import functools
import hashlib
import http.server
import sys
import threading
import zipfile

import pytest

from imuloop.core.errors import ImuloopError
from imuloop.ingest.sources import fetch

CONTENT = b"t,ax\n0,1\n" * 1000
DIGEST = hashlib.sha256(CONTENT).hexdigest()
# no server listens at this port
CLOSED = "http://127.0.0.1:9"
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
def wheel(tmp_path, monkeypatch):
    """Make a wheel the only thing that pip can find; importing it would fail."""
    folder = tmp_path / "wheels"
    folder.mkdir()
    # data and metadata are all that pip download looks at
    with zipfile.ZipFile(folder / "tiny_recordings-1.0-py3-none-any.whl", "w") as archive:
        archive.writestr("tiny_recordings/__init__.py", "raise RuntimeError('was imported')")
        archive.writestr(MEMBER, CONTENT)
        info = "tiny_recordings-1.0.dist-info"
        about = "Metadata-Version: 2.1\nName: tiny-recordings\nVersion: 1.0\n"
        about += "Requires-Python: >=99\nRequires-Dist: no-such-package\n"
        archive.writestr(f"{info}/METADATA", about)
        tags = "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
        archive.writestr(f"{info}/WHEEL", tags)
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


FAULTS = {
    # a wrong source, and the line about it
    "no such file": ({"url": "{server}/none.csv"},
                     r"none\.csv .*the server answers 404.*download http"),
    "a wrong hash": ({"sha256": "0" * 64}, rf"has SHA-256 {DIGEST}, expected 0{{64}}"),
    "offline": ({"url": "{closed}/log.csv"},
                rf"log.csv is not at hand .*download {{closed}}/log.csv .*_MIRROR .*{DIGEST}"),
    "no such wheel": ({"wheel": "tiny-recordings==2.0", "member": MEMBER},
                      r"No matching distribution.*take tiny_rec.*log\.csv out"),
    "no such member": ({"wheel": "tiny-recordings==1.0", "member": "log.cvs"},
                       r"no member 'log\.cvs'"),
    "another file": ({"wheel": "tiny-recordings==1.0", "member": MEMBER, "sha256": "1" * 64},
                     r"from tiny-recordings==1\.0 has SHA-256"),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_a_file_that_cannot_be_had_is_one_line_and_leaves_nothing(server, wheel, target, name):
    changed, line = FAULTS[name]
    source = {"url": f"{server}/log.csv", "sha256": DIGEST} | changed
    source["url"] = source["url"].format(server=server, closed=CLOSED)
    with pytest.raises(ImuloopError, match=line.replace("{closed}", CLOSED)) as caught:
        fetch(source, target)
    assert "\n" not in str(caught.value)
    assert not target.parent.exists() or not list(target.parent.iterdir())


def test_a_url_is_fetched_whole_and_quietly(server, target, capfd):
    fetch({"url": f"{server}/log.csv?raw=1", "sha256": DIGEST.upper()}, target)
    assert target.read_bytes() == CONTENT
    assert [path.name for path in target.parent.iterdir()] == ["log.csv"]
    # no bar without a terminal
    assert capfd.readouterr() == ("", "")


def test_a_mirror_is_taken_by_name_and_hash(server, target, tmp_path):
    mirror = tmp_path / "mirror"
    for folder, content in (("a", b"other"), ("b/c", CONTENT)):
        (mirror / folder).mkdir(parents=True)
        (mirror / folder / "log.csv").write_bytes(content)
    # loops, and a link that leads nowhere
    (mirror / "b" / "up").symlink_to(mirror)
    (mirror / "b" / "c" / "self").symlink_to(mirror / "b" / "c")
    (mirror / "a" / "nowhere").symlink_to(mirror / "none")
    fetch({"url": f"{CLOSED}/log.csv", "sha256": DIGEST}, target, mirror)
    assert target.read_bytes() == CONTENT and not target.is_symlink()
    # another version in it is not taken
    target.unlink()
    fetch({"url": f"{server}/log.csv", "sha256": DIGEST}, target, mirror / "a")
    assert target.read_bytes() == CONTENT
    with pytest.raises(ImuloopError, match="is not a folder"):
        fetch({"url": f"{server}/log.csv", "sha256": DIGEST}, target, tmp_path / "none")


def test_a_member_of_a_wheel_is_fetched_and_nothing_of_it_is_imported(wheel, target):
    fetch(wheel, target)
    assert target.read_bytes() == CONTENT
    assert "tiny_recordings" not in sys.modules
