"""The site, without Sphinx: pages, links, pictures, and that the commands in it are commands."""

import re
import shlex
from importlib import import_module
from pathlib import Path

import pytest
from cyclopts import CycloptsError

from resample.samples.finding import expanded
from tests.commands import ended
from tools import command_pages
from tools.pages import (
    BUILT,
    DOCS,
    LINKED,
    PAGES,
    ROOT,
    SCRIPTS,
    TUTORIALS,
    commands,
    runs_as_it_stands,
    shown_by,
)


def named(path):
    """Name of a page as trees give it: from docs/, without its suffix."""
    return path.relative_to(DOCS).with_suffix("").as_posix()


def entries(page):
    """Pages in a page's trees, by the name that `named` gives."""
    text = page.read_text(encoding="utf-8")
    for tree in re.findall(r"^```\{toctree\}\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
        for line in tree.splitlines():
            if line and not line.startswith(":"):
                place = (page.parent / line.strip()).resolve()
                yield place.relative_to(DOCS).as_posix()


def reached(page, seen=()):
    """Names of a page and of all below it."""
    yield page
    path = DOCS / f"{page}.md"
    if path.exists():
        for entry in entries(path):
            assert entry not in seen, f"{entry} is in its own tree"
            yield from reached(entry, (*seen, page))


def prose(path):
    """Text without its blocks and spans of code."""
    text = re.sub(
        r"^```.*?^```", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL
    )
    return re.sub(r"`[^`\n]*`", "", text)


def app_of(program):
    """Command line of a program."""
    if program == "resample":
        return import_module("resample.cli").app
    return import_module(f"resample_{program.removeprefix('resample-')}.cli").app


def test_every_page_is_in_the_tree_once():
    below = [page for page in reached("index") if page.split("/")[0] not in BUILT]
    assert sorted(below) == sorted(named(path) for path in PAGES)


@pytest.mark.parametrize("path", LINKED, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_relative_links_and_pictures_exist(path):
    links = re.findall(r"\]\(([^)\s]+)\)|^:img-top: (.+)$", prose(path), re.MULTILINE)
    links = [link for pair in links for link in pair if link]
    missing = [
        link
        for link in links
        if not re.match(r"[a-z]+:|#", link) and not (path.parent / link.partition("#")[0]).exists()
    ]
    assert not missing


@pytest.mark.parametrize("path", PAGES, ids=named)
def test_references_between_pages_lead_to_pages(path):
    known = {f"/{named(page)}" for page in PAGES} | {"/gallery/index", "/tutorials/index"}
    known |= {f"/gallery/{script.parent.name}/{script.stem}" for script in SCRIPTS}
    known |= {f"/tutorials/{script.stem}" for script in TUTORIALS}
    asked = re.findall(r"\{doc\}`(?:[^<`]*<)?([^>`]+)>?`", path.read_text(encoding="utf-8"))
    assert [place for place in asked if place not in known] == []


def test_there_is_an_example_for_every_figure_of_the_paper_and_fifteen_in_all():
    assert len(SCRIPTS) >= 15
    named_after = [path.stem for path in SCRIPTS if "figure" in path.stem]
    assert set("".join(re.findall(r"\d", " ".join(named_after)))) == set("123456789")


@pytest.mark.parametrize("script", [*SCRIPTS, *TUTORIALS], ids=lambda path: path.stem)
def test_an_example_tells_the_command_that_makes_the_same(script):
    assert shown_by(script)


def fault(path, line):
    """What is wrong with a command, or nothing."""
    if within := re.search(r"\$\((.+?)\)", line):  # a command whose output is a file's name
        return fault(path, within[1]) or fault(path, line.replace(within[0], "file"))
    program, *words = shlex.split(line, comments=True)
    if program == "python":
        return "" if (ROOT / words[0]).exists() else f"{path}: {words[0]} is not there"
    if "..." in words:
        return ""
    if "--settings" in words:  # a file that would be read
        place = words.index("--settings")
        del words[place : place + 2]
    try:
        words = expanded(words)
        app_of(program).parse_args(words, exit_on_error=False, print_error=False)
    except (CycloptsError, ImportError) as error:
        return f"{path.relative_to(ROOT)}: {line}: {error}"
    return ""


@pytest.mark.sweep
def test_a_command_within_a_command_is_checked_too():
    assert not fault(DOCS, "resample-volume render $(resample-volume fetch engine) -o a.png")
    assert "fetsh" in fault(DOCS, "resample-volume render $(resample-volume fetsh engine) -o a.png")


def written(text):
    """A page without its generated tables."""
    return re.sub(r"<!-- scores: \w+ -->.*?<!-- end -->", "", text, flags=re.DOTALL)


def test_the_front_page_is_short_with_one_figure_and_one_table():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(written(text).split()) <= 850
    assert text.count("![") == 1
    assert len(re.findall(r"^\|[-|]+\|$", text, re.MULTILINE)) == 1


@pytest.mark.parametrize("page", ["quality", "performance"])
def test_measurements_are_one_page_and_say_what_prints_them(page):
    text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    assert len(written(text).split()) <= 700
    for part in re.split(r"^## ", text, flags=re.MULTILINE)[1:]:
        assert re.search(r"python -m|make |benchmarks\.", part), part.partition("\n")[0]


def test_modules_that_the_measurements_name_are_there():
    for page in (ROOT / "README.md", DOCS / "quality.md", DOCS / "performance.md"):
        text = page.read_text(encoding="utf-8")
        for name in re.findall(r"(?<![./])((?:tests\.)?benchmarks(?:\.\w+)?)", text):
            place = ROOT / name.replace(".", "/")
            assert place.is_dir() or place.with_suffix(".py").exists(), name


@pytest.mark.sweep
def test_options_that_no_command_has_are_found():
    assert not fault(DOCS, "resample-volume render checker-box --shadows -o a.png")
    assert "--shadow" in fault(DOCS, "resample-volume render checker-box --shadow 3 -o a.png")
    assert "paint" in fault(DOCS, "resample-volume paint checker-box -o a.png")


def with_options_of_their_own(found):
    """Commands that have a word no other has: a command's own name, or an option of it."""
    seen = set()
    for path, line in found:
        words = shlex.split(line, comments=True)
        named = {word.partition("=")[0] for word in words[2:] if word.startswith("-")}
        new = {(*words[:2], word) for word in ("", *named)} - seen
        if new:
            yield path, line
        seen |= new


@pytest.mark.sweep
def test_every_option_that_the_docs_give_a_command_parses():
    found = list(with_options_of_their_own(sorted(commands(), key=lambda one: -len(one[1]))))
    assert len(found) > 40
    assert [said for path, line in found if (said := fault(path, line))] == []


@pytest.mark.sweep
def test_every_command_of_the_docs_parses():
    found = list(commands())
    assert len(found) > 120
    assert [said for path, line in found if (said := fault(path, line))] == []


GENERATED = pytest.mark.sweep


@pytest.mark.sweep
@pytest.mark.parametrize(
    "program",
    ["resample", *(pytest.param(name, marks=GENERATED) for name in command_pages.PROGRAMS[1:])],
)
def test_a_command_has_a_page_with_all_of_its_options(program):
    app, generated = command_pages.app_of(program), command_pages.pages([program])
    names = command_pages.names_of(program, app)
    assert set(generated) == {"index", f"{program}/index", *(f"{program}/{one}" for one in names)}
    for name in names:
        shown = [one for one in app[name].assemble_argument_collection() if one.show]
        options = {word for one in shown for word in one.names if word.startswith("--")}
        missing = {word for word in options if word not in generated[f"{program}/{name}"]}
        assert not {word for word in missing if not word.startswith(("--no-", "--empty-"))}
    for text in generated.values():
        for line in re.findall(r"^\$ (.+)$", text.replace("\\\n", ""), re.MULTILINE):
            assert not fault(DOCS / program, line)


def test_examples_in_help_are_blocks_of_command_pages():
    assert command_pages.with_examples(
        "A.\n\nFor example:\n\n    resample plugins \\\n        filters\n    resample view\n\nB.\n"
    ) == ("A.\n\n```console\n$ resample plugins \\\n    filters\n$ resample view\n```\n\nB.\n")


def test_pages_that_no_command_has_any_more_are_removed(tmp_path):
    (tmp_path / "gone.md").write_text("# gone\n")
    command_pages.write(tmp_path, ["resample"])
    assert not (tmp_path / "gone.md").exists()
    assert (tmp_path / "resample" / "plugins.md").exists()


@pytest.mark.sweep
@pytest.mark.parametrize(
    "line", sorted({line for _, line in commands() if runs_as_it_stands(line)})
)
def test_commands_of_built_in_data_run(line, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    program, *words = shlex.split(line, comments=True)
    assert ended(app_of(program), *words) == 0
    assert not words.count("-o") or Path(words[words.index("-o") + 1]).stat().st_size > 0
