"""A report leads to the web page of the clone that made it, and to none that it does not know."""

import shutil
import subprocess

import pytest

from imuloop.report.provenance import provenance, web_page
from imuloop.report.report import write_report
from soundness import Page


@pytest.mark.parametrize(
    ("address", "page"),
    [
        ("https://code.example/lab/imuloop.git", "https://code.example/lab/imuloop"),
        ("https://code.example/lab/imuloop/", "https://code.example/lab/imuloop"),
        ("https://me:secret@code.example:8443/imuloop", "https://code.example:8443/imuloop"),
        ("git@code.example:lab/imuloop.git", "https://code.example/lab/imuloop"),
        ("ssh://git@code.example:22/lab/imuloop.git", "https://code.example/lab/imuloop"),
        ("http://[::1", None),
        ("/srv/git/imuloop.git", None),
        ("../imuloop", None),
        ("file:///srv/git/imuloop.git", None),
        ("javascript:alert(1)", None),
        ("", None),
    ],
)
def test_page_of_an_address_has_no_password_and_a_path_has_none(address, page):
    assert web_page(address) == page


def test_report_of_a_clone_links_to_its_origin(results, tmp_path):
    clone = tmp_path / "clone"
    git = ["git", "-C", clone]
    subprocess.run(["git", "init", "--quiet", clone], check=True)
    (clone / "Snakefile").touch()
    made_by = provenance("0.2.0", clone, "make report", {})
    assert "repository" not in made_by
    address = "https://name:secret@code.example/lab/imuloop.git"
    subprocess.run([*git, "remote", "add", "origin", address], check=True)
    made_by = provenance("0.2.0", clone, "make report", {})
    assert made_by["repository"] == "https://code.example/lab/imuloop"

    folder = shutil.copytree(results, tmp_path / "results")
    assert "code.example" not in (folder / "report.html").read_text("utf-8")
    write_report([folder / "partly"], made_by, folder / "report.html", folder / "comparison.csv")
    page = Page((folder / "report.html").read_text("utf-8"))
    links = [link.get("href") for link in page.all("a")]
    assert "https://code.example/lab/imuloop#readme" in links
    assert "secret" not in str(page.elements)
