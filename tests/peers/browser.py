"""A page in a real browser, by the DevTools protocol over pipes (no package, no port).

    browser.py CHROMIUM check PAGE       loads the page, switches a channel off, zooms, reads the values under the pointer; prints what it found as JSON
    browser.py CHROMIUM shot PAGE FOLDER light, dark, narrow and printed, as PNG and PDF
"""

import base64
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time


class Browser:
    def __init__(self, program, width=1280, height=900):
        self.profile = tempfile.TemporaryDirectory(prefix="sunglint-browser-", ignore_cleanup_errors=True)
        to_read, self.to = os.pipe()
        self.back, to_write = os.pipe()

        def pipes():
            # The browser reads commands from 3 and answers on 4.
            a, b = os.dup(to_read), os.dup(to_write)
            os.dup2(a, 3)
            os.dup2(b, 4)

        flags = (
            "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking --disable-component-update "
            "--disable-sync --disable-dev-shm-usage --remote-debugging-pipe --hide-scrollbars"
        ).split()
        self.process = subprocess.Popen(
            [program, *flags, f"--user-data-dir={self.profile.name}", f"--window-size={width},{height}", "about:blank"],
            preexec_fn=pipes, close_fds=False, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )
        os.close(to_read)
        os.close(to_write)
        self.number, self.buffer, self.events, self.session = 0, b"", [], None
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ["Page", "Runtime", "Log", "Network"]:
            self.call(f"{domain}.enable")

    def message(self):
        while b"\0" not in self.buffer:
            more = os.read(self.back, 1 << 20)
            if not more:
                raise SystemExit("the browser has ended")
            self.buffer += more
        one, self.buffer = self.buffer.split(b"\0", 1)
        return json.loads(one)

    def call(self, method, **params):
        self.number += 1
        message = {"id": self.number, "method": method, "params": params}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.to, json.dumps(message).encode() + b"\0")
        while True:
            answer = self.message()
            if answer.get("id") == self.number:
                if "error" in answer:
                    raise SystemExit(f"{method}: {answer['error']}")
                return answer["result"]
            self.events.append(answer)

    def load(self, page):
        self.call("Page.navigate", url=pathlib.Path(page).resolve().as_uri())
        while not any(e.get("method") == "Page.loadEventFired" for e in self.events):
            self.events.append(self.message())
        self.settle()

    def settle(self):
        self.run("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(1))))")

    def run(self, script):
        result = self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in result:
            raise SystemExit(f"{script}: {result['exceptionDetails']}")
        return result["result"].get("value")

    def mouse(self, kind, x, y, **more):
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)

    def key(self, key):
        for kind in ["keyDown", "keyUp"]:
            self.call("Input.dispatchKeyEvent", type=kind, key=key, **({"text": key} if len(key) == 1 and kind == "keyDown" else {}))

    def complaints(self):
        """Errors of the page, and what it asked of any network."""
        errors, asked = [], []
        for event in self.events:
            method, params = event.get("method"), event.get("params", {})
            if method == "Runtime.exceptionThrown":
                errors.append(params["exceptionDetails"].get("exception", {}).get("description", "exception"))
            elif method == "Runtime.consoleAPICalled":
                errors.append(f"console.{params['type']}")
            elif method == "Log.entryAdded" and params["entry"]["level"] == "error":
                errors.append(params["entry"]["text"])
            elif method == "Network.requestWillBeSent":
                asked.append(params["request"]["url"])
        return errors, asked

    def end(self):
        try:
            self.session = None
            self.call("Browser.close")
        except SystemExit:
            pass
        self.process.wait(20)
        self.profile.cleanup()


# A picture of the ink on a canvas: a number that changes with what is drawn.
INK = """(() => { const c = document.querySelector('figure[data-chart="values"] canvas');
  const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
  let sum = 0; for (let i = 3; i < d.length; i += 4) sum += d[i]; return sum; })()"""


