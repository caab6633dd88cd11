"""The page of a table: what is on it, that text stays text, and that it works in a browser."""

import base64
import csv
import hashlib
import json
import re
import shutil
import time
from collections.abc import Iterator
from html.parser import HTMLParser
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image
from typer.testing import CliRunner

import torchlinf
from torchlinf.cli.app import app
from torchlinf.measure import Measure
from torchlinf.report.masks import MOST_LEVELS, STEP, MaskReader, profile_values, thumbnail
from torchlinf.report.rows import Table
from torchlinf.scoring import find_masks, score_mask

pytest.importorskip("bokeh", reason="a report needs bokeh: pip install 'torchlinf[report]'")
from torchlinf.report import write_report

WINDOWS = {"complexity": (0.0, 1.0), "complexity_low": (0.0, 0.25), "complexity_high": (0.25, 1.0)}
MEASURE = Measure(windows=WINDOWS).settings()
ATTACKS = (
    "<script>alert(1)</script>.png",
    "</script><script>alert(1)</script>",
    '" onerror="alert(1)" x="',
    "' onload='alert(1)'",
    "<img src=x onerror=alert(1)>",
    "<%= alert(1) %>${alert(1)}{{ 7 * 7 }}<!--",
    "\\u003cscript\\u003e@c0@thumb$x",
    "a\u2028b\x00c\x1b[31m\ud800",
)


def row(path: str, complexity: float | None = None, error: str | None = None, **cells: Any) -> dict[str, Any]:
    value = dict.fromkeys(WINDOWS, complexity)
    return {"path": path, **value, "error": error, "version": "9.8.7", "measure": MEASURE, **cells}


def scored(path: str, mask: np.ndarray) -> dict[str, Any]:
    numbers = score_mask(mask)
    return {"path": path, **numbers, "error": None, "version": torchlinf.__version__, "measure": MEASURE}


