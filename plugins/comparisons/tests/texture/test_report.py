import base64
import math
from html.parser import HTMLParser

import cv2
import numpy as np
import pytest

from resample_comparisons.texture.compare import PictureComparison, data_uri, page, write_report

VOID = {"meta", "input", "br", "img", "link"}
EVIL = "<script>alert('x')</script>"


def rows(zone: str, psnr: float) -> list[dict[str, object]]:
    numbers = {"psnr": psnr, "ssim": 0.9, "flip": 0.1, "ms": 2.5}
    better = {"psnr": math.inf, "ssim": 1.0, "flip": 0.0, "ms": 1.5}
    return [{"zone": zone, "method": "plain", **numbers}, {"zone": zone, "method": EVIL, **better}]


@pytest.fixture
def comparison(rng) -> PictureComparison:
    screens = {
        name: rng.random((70, 80, 3)).astype(np.float32) for name in ("truth", "plain", EVIL)
    }
    zones = {"whole": np.ones((70, 80), bool), "mixed": np.ones((70, 80), bool)}
    return PictureComparison(EVIL, screens, zones, rows("whole", 30.125) + rows("mixed", 20.0))


class Checker(HTMLParser):
    """Notes what a page holds and fails where tags do not close."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text: list[str] = []

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


@pytest.fixture
def parsed(comparison) -> Checker:
    checker = Checker()
    checker.feed(page(comparison, about={"view": EVIL}))
    checker.close()
    return checker


def test_every_tag_is_closed(parsed):
    assert parsed.open == []


def test_names_are_escaped(comparison, parsed):
    assert EVIL not in page(comparison, about={"view": EVIL})
    assert parsed.text.count(EVIL) >= 5  # title, heading, fact, table, choices


def test_the_page_needs_no_network(comparison):
    html = page(comparison, about={})
    assert "http" not in html
    assert "src=" not in html
    assert "@import" not in html


def test_each_picture_is_in_the_page_once(comparison):
    html = page(comparison, about={})
    for screen in comparison.screens.values():
        assert html.count(data_uri(screen)) == 1


def test_a_slider_lies_between_any_two_pictures(comparison, parsed):
    sliders = [attrs for tag, attrs in parsed.tags if tag == "input"]
    assert [slider["type"] for slider in sliders] == ["range"]
    options = [attrs["value"] for tag, attrs in parsed.tags if tag == "option" and "value" in attrs]
    assert options == ["p0", "p1", "p2"] * 2
    assert "clip-path: inset(0 calc(100% - var(--split)) 0 0)" in page(comparison, about={})


def test_details_show_a_zone_of_every_picture(parsed):
    details = [
        a for t, a in parsed.tags if t == "div" and "background-position" in a.get("style", "")
    ]
    assert [detail["class"] for detail in details] == ["picture p0", "picture p1", "picture p2"]


def test_the_table_has_all_numbers_with_the_best_in_bold(comparison):
    html = page(comparison, about={})
    assert '<td class="zone">30.12</td>' in html
    assert '<td class="zone best">equal</td>' in html
    assert '<td class="best">1.5</td>' in html
    assert html.count('<td class=" best">0.0000</td>') == 2


def test_a_data_uri_holds_the_picture(rng):
    levels = rng.integers(0, 256, (5, 6, 3), np.uint8)
    encoded = base64.b64decode(data_uri(levels / np.float32(255)).partition(",")[2])
    back = cv2.imdecode(np.frombuffer(encoded, np.uint8), cv2.IMREAD_COLOR)
    assert np.array_equal(back[..., ::-1], levels)


def test_a_report_is_written_whole_or_not(comparison, tmp_path):
    write_report(comparison, tmp_path / "r.html", about={})
    assert (tmp_path / "r.html").read_text(encoding="utf-8") == page(comparison, about={})
    with pytest.raises(OSError, match="cannot be written"):
        write_report(comparison, tmp_path / "none" / "r.html", about={})
    assert [path.name for path in tmp_path.iterdir()] == ["r.html"]
