"""The report as a reader's browser shows it."""

import re
import shutil
import subprocess

import pytest

from tipforce.evaluation import Method, evaluate, write_report

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
OFFLINE = ["--host-resolver-rules=MAP * ~NOTFOUND"]
pytestmark = pytest.mark.skipif(BROWSER is None, reason="no Chromium on this machine: apt-get install chromium")


@pytest.fixture(scope="module")
def page(make_bench, ridge_class, tmp_path_factory):
    folder = tmp_path_factory.mktemp("report") / "out"
    write_report(evaluate(make_bench(sessions=3), [Method("ridge", ridge_class())]), folder, "tipforce evaluate ridge")
    return folder / "report.html"


def browse(page, profile, *flags):
    quiet = "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    quiet += "--disable-component-update --disable-sync --disable-extensions --disable-dev-shm-usage "
    quiet += "--virtual-time-budget=3000"
    ran = subprocess.run(
        [
            BROWSER,
            *quiet.split(),
            *OFFLINE,
            f"--user-data-dir={profile}",
            "--virtual-time-budget=3000",
            *flags,
            page.as_uri(),
        ],
        capture_output=True,
        text=True,
        timeout=90,
        check=True,
    )
    return ran.stdout, ran.stderr


def asked_by_the_page(log):
    """Addresses that the page itself, not the browser around it, asked the network for."""
    lines = log.read_text(encoding="utf-8", errors="replace").splitlines()
    own = [line for line in lines if '"initiator":' in line and '"initiator":"not an origin"' not in line]
    return [url for line in own for url in re.findall(r'"url":"([^"]+)"', line)]


def test_the_page_is_shown_whole_and_complains_of_nothing(page, tmp_path):
    dom, said = browse(page, tmp_path / "profile", "--dump-dom", "--enable-logging=stderr")
    assert re.search(r'<p class="verdict">On sessions never seen, ridge', dom)
    assert dom.count("<svg") >= 7
    assert dom.count("<figcaption>") >= 7
    assert dom.count('class="constant"') >= 3
    assert "How this was made" in dom
    assert ":CONSOLE" not in said


def test_the_page_asks_the_network_for_nothing(page, tmp_path):
    log = tmp_path / "net.json"
    browse(page, tmp_path / "profile", "--dump-dom", f"--log-net-log={log}")
    assert asked_by_the_page(log) == []
    probe = page.with_name("outside.html")
    probe.write_text('<img src="http://example.invalid/pixel.png">', encoding="utf-8")
    browse(probe, tmp_path / "profile", "--dump-dom", f"--log-net-log={log}")
    assert asked_by_the_page(log) == ["http://example.invalid/pixel.png"], "the log shows what a page asks for"


def test_the_page_fits_a_phone_without_scrolling_sideways(page, tmp_path):
    probe = page.with_name("probe.html")
    script = "<script>document.title = 'width ' + document.documentElement.scrollWidth + ' of ' + innerWidth</script>"
    probe.write_text(page.read_text(encoding="utf-8").replace("</body>", script + "</body>"), encoding="utf-8")
    dom, _ = browse(probe, tmp_path / "profile", "--dump-dom", "--window-size=500,900")
    probe.unlink()
    wide, window = map(int, re.search(r"<title>width (\d+) of (\d+)", dom).groups())
    assert wide <= window


def measured(page, profile, script, *flags):
    """What a script in a copy of the page writes into its title."""
    probe = page.with_name("probe.html")
    code = f"<script>document.title = (() => {{ {script} }})()</script>"
    probe.write_text(page.read_text(encoding="utf-8").replace("</body>", code + "</body>"), encoding="utf-8")
    dom, _ = browse(probe, profile, "--dump-dom", *flags)
    probe.unlink()
    return re.search(r"<title>(.*?)</title>", dom).group(1)


SMALLEST = """
  const sizes = [];
  const walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node = walk.nextNode(); node; node = walk.nextNode()) {
    const holder = node.parentElement;
    if (!node.data.trim() || !holder.getClientRects().length) continue;
    if (holder.closest('script, title, metadata, defs')) continue;
    const matrix = holder.getScreenCTM ? holder.getScreenCTM() : null;
    const scale = matrix ? Math.hypot(matrix.a, matrix.b) : 1;
    sizes.push([parseFloat(getComputedStyle(holder).fontSize) * scale, node.data.trim()]);
  }
  sizes.sort((one, other) => one[0] - other[0]);
  return sizes.length + ' texts, smallest ' + sizes[0][0].toFixed(2) + ' px';
"""


@pytest.mark.parametrize("width", [500, *(pytest.param(width, marks=pytest.mark.slow) for width in (1400, 1200, 800))])
def test_no_type_is_smaller_than_12_px(page, tmp_path, width):
    found = measured(page, tmp_path / "profile", SMALLEST, f"--window-size={width},900")
    texts, smallest = re.match(r"(\d+) texts, smallest ([\d.]+) px", found).groups()
    assert int(texts) > 300
    assert float(smallest) >= 11.99


def test_figures_leave_no_place_of_a_row_empty(page, tmp_path):
    script = """
      const holes = [];
      for (const grid of document.querySelectorAll('.figures, .head')) {
        const right = grid.getBoundingClientRect().right;
        const rows = new Map();
        for (const item of grid.children) {
          const box = item.getBoundingClientRect();
          rows.set(Math.round(box.top), Math.max(rows.get(Math.round(box.top)) || 0, box.right));
        }
        for (const end of rows.values()) if (right - end > 2) holes.push(right - end);
      }
      return holes.length + ' holes';
    """
    assert measured(page, tmp_path / "profile", script, "--window-size=1200,900") == "0 holes"


def test_the_tables_of_results_fit_the_page_without_scrolling(page, tmp_path):
    script = """
      const tables = [...document.querySelectorAll('#scores .scroll, #agreement .scroll, #coverage .scroll')];
      return tables.filter(each => each.scrollWidth > each.clientWidth).length + ' of ' + tables.length;
    """
    found = measured(page, tmp_path / "profile", script, "--window-size=1200,900")
    wide, tables = found.split(" of ")
    assert int(tables) >= 5
    assert int(wide) == 0


def test_the_printed_page_holds_its_tables_and_figures(page, tmp_path):
    printed = tmp_path / "report.pdf"
    browse(page, tmp_path / "profile", "--no-pdf-header-footer", f"--print-to-pdf={printed}")
    data = printed.read_bytes()
    assert data.startswith(b"%PDF")
    boxes = re.findall(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", data)
    assert boxes
    assert all(float(width) > float(height) for width, height in boxes), "landscape: two figures fit beside each other"
