"""The report in a real browser.

.ci/run does the same outside of the Debian that ./run unpacks, which has no browser.
"""

from pathlib import Path

import pytest

from study.core.store import Results
from study.report import build
from tests.study import browser
from tests.study.toystudy import reported

REPORT = Path(__file__).parents[2] / "results" / "report.html"
SITE = REPORT.with_name("site")

pytestmark = [
    pytest.mark.skipif(browser.executable() is None, reason="no Chromium here"),
    # Debian pairs WeasyPrint with a newer pydyf, which has renamed some methods
    pytest.mark.filterwarnings("ignore::DeprecationWarning:pydyf"),
]


@pytest.fixture(scope="module")
def chromium():
    with browser.Browser(browser.executable()) as opened:
        yield opened


@pytest.mark.parametrize("fault", browser.FAULTY)
def test_faults_are_seen(chromium, fault):
    (told,) = chromium.faults(browser.faulty(browser.FAULTY[fault]), 390)
    assert fault in told


@pytest.mark.parametrize("width", browser.WIDTHS)
def test_small_report_is_good(chromium, tmp_path, monkeypatch, width):
    out = reported(tmp_path, monkeypatch)
    build(Results(out), out)
    assert chromium.faults((out / "report.html").as_uri(), width) == []


@pytest.mark.skipif(not REPORT.exists(), reason="./run study has not written its report yet")
@pytest.mark.parametrize("width", browser.WIDTHS)
def test_report_of_the_study_is_good(chromium, width):
    assert chromium.faults(REPORT.as_uri(), width) == []


@pytest.mark.skipif(not SITE.exists(), reason="./run site has not made its pages yet")
def test_site_is_good(chromium):
    assert browser.site(chromium, SITE) == []