def blob(seed: int, size: int = 40) -> np.ndarray:
    """A disc with a square and some notches: no two seeds give equal numbers."""
    y, x = np.mgrid[:size, :size] - size // 2
    mask = x**2 + y**2 < (size * (0.3 + 0.01 * seed)) ** 2
    mask[size // 2 :, size // 2 - seed : size // 2 + seed] = True
    mask[: size // 3, seed::7] = False
    return mask


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("masks")
    for seed in range(1, 7):
        Image.fromarray(blob(seed)).save(folder / f"blob{seed}.png")
    Image.fromarray(np.rot90(blob(3))).save(folder / "turned.png")
    return folder


@pytest.fixture(scope="module")
def rows(folder: Path) -> list[dict[str, Any]]:
    files = sorted(folder.glob("*.png"))
    masks = [scored(str(file), np.asarray(Image.open(file)) > 0) for file in files]
    failures = [row(str(folder / name), error="no such file") for name in ("<script>alert(1)</script>.png", "b.png")]
    return [*masks, *failures, row(str(folder / "odd.png"), error='truncated "file" <b>')]


def data_of(page: str) -> dict[str, Any]:
    start = page.index(">", page.index('id="report-data"')) + 1
    return json.loads(page[start : page.index("</script>", start)])


def test_the_page_holds_pictures_profiles_groups_and_failures(tmp_path: Path, rows: list[dict[str, Any]]) -> None:
    out = tmp_path / "report.html"
    report = write_report(rows, out, mask_of=MaskReader(), title="Blobs & boxes")
    page = out.read_text(encoding="utf-8")
    assert (report.rows, report.pictures, report.profiles, report.size) == (10, 7, 7, out.stat().st_size)
    assert "<h1>Blobs &amp; boxes</h1>" in page
    assert "10 masks: 7 scored, 3 failed." in page
    assert "complexity (bits)" in page
    assert "1 group has masks with the same complexity" in page  # blob3 and the same one turned
    assert "no such file" in page
    assert "truncated &#34;file&#34; &lt;b&gt;" in page
    assert "each shape&#39;s own radius" in page
    assert f"<dd>{torchlinf.__version__}, 9.8.7</dd>" in page or f"<dd>9.8.7, {torchlinf.__version__}</dd>" in page
    least = min((one for one in rows if not one["error"]), key=lambda one: one["complexity"])
    assert f"<b>{least['complexity']:.4f} bits</b>" in page


def test_nothing_is_loaded_and_only_the_scripts_of_the_page_may_run(tmp_path: Path) -> None:
    write_report([row("a.png", 1.0)], tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    policy = re.search(r'http-equiv="Content-Security-Policy" content="([^"]*)"', page)
    assert policy is not None
    assert "default-src 'none'" in policy[1]
    assert "http" not in policy[1]
    scripts = re.findall(r"<script>(.*?)</script>", page, flags=re.DOTALL)
    hashes = {base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in scripts}
    assert hashes == set(re.findall(r"'sha256-([^']*)'", policy[1]))
    assert not re.findall(r"<(?:script|link|img|iframe)[^>]*(?:src|href)=\"?(?!data:)[^>]*>", page.split("<script>")[0])


@pytest.mark.parametrize("attack", ATTACKS)
def test_text_of_files_stays_text(tmp_path: Path, attack: str) -> None:
    """Wherever text comes from: names, reasons, further columns, names of windows, settings."""
    windows = {attack: (0.0, 1.0)}
    cells = {attack: 1.0, "inside": attack, "version": attack, "measure": Measure(windows=windows).settings()}
    rows = [{"path": attack, **cells}, {"path": attack + "2", "error": attack, **cells, attack: None}]
    write_report(rows, tmp_path / "report.html", title=attack)
    page = (tmp_path / "report.html").read_bytes().decode("utf-8")
    # Whatever is in the text, the page has the elements that it has for an innocent one.
    name = re.sub(r"[^/]+", "a", attack)
    innocent = [{"path": name, "w": 1.0, "inside": "a", "version": "a"}, {"path": name, "error": "a", "inside": "a"}]
    innocent = [one | {"measure": Measure(windows={"w": (0, 1)}).settings()} for one in innocent]
    write_report(innocent, tmp_path / "innocent.html", title="a")
    assert elements(page) == elements((tmp_path / "innocent.html").read_text(encoding="utf-8"))


def elements(page: str) -> list[tuple[str, list[str]]]:
    """The elements of a page with the names of their attributes, as a browser would read them."""

    class Reader(HTMLParser):
        found: list[tuple[str, list[str]]]

        def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            self.found.append((tag, [name for name, _ in attrs]))

    reader = Reader()
    reader.found = []
    reader.feed(page)
    return reader.found


def test_rows_without_numbers_and_few_columns(tmp_path: Path) -> None:
    out = tmp_path / "report.html"
    assert write_report([{"path": "a.png"}], out).rows == 1  # nothing is known at all
    write_report([row("a.png", float("nan")), row("b.png", error="no foreground")], out)
    page = out.read_text(encoding="utf-8")
    assert "2 masks: 0 scored, 1 failed." in page
    assert "Most complex" not in page
    # Before the title there are checksums, which may have any letters.
    head, _, body = page.split("<script>")[0].partition("<title>")
    assert "Content-Security-Policy" in head
    assert "nan" not in body.lower()
    write_report([row("a.png", 0.0), row("b.png", 0.0)], out)  # boxes
    assert "Equal numbers</h2>" not in out.read_text(encoding="utf-8")


def test_what_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="rows must hold at least one row"):
        write_report([], tmp_path / "report.html")
    with pytest.raises(ValueError, match="rows must have a path each"):
        write_report([{"complexity": 1.0}], tmp_path / "report.html")
    with pytest.raises(FileNotFoundError):
        write_report([row("a.png", 1.0)], tmp_path / "no" / "report.html")


def test_a_long_table_is_shown_by_rows_spread_over_the_ranking(tmp_path: Path) -> None:
    values = np.random.default_rng(0).permutation(1000) / 100
    rows = [row(f"{i}.png", value) for i, value in enumerate(values)]
    rows += [row(f"bad{i}.png", error="no such file") for i in range(250)]
    out = tmp_path / "report.html"
    assert write_report(rows, out, limit=125).rows == 125
    page = out.read_text(encoding="utf-8")
    assert "hold 125 of the 1,250 masks" in page
    assert "1,250 masks: 1,000 scored, 250 failed." in page
    assert '<td class="number">250</td>' in page
    # Both ends are there, and quarters of the ranking have the same share.
    shown = Table(rows).spread(range(1250), 125, keep=[int(values.argmin()), int(values.argmax())])
    kept = np.sort([values[i] for i in shown if i < 1000])
    assert (kept[0], kept[-1]) == (0.0, 9.99)
    assert np.histogram(kept, bins=4, range=(0, 10))[0] == pytest.approx(25, abs=2)
    assert sum(i >= 1000 for i in shown) == pytest.approx(25, abs=2)


def test_limits_smaller_than_the_galleries(tmp_path: Path) -> None:
    rows = [row(f"{i}.png", i / 10) for i in range(60)]
    assert write_report(rows, tmp_path / "report.html", limit=5, profiles=0).rows == 5


def test_profiles_are_those_of_the_library() -> None:
    mask = blob(4)
    values, note = profile_values(mask, scored("a.png", mask))
    profile = torchlinf.complexity_profile(torch.from_numpy(mask), spatial_ndim=2)
    assert note == ""
    assert len(values) == profile.radius <= MOST_LEVELS
    np.testing.assert_allclose(values * STEP, profile.levels(), atol=STEP / 2)
    assert (values * STEP).mean() == pytest.approx(profile.mean().item(), abs=STEP / 2)


def test_a_long_profile_is_stored_at_a_hundred_scales() -> None:
    mask = np.ones((420, 430), dtype=bool)
    mask[:70, :70] = False
    values, _ = profile_values(mask, {"path": "a"} | {name: float("nan") for name in WINDOWS})
    profile = torchlinf.complexity_profile(torch.from_numpy(mask), spatial_ndim=2)
    assert profile.radius > MOST_LEVELS
    np.testing.assert_allclose(values * STEP, profile.values, atol=STEP / 2)


def test_a_mask_that_is_not_as_it_was_scored_has_no_picture(tmp_path: Path) -> None:
    mask = blob(2)
    Image.fromarray(mask).save(tmp_path / "a.png")
    cells = scored(str(tmp_path / "a.png"), mask)
    out = tmp_path / "report.html"
    assert write_report([cells], out, mask_of=MaskReader()).pictures == 1
    report = write_report([cells | {"inside": "not nonzero"}], out, mask_of=MaskReader())
    assert report.pictures == 0
    assert "the mask is not as it was scored" in next(iter(report.missing))
    # As many pixels, but another shape: the picture is right, the numbers are not.
    other = write_report([cells | {"complexity": 9.0}], out, mask_of=MaskReader())
    assert (other.pictures, other.profiles) == (1, 0)
    assert "another version scored it" in data_of(out.read_text(encoding="utf-8"))["notes"][0]
    gone = write_report([cells | {"path": "gone.png"}], out, mask_of=MaskReader())
    assert gone.missing == {"no picture: no such file": 1}


def test_profiles_are_measured_as_the_rows_were(tmp_path: Path) -> None:
    mask = blob(5)
    coarse = Measure(bins=8, rho=3.0)
    value = torchlinf.complexity(torch.from_numpy(mask), spatial_ndim=2, bins=8, rho=3.0).item()
    values, note = profile_values(mask, {"path": "a", "complexity": value, "measure": coarse.settings()})
    assert note == ""
    assert (values * STEP).mean() == pytest.approx(value, abs=STEP / 2)


def test_masks_in_archives_are_found_by_the_names_of_their_rows(tmp_path: Path) -> None:
    np.savez(tmp_path / "two.npz", a=blob(1), b=blob(2))
    Image.fromarray(blob(3)).save(tmp_path / "odd:name.png")
    reader = MaskReader(tmp_path)
    names = [source.name for source in find_masks([tmp_path])]
    assert len(names) == 3
    for name, seed in zip(names, (3, 1, 2), strict=True):
        np.testing.assert_array_equal(reader({"path": Path(name).relative_to(tmp_path)}), blob(seed))


def test_pictures_show_the_mask() -> None:
    def picture(mask: np.ndarray, side: int = 64) -> np.ndarray:
        uri = thumbnail(mask, side)
        assert len(uri) < 1500
        image = Image.open(BytesIO(base64.b64decode(uri.removeprefix("data:image/png;base64,"))))
        assert image.size == (side, side)
        return np.asarray(image) > 0

    tall = np.zeros((300, 100), dtype=bool)
    tall[10:290, 40:60] = True
    inside = np.argwhere(picture(tall))
    assert (np.ptp(inside, axis=0) + 1).tolist() == [62, round(62 * 20 / 280)]
    assert picture(np.eye(3, dtype=bool)).mean() == pytest.approx(1 / 3 * (62 / 64) ** 2, abs=0.02)
    line = np.zeros((1000, 1000), dtype=bool)
    line[500, :], line[:, 500] = True, True
    line[500:510, :] = True
    assert picture(line)[:, 5].any()  # ten pixels of a thousand stay visible
    assert picture(np.stack([blob(1)] * 3)).any()


def test_the_command_writes_a_page(tmp_path: Path, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    table, out = tmp_path / "scores.csv", tmp_path / "report.html"
    run = CliRunner().invoke
    assert run(app, ["score", ".", "--out", str(table)]).exit_code == 0
    done = run(app, ["report", str(table), "--out", str(out)])
    assert done.exit_code == 0, done.output
    assert "7 of 7 masks, 7 pictures, 7 profiles" in done.stderr
    assert "<h1>Complexity of shapes: scores.csv</h1>" in out.read_text(encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    done = run(app, ["report", "scores.csv", "--out", "report.html"])
    assert "7 without a picture: no picture: no such file" in done.stderr
    done = run(app, ["report", "scores.csv", "--out", "report.html", "--folder", str(folder), "--profiles", "2"])
    assert "7 pictures, 2 profiles" in done.stderr
    done = run(app, ["report", "scores.csv", "--out", "report.html", "--no-pictures"])
    assert done.stderr.endswith("7 of 7 masks, 0 pictures, 0 profiles.\n")
    for arguments in (
        ["scores.csv", "-o", "page.csv"],
        ["scores.csv", "-o", "no/page.html"],
        ["no.csv", "-o", "p.html"],
    ):
        assert run(app, ["report", *arguments]).exit_code == 2
    with table.open(newline="") as file:
        header = next(csv.reader(file))
    (tmp_path / "empty.csv").write_text(",".join(header) + "\n")
    assert "without a row" in run(app, ["report", "empty.csv", "-o", "page.html"]).stderr


# In a browser.

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
CHROMEDRIVER = shutil.which("chromedriver")
FLAGS = (
    "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync --window-size=1500,1600"
)
# bokeh draws into shadow trees, which selectors do not enter.
DEEP = """
const all = (root, selector, found = []) => {
  found.push(...root.querySelectorAll(selector));
  for (const one of root.querySelectorAll("*")) if (one.shadowRoot) all(one.shadowRoot, selector, found);
  return found;
};
const cells = (column) => all(document, ".slick-row").sort((a, b) => parseFloat(a.style.top) - parseFloat(b.style.top))
  .map((row) => row.querySelectorAll(".slick-cell")[column].textContent);
"""


class Browser:
    """A page in Chromium."""

    def __init__(self, folder: Path) -> None:
        from selenium import webdriver
        from selenium.webdriver.chrome.service import Service

        options = webdriver.ChromeOptions()
        options.binary_location = CHROMIUM
        for flag in (*FLAGS.split(), f"--user-data-dir={folder}"):
            options.add_argument(flag)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
        self.driver = webdriver.Chrome(options=options, service=Service(CHROMEDRIVER))

    def open(self, page: Path) -> None:
        self.driver.get_log("browser"), self.driver.get_log("performance")
        self.driver.get(page.resolve().as_uri())
        self.wait("document.documentElement.dataset.ready === 'true'")

    def run(self, code: str) -> Any:
        return self.driver.execute_script(DEEP + code)

    def wait(self, condition: str) -> None:
        end = time.monotonic() + 60
        while not self.run(f"return {condition};"):
            assert time.monotonic() < end, f"{condition} does not come true: {self.problems()}"
            time.sleep(0.05)

    def cells(self, column: int) -> list[str]:
        return self.run(f"return cells({column});")

    def sort_by(self, column: int) -> None:
        self.run(f"all(document, '.slick-header-column')[{column}].click();")

    def put(self, element: str, value: str) -> None:
        self.run(
            f"const one = document.getElementById('{element}'); one.value = {json.dumps(value)};"
            "one.dispatchEvent(new Event('input'));"
        )

    def text(self, element: str) -> str:
        return self.run(f"return document.getElementById('{element}').textContent;")

    def problems(self) -> list[str]:
        """Errors and warnings on the console."""
        return [entry["message"] for entry in self.driver.get_log("browser") if entry["level"] in ("SEVERE", "WARNING")]

    def requests(self) -> list[str]:
        """The addresses that the page asked for; a busy browser may still be loading its own first tab."""
        events = [json.loads(entry["message"])["message"] for entry in self.driver.get_log("performance")]
        sent = [event["params"] for event in events if event["method"] == "Network.requestWillBeSent"]
        asked = [one["request"]["url"] for one in sent if not one["documentURL"].startswith("chrome")]
        return [address for address in asked if not address.startswith("data:")]


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    pytest.importorskip("selenium", reason="the page is tried in a browser with selenium, which is not installed")
    if not (CHROMIUM and CHROMEDRIVER):
        pytest.skip("the page is tried in Chromium; chromium and chromedriver are not both installed")
    browser = Browser(tmp_path_factory.mktemp("chromium"))
    yield browser
    browser.driver.quit()


def test_sort_filter_and_click_in_a_browser(browser: Browser, tmp_path: Path, rows: list[dict[str, Any]]) -> None:
    out = tmp_path / "report.html"
    write_report(rows, out, mask_of=MaskReader())
    browser.open(out)
    values = sorted(f"{one['complexity']:.4f}" for one in rows if one["complexity"] is not None)
    assert browser.text("filter-count") == "10 of 10 masks"
    widths = browser.run("return [...document.querySelectorAll('main > *')].map((one) => one.offsetWidth);")
    assert len(set(widths)) == 1  # one part below the other
    assert widths[0] > 1300
    browser.sort_by(2)
    assert browser.cells(2) == [*values, "", "", ""]
    browser.sort_by(2)
    assert browser.cells(2) == [*values[::-1], "", "", ""]
    assert browser.run("return all(document, '.slick-row img').length;") == 7

    browser.put("filter-text", "BLOB")
    browser.wait("document.getElementById('filter-count').textContent === '6 of 10 masks'")
    browser.wait("cells(1).length === 6")
    assert browser.cells(1) == sorted(browser.cells(1), key=lambda name: -complexity_of(rows, name))
    browser.put("filter-text", "truncated")  # a reason
    browser.wait("cells(1).length === 1")
    browser.run("document.getElementById('filter-clear').click();")
    browser.put("filter-kind", "failed")
    browser.wait("cells(1).length === 3")
    assert "<script>alert(1)</script>.png" in browser.cells(1)
    browser.put("filter-kind", "equal")
    browser.wait("cells(1).length === 2")
    assert sorted(browser.cells(1)) == ["blob3.png", "turned.png"]
    browser.put("filter-kind", "all")
    browser.put("filter-min", values[4])
    browser.wait(f"cells(1).length === {sum(float(value) >= float(values[4]) for value in values)}")
    browser.run("document.getElementById('filter-clear').click();")
    browser.wait("cells(1).length === 10")

    # A click on a row shows the profile: its mean is the complexity of the row.
    browser.run("all(document, '.slick-row').find((row) => row.textContent.includes('blob5')).children[1].click();")
    browser.wait("document.getElementById('detail-path').textContent === 'blob5.png'")
    x, y = browser.run("const {x, y} = Bokeh.documents[0].get_model_by_name('lines').data; return [x[0], y[0]];")
    assert np.trapezoid(y, x) == pytest.approx(complexity_of(rows, "blob5.png"), abs=STEP)
    assert (x[0], x[-1]) == (0, 1)
    # A picture of a gallery does the same, also if the filter hides its row.
    browser.put("filter-kind", "failed")
    browser.wait("cells(1).length === 3")
    browser.run("document.querySelector('[data-row]').click();")
    most = max((one for one in rows if one["complexity"] is not None), key=lambda one: one["complexity"])
    browser.wait(f"document.getElementById('detail-path').textContent === {json.dumps(Path(most['path']).name)}")
    assert browser.text("filter-count") == "10 of 10 masks"
    assert browser.problems() == []
    assert browser.requests() == [out.resolve().as_uri()]


def complexity_of(rows: list[dict[str, Any]], name: str) -> float:
    return next(one["complexity"] for one in rows if Path(one["path"]).name == name)


def test_no_text_runs_in_a_browser(browser: Browser, tmp_path: Path) -> None:
    windows = dict.fromkeys(ATTACKS, (0.0, 1.0))
    settings = Measure(windows=windows).settings()
    rows = [
        {"path": attack, **dict.fromkeys(ATTACKS, float(i)), "inside": attack, "error": attack if i % 2 else None}
        | {"measure": settings, "version": attack}
        for i, attack in enumerate(ATTACKS)
    ]
    seen: set[str] = set()
    for text in ATTACKS[:2]:
        write_report(rows, tmp_path / "report.html", title=text)
        browser.open(tmp_path / "report.html")  # an alert would end every later command with an error
        for column in (1, 2, 1):
            browser.sort_by(column)
        for number in range(len(rows)):
            browser.run(f"all(document, '.slick-row')[{number}].children[1].click();")
            seen.add(browser.text("detail-path"))
        assert seen == set(ATTACKS[:-1]) | {ATTACKS[-1].replace("\ud800", r"\ud800")}
        assert browser.run("return all(document, '.slick-cell script, .slick-header script, [onerror]').length;") == 0
        assert browser.problems() == []


def test_ten_thousand_rows_stay_fluid(browser: Browser, tmp_path: Path) -> None:
    values = np.random.default_rng(0).gamma(3, size=10_000)
    write_report([row(f"{i:05}.png", value) for i, value in enumerate(values)], tmp_path / "report.html")
    browser.open(tmp_path / "report.html")
    assert browser.run("return all(document, '.slick-row').length;") < 100  # only rows in sight are drawn
    timed = "const start = performance.now(); {} return performance.now() - start;"
    browser.sort_by(2)
    assert browser.cells(2)[0] == f"{values.min():.4f}"
    # Bounds that a slow and busy machine keeps too; a table that draws all rows takes longer by far.
    assert browser.run(timed.format("all(document, '.slick-header-column')[2].click();")) < 5000
    assert browser.cells(2)[0] == f"{values.max():.4f}"
    assert browser.run(timed.format("document.getElementById('filter-clear').click();")) < 5000
    browser.put("filter-text", "0123")
    browser.wait("document.getElementById('filter-count').textContent === '11 of 10,000 masks'")
    assert browser.problems() == []
