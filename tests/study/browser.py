"""Opens pages in a headless Chromium and tells what is wrong: `-m tests.study.browser PATH …`.

Needs nothing but Python and a Chromium, so that it runs on a system without DOLFINx too. Speaks the
DevTools protocol over the pipes of --remote-debugging-pipe: JSON, a zero byte after each message.
"""

import fcntl
import json
import os
import select
import shutil
import subprocess
import sys
import tempfile
import time
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
WIDTHS = (390, 1280)  # a telephone's and a desktop's window, in CSS pixels
SECONDS = 60  # for one answer

FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-dev-shm-usage",
    "--disable-sync",
    "--hide-scrollbars",
    "--no-first-run",
]

LOOK = """(async () => {
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
    "console: failed": "<script>console.error('failed')</script>",
    "script: ": "<script>nothing.at.all</script>",
    "wider than the window": '<div style="width: 2000px">x</div>',
    "link to nowhere": '<a href="#nowhere">x</a>',
}
"""What is to be told of a page, and a page it is true of."""


def executable():
    """Path of a Chromium, or None."""
    return next(filter(None, map(shutil.which, NAMES)), None)


class Browser:
    """A Chromium with one empty page, for a `with` statement."""

    def __init__(self, program):
        self._profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        ours, theirs = os.pipe(), os.pipe()
        # it reads from 3 and writes to 4, which are taken here: the copies are not in the way
        command, answer = (
            fcntl.fcntl(fd, fcntl.F_DUPFD_CLOEXEC, 10) for fd in (ours[0], theirs[1])
        )
        self._write, self._read = (
            fcntl.fcntl(fd, fcntl.F_DUPFD_CLOEXEC, 10) for fd in (ours[1], theirs[0])
        )
        self._process = subprocess.Popen(
            [program, *FLAGS, "--remote-debugging-pipe", f"--user-data-dir={self._profile.name}"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            close_fds=False,
            preexec_fn=lambda: (os.dup2(command, 3), os.dup2(answer, 4)),
        )
        for fd in (*ours, *theirs, command, answer):
            os.close(fd)
        self._count, self._rest, self._events = 0, b"", []

    def __enter__(self):
        target = self._ask("Target.createTarget", url="about:blank")["targetId"]
        self._session = self._ask("Target.attachToTarget", targetId=target, flatten=True)[
            "sessionId"
        ]
        for domain in ("Page", "Runtime", "Log"):
            self.ask(f"{domain}.enable")
        self.ask("Page.setLifecycleEventsEnabled", enabled=True)
        return self

    def __exit__(self, *_):
        self._process.terminate()
        try:
            self._process.wait(10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        os.close(self._write)
        os.close(self._read)
        self._profile.cleanup()

    def faults(self, url, width):
        """Open a page in a window of this width; return what is wrong, in words."""
        size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
        self.ask("Emulation.setDeviceMetricsOverride", **size)
        self._events.clear()
        opened = self.ask("Page.navigate", url=url)
        if "errorText" in opened:
            return [f"does not open: {opened['errorText']}"]
        end = time.monotonic() + SECONDS
        while not any(loaded(event, opened["loaderId"]) for event in self._events):
            self._events.append(self._receive(end))
        answer = self.ask(
            "Runtime.evaluate", expression=LOOK, awaitPromise=True, returnByValue=True
        )
        seen = answer["result"]["value"]
        faults = [f"image does not load: {alt}" for alt in seen["broken"]]
        faults += [f"link to nowhere: {name}" for name in seen["unknown"]]
        if seen["width"] != width:
            faults.append(f"the window is {seen['width']} wide, not {width}")
        if seen["scrollWidth"] > seen["width"]:
            faults.append(f"wider than the window: {seen['scrollWidth']} pixels")
        return faults + [words for event in self._events if (words := complaint(event))]

    def ask(self, method, **parameters):
        """Result of a command to the page."""
        return self._ask(method, self._session, **parameters)

    def _ask(self, method, session=None, /, **parameters):
        self._count += 1
        message = {"id": self._count, "method": method, "params": parameters}
        if session:
            message["sessionId"] = session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        end = time.monotonic() + SECONDS
        while True:
            answer = self._receive(end)
            if answer.get("id") == self._count:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']['message']}")
                return answer["result"]
            if "method" in answer:
                self._events.append(answer)

    def _receive(self, end):
        """Next message of the browser."""
        while b"\0" not in self._rest:
            if not select.select([self._read], [], [], max(0, end - time.monotonic()))[0]:
                raise TimeoutError(f"the browser says nothing for {SECONDS} s")
            data = os.read(self._read, 1 << 16)
            if not data:
                raise RuntimeError("the browser has ended")
            self._rest += data
        message, _, self._rest = self._rest.partition(b"\0")
        return json.loads(message)


def loaded(event, loader):
    """Whether an event is the end of loading of a document, whose loader this is."""
    told = event.get("params", {})
    return told.get("name") == "load" and told.get("loaderId") == loader


def complaint(event):
    """An error that the page's event tells, in words; empty for other events."""
    told = event.get("params", {})
    match event["method"]:
        case "Runtime.exceptionThrown":
            details = told["exceptionDetails"]
            return "script: " + details.get("exception", {}).get("description", details["text"])
        case "Runtime.consoleAPICalled" if told["type"] in ("error", "assert"):
            words = [str(part.get("value", part.get("description"))) for part in told["args"]]
            return "console: " + " ".join(words)
        case "Log.entryAdded" if told["entry"]["level"] == "error":
            return "console: " + told["entry"]["text"]
    return ""


