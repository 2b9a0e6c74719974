"""Check pages in a headless Chromium: `python3 -m tests.study.browser PATH ...`.

A path is a page or the folder of a site. The check needs only Python, Selenium, Chromium and
chromedriver, and therefore also runs where DOLFINx is not installed.
"""

import shutil
import sys
from pathlib import Path

from tests.study.pages import find_faults

BROWSER_EXECUTABLES = ("chromium", "chromium-browser", "google-chrome", "chrome")
WINDOW_WIDTHS = (390, 1280)  # windows of a phone and of a desktop, in CSS pixels
TIMEOUT_SECONDS = 60  # for one script

BROWSER_FLAGS = (
    "headless no-sandbox disable-gpu disable-dev-shm-usage disable-background-networking "
    "hide-scrollbars"
)

PAGE_STATE_SCRIPT = """return (async () => {
  const images = [...document.images]
  images.forEach(image => image.loading = 'eager')
  const scrolls = element => element !== null
    && (['auto', 'scroll'].includes(getComputedStyle(element).overflowX)
      || scrolls(element.parentElement))
  await Promise.allSettled(images.map(image => image.decode()))
  return {
    images: images.length,
    broken: images.filter(image => !image.complete || image.naturalWidth == 0).map(i => i.alt),
    width: innerWidth,
    scrollWidth: document.scrollingElement.scrollWidth,
    cutTables: [...document.querySelectorAll('table')].filter(table =>
      table.getBoundingClientRect().right > innerWidth && !scrolls(table)).length,
    unknown: [...document.links].filter(link => link.hash.length > 1
      && link.origin + link.pathname == location.origin + location.pathname
      && !document.getElementById(decodeURIComponent(link.hash.slice(1)))).map(link => link.hash)
  }
})()"""

PAGE_BODIES_BY_FAULT = {
    "image does not load": '<img src="data:image/png;base64,AAAA" alt="x">',
    "console-api: ": "<script>console.error('failed')</script>",
    "javascript: ": "<script>nothing.at.all</script>",
    "table cannot be scrolled": '<div style="overflow: hidden"><table style="width: 2000px">',
    "wider than the window": '<div style="width: 2000px">x</div>',
    "link to nowhere": '<a href="#nowhere">x</a>',
}
"""Map from each fault that the check has to report to the body of a page with this fault."""


def find_chromium_with_driver():
    """Return the path of a Chromium executable, or None without Chromium or chromedriver."""
    return shutil.which("chromedriver") and next(
        filter(None, map(shutil.which, BROWSER_EXECUTABLES)), None
    )


def start_chromium():
    """Start a headless Chromium; return its driver, a context manager that quits it."""
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = find_chromium_with_driver()
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    for flag in BROWSER_FLAGS.split():
        options.add_argument(f"--{flag}")
    browser = webdriver.Chrome(options, webdriver.ChromeService(shutil.which("chromedriver")))
    browser.set_script_timeout(TIMEOUT_SECONDS)
    return browser


