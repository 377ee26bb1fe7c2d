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