class Anchors(HTMLParser):
    """What a page refers to, and what may be referred to in it."""

    def __init__(self, html):
        super().__init__()
        self.ids, self.targets, self.loads = set(), set(), set()
        self.feed(html)

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        if tag in ("script", "img", "link", "source"):
            self.loads |= {given[key] for key in ("href", "src", "srcset") if given.get(key)}
        self.ids |= {given[key] for key in ("id", "name") if given.get(key)}
        self.targets |= {given[key] for key in ("href", "src", "srcset") if given.get(key)}


def dead(folder):
    """Links between the files of a folder that lead nowhere, a line for each."""
    pages = {path: Anchors(path.read_text("utf-8")) for path in sorted(folder.rglob("*.html"))}
    wrong = []
    for page, anchors in pages.items():
        for target in sorted(anchors.targets):
            parts = urlsplit(target)
            if parts.scheme or parts.netloc:
                if target in anchors.loads and parts.scheme != "data":
                    wrong.append(f"{page.relative_to(folder)}: {target} comes from elsewhere")
                continue
            path = (page.parent / unquote(parts.path)).resolve() if parts.path else page
            anchor = unquote(parts.fragment)
            known = pages[path].ids if path in pages else {anchor}
            if not path.is_file() or (anchor and anchor not in known):
                wrong.append(f"{page.relative_to(folder)}: {target}")
    return wrong


def searched(browser, folder, word):
    """Number of pages that the site's own search finds for a word."""
    url = (folder / "search.html").resolve().as_uri()
    browser.faults(f"{url}?q={word}", WIDTHS[1])
    count = "document.querySelectorAll('#search-results li').length"
    end = time.monotonic() + SECONDS
    while time.monotonic() < end:
        found = browser.ask("Runtime.evaluate", expression=count, returnByValue=True)
        if found["result"]["value"]:
            return found["result"]["value"]
        time.sleep(0.2)
    return 0


def filtered(browser, folder, query):
    """What the page of claims says of how many it shows, as "10 of 86", for a query."""
    url = (folder / "evidence" / "claims.html").resolve().as_uri()
    browser.faults(f"{url}?{query}", WIDTHS[1])
    count = "[...document.querySelectorAll('.claim')].filter(c => c.offsetParent).length"
    seen = f"document.getElementById('count').value + ': ' + {count}"
    answer = browser.ask("Runtime.evaluate", expression=seen, returnByValue=True)
    return answer["result"]["value"]


def site(browser, folder):
    """What is wrong with a site: its pages, the links between them, and its search."""
    told = [f"link to nowhere, {line}" for line in dead(folder)]
    for page in sorted(folder.rglob("*.html")):
        for width in WIDTHS:
            faults = browser.faults(page.resolve().as_uri(), width)
            told += [f"{page.relative_to(folder)} at {width} pixels: {one}" for one in faults]
    if not searched(browser, folder, "friction"):
        told.append("search finds nothing")
    some, every = (filtered(browser, folder, f"verdict={v}") for v in ("fails", ""))
    for count in (some, every):
        if int(count.split(" ")[0]) != int(count.split(": ")[1]):
            told.append(f"claims are counted as {count}")
    if int(some.split(" ")[0]) >= int(every.split(" ")[0]):
        told.append(f"the filter shows {some} and {every}")
    return told


def main(paths):
    """Check pages and folders of them, and first that faults are seen at all; return the status."""
    program = executable()
    if program is None:
        print(f"browser: there is none of {', '.join(NAMES)}", file=sys.stderr)
        return 2
    wrong = 0
    with Browser(program) as browser:
        for fault, body in FAULTY.items():
            if not any(fault in told for told in browser.faults(faulty(body), WIDTHS[0])):
                print(f"browser: does not see the fault {fault!r}", file=sys.stderr)
                wrong += 1
        for folder in (Path(path) for path in paths if Path(path).is_dir()):
            told = site(browser, folder.resolve())
            print("\n".join(f"browser: {line}" for line in told or [f"{folder}: good"]))
            wrong += bool(told)
        for path in (path for path in paths if Path(path).is_file()):
            for width in WIDTHS:
                faults = browser.faults(Path(path).resolve().as_uri(), width)
                print(f"browser: {path} at {width} pixels: {'; '.join(faults) or 'good'}")
                wrong += bool(faults)
    return int(wrong > 0)


def faulty(body):
    """URL of a page with this body."""
    return f"data:text/html,<!doctype html><title>x</title>{body.replace('#', '%23')}"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