def find_page_faults(browser, url, width):
    """Open a page in a window of the given width in pixels; return a message for each fault."""
    window_size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", window_size)
    browser.get_log("browser")  # discards messages about the preceding page
    browser.get(url)
    page_state = browser.execute_script(PAGE_STATE_SCRIPT)
    messages = [f"image does not load: {alt}" for alt in page_state["broken"]]
    messages += [f"link to nowhere: {name}" for name in page_state["unknown"]]
    if page_state["width"] != width:
        messages.append(f"the window is {page_state['width']} wide, not {width}")
    if page_state["scrollWidth"] > page_state["width"]:
        messages.append(f"wider than the window: {page_state['scrollWidth']} pixels")
    if page_state["cutTables"]:
        messages.append(f"table cannot be scrolled: {page_state['cutTables']} of the page")
    error_entries = [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"]
    return messages + [f"{entry['source']}: {entry['message']}" for entry in error_entries]


def find_search_faults(browser, folder, word, width):
    """Type a word into the search box of the home page; return a message for each fault.

    The first result has to be a page that contains the word.
    """
    from selenium.webdriver.common.by import By
    from selenium.webdriver.support.wait import WebDriverWait

    window_size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", window_size)
    browser.get((folder / "index.html").resolve().as_uri())
    browser.get_log("browser")
    boxes = [box for box in browser.find_elements(By.NAME, "q") if box.is_displayed()]
    if len(boxes) != 1:
        return [f"search at {width} pixels: {len(boxes)} boxes are visible, not one"]
    boxes[0].send_keys(f"{word}\n")
    link = WebDriverWait(browser, TIMEOUT_SECONDS).until(
        lambda page: page.find_elements(By.CSS_SELECTOR, "#search-results li a")
    )[0]
    browser.get(link.get_attribute("href"))
    faults = [
        entry["message"] for entry in browser.get_log("browser") if entry["level"] == "SEVERE"
    ]
    if word not in browser.find_element(By.CSS_SELECTOR, "[role=main], main").text.lower():
        faults.append(f"{browser.current_url} does not contain {word}")
    return [f"search at {width} pixels: {fault}" for fault in faults]


def read_stated_and_visible_claim_counts(browser, folder, query):
    """Open the page of claims with a query; return a text with the stated and the actual numbers.

    The text has the form "10 of 86: 10": the number of claims that the page states as shown, the
    total, and the number of claims that are visible.
    """
    url = (folder / "evidence" / "claims.html").resolve().as_uri()
    browser.get(f"{url}?{query}")
    count_script = "[...document.querySelectorAll('.claim')].filter(c => c.offsetParent).length"
    return browser.execute_script(
        f"return document.getElementById('count').value + ': ' + {count_script}"
    )


def find_site_faults(browser, folder):
    """Return a message for each fault of a site's pages, links, search and filter of claims."""
    site_faults = find_faults(folder)
    for page in sorted(folder.rglob("*.html")):
        for width in WINDOW_WIDTHS:
            page_faults = find_page_faults(browser, page.resolve().as_uri(), width)
            site_faults += [
                f"{page.relative_to(folder)} at {width} pixels: {fault}" for fault in page_faults
            ]
    for width in WINDOW_WIDTHS:
        site_faults += find_search_faults(browser, folder, "friction", width)
    failing_counts, all_counts = (
        read_stated_and_visible_claim_counts(browser, folder, f"verdict={verdict}")
        for verdict in ("fails", "")
    )
    for counts in (failing_counts, all_counts):
        if int(counts.split(" ")[0]) != int(counts.split(": ")[1]):
            site_faults.append(f"claims are counted as {counts}")
    if int(failing_counts.split(" ")[0]) >= int(all_counts.split(" ")[0]):
        site_faults.append(f"the filter shows {failing_counts} and {all_counts}")
    return site_faults


def main(paths):
    """Check pages and folders of sites; return the exit status.

    The checker itself is tested first, on pages with known faults.
    """
    if find_chromium_with_driver() is None:
        print(
            f"browser: there is no chromedriver, or none of {', '.join(BROWSER_EXECUTABLES)}",
            file=sys.stderr,
        )
        return 2
    n_failures = 0
    with start_chromium() as browser:
        for fault, body in PAGE_BODIES_BY_FAULT.items():
            if not any(
                fault in message
                for message in find_page_faults(browser, make_data_url(body), WINDOW_WIDTHS[0])
            ):
                print(f"browser: does not see the fault {fault!r}", file=sys.stderr)
                n_failures += 1
        for folder in (Path(path) for path in paths if Path(path).is_dir()):
            messages = find_site_faults(browser, folder.resolve())
            print("\n".join(f"browser: {line}" for line in messages or [f"{folder}: good"]))
            n_failures += bool(messages)
        for path in (path for path in paths if Path(path).is_file()):
            for width in WINDOW_WIDTHS:
                page_faults = find_page_faults(browser, Path(path).resolve().as_uri(), width)
                print(f"browser: {path} at {width} pixels: {'; '.join(page_faults) or 'good'}")
                n_failures += bool(page_faults)
    return int(n_failures > 0)


def make_data_url(body):
    return f"data:text/html,<!doctype html><title>x</title>{body.replace('#', '%23')}"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
