"""Pages that are made of the program have all of it, and the site of all pages is built."""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import fields

import pytest
from handbook_pages import PAGES

from sldvexp.cli import handbook, reference, site
from sldvexp.config import docs, registry
from sldvexp.config.experiment import Experiment


def test_every_setting_is_in_the_page_of_settings():
    page, count = reference.settings(), 0
    assert all(f"\n- `{field.name}`" in page for field in fields(Experiment))
    for group in registry.GROUPS:
        for name in registry.BUILT_IN[group]:
            part = page.split(f"### `{group}={name}`\n")[1].split("\n##")[0]
            for one in docs.parameters_of(registry.get(group, name), {}):
                assert f"- `{one.key}`:" in part, (group, name)
                count += 1
    assert count > 400


def test_every_public_function_is_in_the_page_of_functions():
    page, count = reference.functions(), 0
    for room in reference.rooms():
        part = page.split(f"\n## {room}\n")[1].split("\n## ")[0]
        for name, thing in reference.public(room).items():
            assert f"### `{name}`\n" in part, (room, name)
            count += callable(thing)
    assert count > 150
    assert "did you mean" not in page or "nearest" in page
    assert "\n> " not in page  # nothing that Markdown would take for a quotation


@pytest.mark.whole
def test_every_public_function_is_told_of_also_without_the_extras():
    extras = (
        "cholespy cv2 dask distributed meshio numba skfem sdypy starlette uvicorn websockets "
        "joblib ray"
    )
    script = f"""
import sys
sys.modules.update(dict.fromkeys({extras.split()}))
from sldvexp.cli import reference
print(reference.functions())
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    names = re.compile(r"^### .*", re.MULTILINE)
    assert names.findall(done.stdout) == names.findall(reference.functions())
    told = done.stdout.split("### `Console`\n")[1].split("#")[0]
    assert told.strip() == "Needs the package uvicorn, which is not installed."


def test_every_page_is_in_one_chapter_and_one_list(sldvexp):
    listed = [name for names in handbook.chapters().values() for name in names]
    assert sorted(listed) == sorted(PAGES)
    out = sldvexp("handbook").out
    for name in (*PAGES, *reference.PAGES):
        assert f"\n  {name} " in out


@pytest.mark.one_in(3)
@pytest.mark.parametrize("name", reference.PAGES)
def test_made_pages_are_shown(sldvexp, name):
    done = sldvexp("handbook", name)
    assert done.status == 0
    assert done.out == reference.PAGES[name]()


def test_names_of_pages_become_links_and_names_of_files_captions():
    text = "See `sldvexp handbook theory`.\n\n```yaml lab/a.yaml\na: 1\n```\n\n"
    text += "```console long\n$ ls\n```\n"
    assert site.for_sphinx(text) == (
        "See [](theory.md).\n\n```{code-block} yaml\n:caption: lab/a.yaml\n\na: 1\n```\n\n"
        "```console\n$ ls\n```\n"
    )


def test_site_without_its_tool_is_told_how_to_get_it(sldvexp, monkeypatch):
    monkeypatch.setitem(sys.modules, "sphinx.application", None)
    done = sldvexp("handbook", "site=manual")
    assert (done.status, done.out) == (1, "")
    assert done.err == ("sldvexp: handbook: a site needs sphinx: pip install 'sldvexp[docs]'\n")


@pytest.mark.long
def test_site_is_built_without_a_warning(tmp_path):
    pytest.importorskip("sphinx")
    page = site.build(tmp_path / "site", gallery=site.GALLERY[2:])
    built = {file.stem for file in page.parent.glob("*.html")}
    assert built > {*PAGES, *reference.PAGES, "gallery"}
    links = [f for f in page.parent.glob("*.html") if 'src="http' in f.read_text(encoding="utf-8")]
    assert links == []  # it works offline