def check(program, page):
    browser = Browser(program)
    browser.load(page)
    found = {"canvases": browser.run("document.querySelectorAll('canvas').length")}
    box = browser.run(
        """(() => { const c = document.querySelector('figure[data-chart="values"] canvas'); c.scrollIntoView({block: 'center'});
        const r = c.getBoundingClientRect(); return [r.left, r.top, r.width, r.height]; })()"""
    )
    browser.settle()
    found["ink"] = browser.run(INK)
    x, y = box[0] + 0.55 * box[2], box[1] + 0.5 * box[3]
    browser.mouse("mouseMoved", x, y)
    browser.settle()
    found["read"] = browser.run("document.querySelector('.readout').innerText")
    # A channel off: by its key, as a person without a mouse would.
    browser.run("document.querySelector('.key input').focus()")
    browser.key(" ")
    browser.settle()
    found["checked"] = browser.run("document.querySelector('.key input').checked")
    found["ink_without"] = browser.run(INK)
    found["read_without"] = browser.run("document.querySelector('.readout').innerText")
    found["off"] = browser.run("document.querySelectorAll('svg .ch0.off').length")
    browser.key(" ")
    # A stretch of the middle, by dragging.
    browser.mouse("mousePressed", x, y, button="left", clickCount=1)
    for k in range(1, 6):
        browser.mouse("mouseMoved", x + 20 * k, y, button="left", buttons=1)
    browser.mouse("mouseReleased", x + 100, y, button="left", clickCount=1)
    browser.settle()
    found["zoomed"] = not browser.run("document.querySelector('.reset').disabled")
    found["ink_zoomed"] = browser.run(INK)
    before = browser.run("document.querySelector('.readout b').innerText")
    browser.key("ArrowRight")
    browser.settle()
    found["moved"] = before != browser.run("document.querySelector('.readout b').innerText")
    browser.mouse("mouseWheel", x, y, deltaX=0, deltaY=240)
    browser.settle()
    browser.key("0")
    browser.settle()
    found["whole_again"] = browser.run("document.querySelector('.reset').disabled")
    found["width"] = browser.run("document.documentElement.scrollWidth - document.documentElement.clientWidth")
    time.sleep(0.2)
    browser.run("1")
    errors, asked = browser.complaints()
    own = pathlib.Path(page).resolve().as_uri()
    found["errors"], found["asked"] = errors, [url for url in asked if url not in (own, "about:blank")]
    browser.end()
    print(json.dumps(found))


def shot(program, page, folder):
    browser = Browser(program)
    for name, width, scheme in [("light", 1180, "light"), ("dark", 1180, "dark"), ("narrow", 390, "light")]:
        browser.call("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1 if width > 500 else 2, mobile=width < 500)
        browser.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
        browser.events.clear()
        browser.load(page)
        data = browser.call("Page.captureScreenshot", captureBeyondViewport=True, format="png")["data"]
        pathlib.Path(folder, f"{name}.png").write_bytes(base64.b64decode(data))
    data = browser.call("Page.printToPDF", preferCSSPageSize=True, printBackground=True)["data"]
    pathlib.Path(folder, "print.pdf").write_bytes(base64.b64decode(data))
    browser.call("Emulation.setScriptExecutionDisabled", value=True)
    browser.call("Emulation.setDeviceMetricsOverride", width=1180, height=900, deviceScaleFactor=1, mobile=False)
    browser.call("Page.navigate", url=pathlib.Path(page).resolve().as_uri())
    time.sleep(2)
    data = browser.call("Page.captureScreenshot", captureBeyondViewport=True, format="png")["data"]
    pathlib.Path(folder, "no_script.png").write_bytes(base64.b64decode(data))
    browser.end()


if __name__ == "__main__":
    {"check": check, "shot": shot}[sys.argv[2]](sys.argv[1], *sys.argv[3:])
