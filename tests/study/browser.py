"""Opens pages in a headless Chromium and tells what is wrong: `-m tests.study.browser PATH …`.

Needs Python, Selenium, a Chromium and its driver, so that it runs on a system without DOLFINx too.
"""

import shutil
import sys
from pathlib import Path

from tests.study.pages import find_faults

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
WIDTHS = (390, 1280)  # a telephone's and a desktop's window, in CSS pixels
SECONDS = 60  # for one answer

FLAGS = (
    "headless no-sandbox disable-gpu disable-dev-shm-usage disable-background-networking "
    "hide-scrollbars"
)

LOOK = """return (async () => {
  const images = [...document.images]
  images.forEach(image => image.loading = 'eager')
  await Promise.allSettled(images.map(image => image.decode()))
  return {
    images: images.length,
    broken: images.filter(image => !image.complete || image.naturalWidth == 0).map(i => i.alt),
    width: innerWidth,
    scrollWidth: document.scrollingElement.scrollWidth,
    unknown: [...document.links].filter(link => link.hash.length > 1
      && link.origin + link.pathname == location.origin + location.pathname
      && !document.getElementById(decodeURIComponent(link.hash.slice(1)))).map(link => link.hash)
  }
})()"""

FAULTY = {
    "image does not load": '<img src="data:image/png;base64,AAAA" alt="x">',
    "console-api: ": "<script>console.error('failed')</script>",
    "javascript: ": "<script>nothing.at.all</script>",
    "wider than the window": '<div style="width: 2000px">x</div>',
    "link to nowhere": '<a href="#nowhere">x</a>',
}
"""What is to be told of a page, and a page it is true of."""


def executable():
    """Path of a Chromium that can be driven, or None."""
    return shutil.which("chromedriver") and next(filter(None, map(shutil.which, NAMES)), None)


def started():
    """A Chromium with one empty page, for a `with` statement."""
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = executable()
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    for flag in FLAGS.split():
        options.add_argument(f"--{flag}")
    browser = webdriver.Chrome(options, webdriver.ChromeService(shutil.which("chromedriver")))
    browser.set_script_timeout(SECONDS)
    return browser


def faults(browser, url, width):
    """Open a page in a window of this width; return what is wrong, in words."""
    size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    browser.get_log("browser")  # of the page before
    browser.get(url)
    seen = browser.execute_script(LOOK)
    found = [f"image does not load: {alt}" for alt in seen["broken"]]
    found += [f"link to nowhere: {name}" for name in seen["unknown"]]
    if seen["width"] != width:
        found.append(f"the window is {seen['width']} wide, not {width}")
    if seen["scrollWidth"] > seen["width"]:
        found.append(f"wider than the window: {seen['scrollWidth']} pixels")
    logged = [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"]
    return found + [f"{entry['source']}: {entry['message']}" for entry in logged]


def searched(browser, folder, word):
    """Number of pages that the site's own search finds for a word."""
    from selenium.webdriver.support.wait import WebDriverWait

    url = (folder / "search.html").resolve().as_uri()
    browser.get(f"{url}?q={word}")
    count = "return document.querySelectorAll('#search-results li').length"
    return WebDriverWait(browser, SECONDS).until(lambda page: page.execute_script(count))


def filtered(browser, folder, query):
    """What the page of claims says of how many it shows, as "10 of 86", for a query."""
    url = (folder / "evidence" / "claims.html").resolve().as_uri()
    browser.get(f"{url}?{query}")
    count = "[...document.querySelectorAll('.claim')].filter(c => c.offsetParent).length"
    return browser.execute_script(f"return document.getElementById('count').value + ': ' + {count}")


def site(browser, folder):
    """What is wrong with a site: its pages, the links between them, and its search."""
    told = find_faults(folder)
    for page in sorted(folder.rglob("*.html")):
        for width in WIDTHS:
            found = faults(browser, page.resolve().as_uri(), width)
            told += [f"{page.relative_to(folder)} at {width} pixels: {one}" for one in found]
    searched(browser, folder, "friction")
    some, every = (filtered(browser, folder, f"verdict={v}") for v in ("fails", ""))
    for count in (some, every):
        if int(count.split(" ")[0]) != int(count.split(": ")[1]):
            told.append(f"claims are counted as {count}")
    if int(some.split(" ")[0]) >= int(every.split(" ")[0]):
        told.append(f"the filter shows {some} and {every}")
    return told


def main(paths):
    """Check pages and folders of them, and first that faults are seen at all; return the status."""
    if executable() is None:
        print(f"browser: there is no chromedriver, or none of {', '.join(NAMES)}", file=sys.stderr)
        return 2
    wrong = 0
    with started() as browser:
        for fault, body in FAULTY.items():
            if not any(fault in told for told in faults(browser, faulty(body), WIDTHS[0])):
                print(f"browser: does not see the fault {fault!r}", file=sys.stderr)
                wrong += 1
        for folder in (Path(path) for path in paths if Path(path).is_dir()):
            told = site(browser, folder.resolve())
            print("\n".join(f"browser: {line}" for line in told or [f"{folder}: good"]))
            wrong += bool(told)
        for path in (path for path in paths if Path(path).is_file()):
            for width in WIDTHS:
                found = faults(browser, Path(path).resolve().as_uri(), width)
                print(f"browser: {path} at {width} pixels: {'; '.join(found) or 'good'}")
                wrong += bool(found)
    return int(wrong > 0)


def faulty(body):
    return f"data:text/html,<!doctype html><title>x</title>{body.replace('#', '%23')}"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
