"""The documentation as a site: built with warnings as errors, and every link within it leads somewhere."""

import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import pytest

import rcdn

pytestmark = pytest.mark.xdist_group("site")  # one build
ROOT = Path(__file__).parents[1]
pytest.importorskip("sphinx", reason="the extra docs isn't installed: pip install -e '.[docs]'")
pytest.importorskip("furo")
pytest.importorskip("myst_parser")


class Page(HTMLParser):
    """Links, pictures and anchors of a page."""

    def __init__(self, text):
        super().__init__()
        self.links, self.anchors = [], set()
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        for name, value in attrs:
            if name == "id":
                self.anchors.add(value)
            elif value and name in ("href", "src") and tag != "link":
                self.links.append(value)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Folder of the built site."""
    out = tmp_path_factory.mktemp("site")
    options = ["-n", "-W", "--keep-going", "-q", "-E", "-c", "docs", "-d", str(out / "doctrees")]
    words = [sys.executable, "-m", "sphinx", *options, str(ROOT), str(out / "html")]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stderr == ""
    return out / "html"


@pytest.fixture(scope="module")
def pages(site):
    return {path: Page(path.read_text()) for path in site.rglob("*.html")}


def test_every_page_of_the_repository_is_there(site):
    for path in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]:
        assert (site / path.relative_to(ROOT).with_suffix(".html")).exists(), path


def test_every_link_within_the_site_leads_somewhere(pages):
    bad = []
    for path, page in pages.items():
        for link in page.links:
            if link.startswith(("http:", "https:", "data:", "mailto:")):
                continue
            name, _, anchor = unquote(link).partition("#")
            name = name.partition("?")[0]
            target = (path.parent / name).resolve() if name else path
            if not target.exists() or (anchor and target in pages and anchor not in pages[target].anchors):
                bad.append((path.name, link))
    assert bad == []


def test_links_and_anchors_are_read():
    page = Page('<p id="here"><a href="#there">x</a><img src="none.png"></p>')
    assert page.links == ["#there", "none.png"]
    assert page.anchors == {"here"}


def test_every_public_name_is_in_the_reference(pages):
    known = {anchor for page in pages.values() for anchor in page.anchors}
    homes = ("rcdn", "rcdn.types")
    for name in rcdn.__all__:
        assert name == "__version__" or any(f"{home}.{name}" in known for home in homes), name
