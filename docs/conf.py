"""The site: `make docs` builds it offline, into docs/_build/html."""

import ast
import inspect
import os
import re
import shutil
import sys
import textwrap
from pathlib import Path

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml

os.environ.setdefault("RESAMPLE_LOG", "warning")
ROOT = Path(__file__).parents[1]
IS_CHECK = "CHECK" in os.environ  # `make docs-check`: all but the pictures of examples

project = "hybrid-resample"
author = "the hybrid-resample authors"
copyright = "the hybrid-resample authors; MIT licence"  # noqa: A001
extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = ["_build", "**/*.ipynb", "**/sg_execution_times.rst", "sg_execution_times.rst"]
templates_path = ["_templates"]
source_suffix = {".rst": "restructuredtext", ".md": "markdown"}

# Markdown: formulas between dollars, fences with colons, and links to headings.
myst_enable_extensions = ["dollarmath", "amsmath", "colon_fence", "deflist"]
myst_heading_anchors = 3
highlight_language = "python"
suppress_warnings = ["config.cache", "misc.highlighting_failure"]
suppress_warnings += ["image.not_readable"] if IS_CHECK else []

autosummary_generate = True
autodoc_typehints = "none"  # signatures have them
autodoc_member_order = "bysource"
numpydoc_show_class_members = False
python_display_short_literal_types = True

html_theme = "pydata_sphinx_theme"
html_title = "hybrid-resample"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "navbar_end": ["theme-switcher"],
    "navbar_persistent": ["search-button"],
    "header_links_before_dropdown": 6,
    "show_toc_level": 2,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "pygments_light_style": "friendly",
    "pygments_dark_style": "monokai",
}
html_sidebars = {page: [] for page in ("index", "quality", "performance", "glossary")}
html_math_renderer = "mathml"  # browsers know it; MathJax would have to be fetched


def pictures(block, block_vars, gallery_conf):  # noqa: ARG001 - sphinx-gallery's parameters
    """Figures of the pictures that a part of an example has saved; their names are captions."""
    folder = Path(block_vars["src_file"]).parent
    found = sorted(
        (path for path in folder.iterdir() if path.suffix in {".png", ".webp"}),
        key=lambda path: path.stat().st_mtime_ns,
    )
    lines = [".. container:: pictures", ""] if found else []
    for path, goal in zip(found, block_vars["image_path_iterator"], strict=False):
        target = Path(goal).with_suffix(path.suffix)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.move(path, target)
        lines += _figure(target, gallery_conf["src_dir"], path.stem.replace("-", " "))
    return "\n".join(lines)


def _figure(path, source, caption):
    """A figure whose pixels are shown enlarged, if it has few."""
    from PIL import Image

    with Image.open(path) as picture:
        width = picture.width
    times = max(1, 300 // width)
    place = "/" + path.relative_to(source).as_posix()
    options = [f"      :width: {times * width}px", f"      :alt: {caption}"]
    options += ["      :figclass: enlarged"] if times > 1 else []
    return [f"   .. figure:: {place}", *options, "", f"      {caption}", ""]


sphinx_gallery_conf = {
    "examples_dirs": ["../examples/gallery", "../examples/tutorials"],
    "gallery_dirs": ["gallery", "tutorials"],
    "subsection_order": lambda folder: ["texture", "warp3d", "points", "volume", "core"].index(
        Path(folder).name
    ),
    "within_subsection_order": "FileNameSortKey",
    "image_scrapers": (pictures,),
    "reset_modules": (),
    "capture_repr": (),
    "download_all_examples": False,
    "show_memory": False,
    "show_signature": False,
    "min_reported_time": 1e9,
    "write_computation_times": False,
    "remove_config_comments": True,
    "thumbnail_size": (400, 280),
    "abort_on_example_error": False,
    "plot_gallery": not IS_CHECK,
}


def fields_of(kind):
    """Names and trailing comments of a class's fields, as its source has them."""
    try:
        lines = textwrap.dedent(inspect.getsource(kind)).splitlines()
    except (OSError, TypeError):
        return {}
    tree = ast.parse("\n".join(lines)).body[0]
    if not isinstance(tree, ast.ClassDef):
        return {}
    fields = {}
    for node in tree.body:
        if isinstance(node, ast.AnnAssign) and not node.target.id.startswith("_"):
            comment = re.search(r"(?<!#)# (?!noqa|type:)(.+)$", lines[node.end_lineno - 1])
            fields[node.target.id] = (
                ast.unparse(node.annotation).strip("'\""),
                comment[1] if comment else "",
            )
    return fields


def tell_fields(app, what, name, kind, options, lines):  # noqa: ARG001 - Sphinx's
    """Add what the comments beside a class's fields say to its page."""
    fields = fields_of(kind) if what == "class" else {}
    if not fields or "Parameters" in lines or "Attributes" in lines:
        return
    lines += ["", "Attributes", "----------"]
    for field, (annotation, comment) in fields.items():
        said = comment.replace("\\", "\\\\").replace("*", "\\*").replace("|", "\\|")
        lines += [f"{field} : {annotation}", f"    {said}" if said else "    \\ "]


def skip_fields(app, what, name, member, skip, options):  # noqa: ARG001 - Sphinx's
    """Fields of tuples are told of with their class."""
    return True if type(member).__name__ == "_tuplegetter" else skip


def write_formula(page, node):
    """Put a formula into a page as MathML."""
    is_block = isinstance(node, nodes.math_block)
    formula = tex2mathml(node.astext(), as_block=is_block)
    page.body.append(f'<div class="formula">{formula}</div>' if is_block else formula)
    raise nodes.SkipNode


def name_notes(app, name, source):  # noqa: ARG001 - Sphinx's
    """Name lab notes, which are no part of the site, where pages link to them."""
    link = re.compile(r"\[([^\]]+)\]\((?:\.\./)+(notes/[^)]*)\)")
    source[0] = link.sub(r"\1 (`\2` in the source)", source[0])


def write_command_pages(app):
    """Write a page per command from their definitions."""
    from tools.command_pages import write

    write(Path(app.srcdir) / "commands")


def setup(app):
    """Connect what is done to docstrings; ours before numpydoc's."""
    sys.path.insert(0, str(ROOT))
    app.connect("autodoc-process-docstring", tell_fields, priority=400)
    app.connect("source-read", name_notes)
    app.connect("builder-inited", write_command_pages)
    app.add_html_math_renderer("mathml", (write_formula, None), (write_formula, None))
    app.connect("autodoc-skip-member", skip_fields)
