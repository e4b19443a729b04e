//! A real browser, driven through its protocol (CDP) over two pipes: no package, no port.

use serde_json::{Value, json};
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};
use sunglint_testkit::skip;

const PROGRAMS: [&str; 3] =
    ["/usr/bin/chromium", "/usr/bin/chromium-browser", "/usr/bin/google-chrome"];
const FLAGS: &str = "--headless=new --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking --disable-component-update --disable-sync \
                     --disable-dev-shm-usage --remote-debugging-pipe --hide-scrollbars";
/// How long anything may take on a busy computer.
const LIMIT: Duration = Duration::from_secs(60);

/// A browser with one page.
pub struct Browser {
    child: Child,
    to: ChildStdin,
    back: BufReader<ChildStdout>,
    number: u64,
    session: Option<String>,
    /// Exceptions, errors and violations of the page's policy.
    pub complaints: Vec<String>,
    _profile: super::Folder,
}

fn evaluated(script: &str) -> Value {
    json!({"expression": script, "awaitPromise": true, "returnByValue": true})
}

impl Browser {
    /// Starts one; `None` after the skip of `test` was recorded, where there is none.
    pub fn start(test: &str) -> Option<Self> {
        let Some(program) = PROGRAMS.into_iter().find(|program| Path::new(program).exists()) else {
            skip(test, "no Chromium");
            return None;
        };
        let profile = super::Folder::new("browser");
        // It reads commands from 3 and answers on 4: the shell makes them of its own input and output.
        let script = "exec \"$@\" 3<&0 4>&1 </dev/null >/dev/null 2>&1";
        let mut child = Command::new("sh")
            .args(["-c", script, "sh", program])
            .args(FLAGS.split_whitespace())
            .arg(format!("--user-data-dir={}", profile.0.display()))
            .arg("about:blank")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let (to, back) = (child.stdin.take().unwrap(), child.stdout.take().unwrap());
        let mut browser = Self {
            child,
            to,
            back: BufReader::new(back),
            number: 0,
            session: None,
            complaints: Vec::new(),
            _profile: profile,
        };
        let target = browser.call("Target.createTarget", json!({"url": "about:blank"}));
        let attach = json!({"targetId": target["targetId"], "flatten": true});
        let session = browser.call("Target.attachToTarget", attach);
        browser.session = session["sessionId"].as_str().map(str::to_owned);
        for domain in ["Page", "Runtime", "Log"] {
            browser.call(&format!("{domain}.enable"), json!({}));
        }
        browser.size(1280, 900);
        Some(browser)
    }

    /// A command of the protocol and its result.
    pub fn call(&mut self, method: &str, params: Value) -> Value {
        self.tried(method, params).unwrap_or_else(|error| panic!("{method}: {error}"))
    }

    fn tried(&mut self, method: &str, params: Value) -> Result<Value, String> {
        self.number += 1;
        let mut message = json!({"id": self.number, "method": method, "params": params});
        if let Some(session) = &self.session {
            message["sessionId"] = session.as_str().into();
        }
        self.to.write_all(format!("{message}\0").as_bytes()).unwrap();
        loop {
            let mut bytes = Vec::new();
            self.back.read_until(0, &mut bytes).unwrap();
            assert_eq!(bytes.pop(), Some(0), "{method}: the browser has ended");
            let answer: Value = serde_json::from_slice(&bytes).unwrap();
            if answer["id"] == self.number {
                return match &answer["error"] {
                    Value::Null => Ok(answer["result"].clone()),
                    error => Err(error.to_string()),
                };
            }
            self.hear(&answer);
        }
    }

    fn hear(&mut self, event: &Value) {
        let params = &event["params"];
        let text = match event["method"].as_str() {
            Some("Runtime.exceptionThrown") => params["exceptionDetails"].to_string(),
            Some("Log.entryAdded") if params["entry"]["level"] == "error" => {
                params["entry"]["text"].to_string() + &params["entry"]["url"].to_string()
            }
            Some("Runtime.consoleAPICalled") => params["args"].to_string(),
            _ => return,
        };
        self.complaints.push(text);
    }

    /// Loads an address and waits until the page says that it is ready.
    pub fn open(&mut self, url: &str) {
        // Another fragment alone would load nothing.
        self.call("Page.navigate", json!({"url": "about:blank"}));
        self.call("Page.navigate", json!({"url": url}));
        self.until("document.documentElement?.dataset.ready === 'yes'");
        // A page that is opened before the night begins is told so, and asks again; the browser's own log has that.
        self.complaints.retain(|text| !(text.contains("503") && text.contains("/api/")));
    }

    /// Value of an expression, of a promise too.
    pub fn run(&mut self, script: &str) -> Value {
        let result = self.call("Runtime.evaluate", evaluated(script));
        assert!(result["exceptionDetails"].is_null(), "{script}: {}", result["exceptionDetails"]);
        result["result"]["value"].clone()
    }

    /// Waits until an expression is true.
    pub fn until(&mut self, script: &str) {
        let begun = Instant::now();
        loop {
            // A page that is left for another at that moment has no answer: the next one is asked again.
            match self.tried("Runtime.evaluate", evaluated(script)) {
                Err(error) => assert!(error.contains("navigated"), "{script}: {error}"),
                Ok(result) => {
                    let thrown = &result["exceptionDetails"];
                    assert!(thrown.is_null(), "{script}: {thrown}");
                    if result["result"]["value"] == true {
                        return;
                    }
                }
            }
            let state = begun.elapsed() < LIMIT;
            assert!(state, "{script}: not within {LIMIT:?}: {}", self.text("body"));
            std::thread::sleep(Duration::from_millis(30));
        }
    }

    /// The text of an element, as it is shown.
    pub fn text(&mut self, selector: &str) -> String {
        let script = format!("document.querySelector({})?.innerText ?? ''", json!(selector));
        self.run(&script).as_str().unwrap_or_default().to_owned()
    }

    /// Clicks in the middle of an element, as a hand would.
    pub fn click(&mut self, selector: &str) {
        // What comes in meanwhile may move the element away between the look and the click: then again, as a person would.
        let script = format!(
            "(() => {{ const e = document.querySelector({}); e.scrollIntoView({{block: 'center'}}); const r = e.getBoundingClientRect();
             window.clicked = false; e.addEventListener('click', () => {{ window.clicked = true; }}, {{once: true, capture: true}});
             const at = [r.left + r.width / 2, r.top + r.height / 2]; return e.contains(document.elementFromPoint(...at)) ? at : null; }})()",
            json!(selector)
        );
        for _ in 0..5 {
            let at = self.run(&script);
            assert!(at.is_array(), "{selector} is covered by another element");
            for kind in ["mouseMoved", "mousePressed", "mouseReleased"] {
                let params = json!({"type": kind, "x": at[0], "y": at[1], "button": "left", "clickCount": 1});
                self.call("Input.dispatchMouseEvent", params);
            }
            // A click may have led to another page, which knows of none.
            if self.run("window.clicked") != false {
                return;
            }
        }
        panic!("{selector} could not be clicked");
    }

    /// Presses a key.
    pub fn key(&mut self, key: &str) {
        for kind in ["keyDown", "keyUp"] {
            self.call("Input.dispatchKeyEvent", json!({"type": kind, "key": key}));
        }
    }

    /// Sets the window, px.
    pub fn size(&mut self, width: u32, height: u32) {
        let params =
            json!({"width": width, "height": height, "deviceScaleFactor": 1, "mobile": false});
        self.call("Emulation.setDeviceMetricsOverride", params);
    }

    /// Waits for two pictures.
    pub fn settle(&mut self) {
        self.run("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(1))))");
    }

    /// Serious and critical findings of axe-core on the page as it is; `None` after the skip of `test` was recorded, where it is not installed.
    pub fn axe(&mut self, test: &str) -> Option<Value> {
        let lib = sunglint_testkit::repository().join(".venv/lib");
        let versions = std::fs::read_dir(lib).into_iter().flatten().flatten();
        let file = "site-packages/axe_playwright_python/axe.min.js";
        let source = versions
            .map(|entry| entry.path().join(file))
            .find_map(|path| std::fs::read_to_string(path).ok());
        let Some(source) = source else {
            skip(test, "no axe-core (axe-playwright-python in .venv)");
            return None;
        };
        if self.run("typeof window.axe === 'undefined'") == true {
            self.run(&format!("{source}; 0"));
        }
        let found = self.run(
            "axe.run(document, {elementRef: false}).then(({passes, violations}) => passes.length < 10 ? ['axe-core checked next to nothing'] : violations
               .filter((v) => ['serious', 'critical'].includes(v.impact))
               .map((v) => `${v.id}: ${v.help}: ${v.nodes.map((n) => `${n.target} (${n.any.map((a) => a.message).join('; ')})`).join(' | ')}`))",
        );
        Some(found)
    }

    /// The whole page as PNG, into a file.
    pub fn shot(&mut self, path: &Path) {
        let taken = self.call("Page.captureScreenshot", json!({"captureBeyondViewport": true}));
        let script =
            "import base64, sys; open(sys.argv[1], 'wb').write(base64.b64decode(sys.stdin.read()))";
        let mut python = Command::new("python3")
            .args(["-c", script])
            .arg(path)
            .stdin(Stdio::piped())
            .spawn()
            .unwrap();
        let text = taken["data"].as_str().unwrap();
        python.stdin.take().unwrap().write_all(text.as_bytes()).unwrap();
        assert!(python.wait().unwrap().success());
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        // Its other processes end with it.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
