// The page of a night: live (it polls the state ten times a second) or recorded (a film over a session's folder).
// All texts of files and devices go into the page by textContent: they are text, never markup.

const $ = (id) => document.getElementById(id);
const clamp = (x, low, high) => Math.min(high, Math.max(low, x));
const root = document.documentElement;

// --- the server ---------------------------------------------------------------------------------------------------------

const TOKEN = "sunglint-token";
const token = () => sessionStorage.getItem(TOKEN);
// What depends on whether this page may steer: done at once, and again when that changes.
const steering = [];
let tokenCame = () => {};
function onToken(act) {
  steering.push(act);
  act();
}
function setToken(text) {
  text ? sessionStorage.setItem(TOKEN, text) : sessionStorage.removeItem(TOKEN);
  for (const act of steering) act();
  if (!text) return;
  notice("");
  tokenCame();
}
// A token in the address, also one that is pasted into a page that is open. It goes out of the address, so that it is in no screenshot and no bookmark.
function takeToken() {
  const told = new URLSearchParams(location.hash.slice(1)).get("token");
  if (!told) return;
  history.replaceState(null, "", location.pathname);
  setToken(told);
}
takeToken();
addEventListener("hashchange", takeToken);
// Nothing is asked where nothing is told without a token.
async function wakened(error) {
  if (error.status === 401 && !error.with_token && !token()) await new Promise((done) => { tokenCame = done; });
}

class Refused extends Error {
  constructor(status, text, with_token) {
    super(text);
    Object.assign(this, { status, with_token });
  }
}
// The program did not answer, or not in time. All other errors are faults of this page.
class Silent extends Error {}

// An answer of the program, read as JSON, or by another method of a Response.
async function ask(path, body, { patience_ms = 8000, as = "json" } = {}) {
  const headers = {};
  const with_token = token();
  if (with_token) headers.authorization = `Bearer ${with_token}`;
  if (body) headers["content-type"] = "application/json";
  const options = { headers, signal: AbortSignal.timeout(patience_ms), cache: "no-store" };
  if (body) Object.assign(options, { method: "POST", body: JSON.stringify(body) });
  let answer;
  let said;
  try {
    answer = await fetch(`api/${path}`, options);
    said = answer.ok ? await answer[as]() : await answer.text();
  } catch (error) {
    if (error instanceof SyntaxError) throw error;
    throw new Silent(`${path}: ${error.message}`);
  }
  if (answer.ok) return said;
  let text = `the server answered ${answer.status}`;
  try { text = JSON.parse(said).error ?? text; } catch { /* another server than ours */ }
  // A token that this server does not know is of another start: kept, it would be told again and again.
  if (answer.status === 401 && with_token && with_token === token()) setToken(null);
  throw new Refused(answer.status, text, Boolean(with_token));
}
const get = (path) => ask(path);
const part = encodeURIComponent;

// Runs one at a time, the last wish wins: nothing piles up behind a slow answer.
function latest(work) {
  let busy = false;
  let wish;
  return async function want(value) {
    wish = { value };
    if (busy) return;
    busy = true;
    try {
      while (wish) {
        const now = wish.value;
        wish = undefined;
        try {
          await work(now);
        } catch (error) {
          complain(error);
        }
      }
    } finally {
      busy = false;
    }
  };
}

// --- what is known ------------------------------------------------------------------------------------------------------

const S = {
  about: null, live: null, t: 0, playing: false, film: null, frame: null, marks: null, counts: {}, shown: null, sky: null, tracks: [], events: [], states: {}, listed: 0, reached: -1, seen: { events: 0, counts: {} },
  history: {}, looks: null, wideAt: 0, cross: null, anew: false, view: null, off: new Set(), hover: null, since: 0, lag: {},
};
window.sunglint = S; // for those who look into it with the browser's console, and for tests

function notice(text) {
  $("notice").textContent = text;
  $("notice").hidden = !text;
}
function complain(error) {
  if (error instanceof Refused) notice(error.message);
  else if (error instanceof Silent) notice("the program that serves this page does not answer");
  else {
    // A fault of the page is told as such, and the page goes on as well as it can.
    console.error(error);
    notice(`this page has a fault: ${error.message}. Load it again; if it stays, tell us what you did`);
  }
}
// What is wrong with what is shown, all of it; it stays.
function warnings(list) {
  const box = $("warnings");
  box.hidden = !list.length;
  box.open = list.length > 0 && list.length <= 3;
  box.querySelector("summary").textContent = list.length === 1 ? "1 warning" : `${list.length} warnings`;
  box.querySelector("ul").replaceChildren(...list.map((text) => Object.assign(document.createElement("li"), { textContent: text })));
}

const two = (n) => String(n).padStart(2, "0");
function utc(seconds, digits = 1) {
  const date = new Date(S.about.start_unix_ms + seconds * 1000 + (digits ? 0 : 500));
  const fraction = digits ? "." + String(date.getUTCMilliseconds()).padStart(3, "0").slice(0, digits) : "";
  return `${two(date.getUTCHours())}:${two(date.getUTCMinutes())}:${two(date.getUTCSeconds())}${fraction}`;
}
function span(seconds) {
  const s = Math.max(0, Math.round(seconds));
  if (s >= 3600) return `${Math.floor(s / 3600)} h ${two(Math.floor(s / 60) % 60)} min`;
  return s >= 60 ? `${Math.floor(s / 60)} min ${two(s % 60)} s` : `${s} s`;
}
function hertz(rate) {
  if (!Number.isFinite(rate)) return "–";
  const [value, unit] = rate >= 1e6 ? [rate / 1e6, "MHz"] : rate >= 1e3 ? [rate / 1e3, "kHz"] : [rate, "Hz"];
  return `${value >= 100 || unit === "Hz" ? value.toFixed(0) : value.toPrecision(3)} ${unit}`;
}
const flagNames = (bits) => S.about.flag_names.filter(([bit]) => bits & bit).map(([, name]) => name.replaceAll("_", " "));
const visitAt = (t) => S.about.visits.findLast((v) => v.from_s <= t && t < v.to_s);

// --- colours ------------------------------------------------------------------------------------------------------------

const LINES = {
  light: ["#0b5cad", "#b3261e", "#1c6b3a", "#8a5a00", "#6a3fb5", "#006d77"],
  dark: ["#7cb7ff", "#ff8a80", "#7fd49b", "#ffcc66", "#c6a6ff", "#70d6e0"],
  red: ["#ff2a2a", "#ff2a2a", "#ff2a2a", "#ff2a2a", "#ff2a2a", "#ff2a2a"],
};
const STROKES = [[], [7, 3], [2, 3], [9, 3, 2, 3]];
const system = matchMedia("(prefers-color-scheme: dark)");
function theme() {
  const wanted = $("theme").value;
  return wanted === "auto" ? (system.matches ? "dark" : "light") : wanted;
}
function css(name) {
  return getComputedStyle(root).getPropertyValue(name).trim();
}
// Bright is warm, faint is cold; red light has one colour, and its width alone.
function lightColour(v) {
  if (theme() === "red") return css("--accent");
  const part = clamp((7 - v) / 7, 0, 1);
  return `hsl(${220 - 190 * part} 85% ${theme() === "dark" ? 65 : 38}%)`;
}
const thickness = (v) => clamp(4.5 - 0.5 * v, 1.2, 4.5);
const lineColour = (i) => LINES[theme()][i % 6];
function paintTheme() {
  root.dataset.theme = theme();
  drawAll();
  legend();
}

// --- canvases -----------------------------------------------------------------------------------------------------------

function fit(canvas) {
  if (paper?.of === canvas) return paper;
  const scale = Math.min(devicePixelRatio || 1, 3);
  const [w, h] = [Math.max(1, Math.round(canvas.clientWidth * scale)), Math.max(1, Math.round(canvas.clientHeight * scale))];
  if (canvas.width !== w || canvas.height !== h) Object.assign(canvas, { width: w, height: h });
  const c = canvas.getContext("2d");
  c.setTransform(scale, 0, 0, scale, 0, 0);
  c.clearRect(0, 0, canvas.clientWidth, canvas.clientHeight);
  const size = parseFloat(getComputedStyle(root).fontSize);
  c.font = `${0.8125 * size}px system-ui, "DejaVu Sans", sans-serif`;
  return { c, w: canvas.clientWidth, h: canvas.clientHeight, em: size };
}

// A figure that is being saved: what is drawn on a canvas then goes there.
let paper = null;

// As much of a canvas' drawing as the figures use, as elements of SVG. Texts are texts of elements, never markup.
class Vector {
  constructor(w, h, font) {
    Object.assign(this, { fillStyle: "#000", strokeStyle: "#000", lineWidth: 1, globalAlpha: 1, font, textAlign: "left", textBaseline: "alphabetic", dash: [], d: "", clips: 0, stack: [] });
    this.ruler = document.createElement("canvas").getContext("2d");
    this.root = this.into = this.node("svg", { width: w, height: h, viewBox: `0 0 ${w} ${h}` });
  }
  node(name, attributes) {
    const node = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, typeof value === "number" ? String(Math.round(value * 100) / 100) : value);
    return node;
  }
  put(name, attributes) {
    const node = this.node(name, this.globalAlpha < 1 ? { ...attributes, opacity: this.globalAlpha } : attributes);
    this.into.append(node);
    return node;
  }
  setLineDash(dash) { this.dash = dash; }
  beginPath() { this.d = ""; }
  step(letter, ...at) { this.d += letter + at.map((v) => Math.round(v * 100) / 100).join(" "); }
  moveTo(x, y) { this.step("M", x, y); }
  lineTo(x, y) { this.step(this.d ? "L" : "M", x, y); }
  rect(x, y, w, h) { this.step("M", x, y); this.d += `h${w}v${h}h${-w}z`; }
  // Whole circles alone are drawn.
  arc(x, y, r) { this.step("M", x - r, y); this.step("A", r, r, 0, 1, 0, x + r, y); this.step("A", r, r, 0, 1, 0, x - r, y); }
  line() { return { stroke: this.strokeStyle, "stroke-width": this.lineWidth, fill: "none", ...(this.dash.length ? { "stroke-dasharray": this.dash.join(" ") } : {}) }; }
  stroke() { if (this.d) this.put("path", { d: this.d, ...this.line() }); }
  fill() { if (this.d) this.put("path", { d: this.d, fill: this.fillStyle }); }
  fillRect(x, y, width, height) { this.put("rect", { x, y, width, height, fill: this.fillStyle }); }
  strokeRect(x, y, width, height) { this.put("rect", { x, y, width, height, ...this.line() }); }
  fillText(text, x, y) {
    const [, size, family] = /([\d.]+)px (.*)/.exec(this.font);
    const anchor = { left: "start", center: "middle", right: "end" }[this.textAlign];
    const down = { alphabetic: 0, middle: 0.35, top: 0.8 }[this.textBaseline] * Number(size);
    this.put("text", { x, y: y + down, fill: this.fillStyle, "font-size": Number(size), "font-family": family, "text-anchor": anchor }).textContent = text;
  }
  measureText(text) { this.ruler.font = this.font; return this.ruler.measureText(text); }
  save() { this.stack.push(this.into); }
  restore() { this.into = this.stack.pop() ?? this.root; }
  clip() {
    const id = `clip${++this.clips}`;
    const clip = this.node("clipPath", { id });
    clip.append(this.node("path", { d: this.d }));
    const group = this.node("g", { "clip-path": `url(#${id})` });
    this.into.append(clip, group);
    this.into = group;
  }
}

function download(blob, name) {
  const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}
const fileName = (text) => text.replace(/[^\p{L}\p{N}_.-]+/gu, "_");

// What a figure is of, with the channels' colours: a figure has no page about it.
function captions(name) {
  const date = new Date(S.about.start_unix_ms + 1000 * (S.live ? S.live.now_s : S.t)).toISOString();
  const out = [[`${S.about.name}, ${date.slice(0, 10)}${name === "counts" || name === "curve" ? "" : ` ${date.slice(11, 19)}`} UTC`]];
  const data = countsNow();
  if (name === "counts" && data) {
    const unit = magnitudesOf(data) ? "magnitude" : $("corrected").checked ? "without dead time and dark counts" : "as counted";
    out[0][0] += `, ${S.counter}, ${unit}`;
    data.channels.forEach((channel, k) => { if (!S.off.has(channel)) out.push([channel, lineColour(k), theme() === "red" ? STROKES[k % 4] : []]); });
  }
  if (name === "curve") {
    const channel = R.now.channels.find((c) => c.name === $("rework-channel").value);
    out[0][0] += `, ${R.visit.name}, ${channel?.name} (${inMagnitudes(channel) ? "mag" : channel?.unit})`;
  }
  return out;
}
function drawCaptions(c, parts, w, em, top) {
  c.textAlign = "left";
  c.textBaseline = "middle";
  let [x, y] = [0.6 * em, top + 0.7 * em];
  for (const [text, colour, dash] of parts) {
    const wide = c.measureText(text).width + (colour ? 2 * em : 0);
    if (x > em && x + wide > w) { x = 0.6 * em; y += 1.3 * em; }
    if (colour) {
      c.strokeStyle = colour;
      c.lineWidth = 1.5;
      c.setLineDash(dash);
      c.beginPath(); c.moveTo(x, y); c.lineTo(x + 1.6 * em, y); c.stroke();
      c.setLineDash([]);
    }
    c.fillStyle = css("--ink");
    c.fillText(text, x + (colour ? 2 * em : 0), y);
    x += wide + em;
  }
  return y + 0.7 * em;
}

// A canvas as it is shown, on the panel's colour, with a line of what it is.
async function figure(name, kind) {
  const canvas = $(name);
  DRAW[name]();
  const { w, h, em } = { w: canvas.clientWidth, h: canvas.clientHeight, em: parseFloat(getComputedStyle(root).fontSize) };
  const font = `${0.8125 * em}px system-ui, "DejaVu Sans", sans-serif`;
  const parts = captions(name);
  // Drawn once to learn its height.
  const high = Math.ceil(drawCaptions(new Vector(w, h, font), parts, w, em, h));
  let blob;
  if (kind === "svg") {
    const c = new Vector(w, high, font);
    c.fillStyle = css("--panel");
    c.fillRect(0, 0, w, high);
    paper = { of: canvas, c, w, h, em };
    try { DRAW[name](); } finally { paper = null; }
    drawCaptions(c, parts, w, em, h);
    blob = new Blob([new XMLSerializer().serializeToString(c.root)], { type: "image/svg+xml" });
  } else {
    const scale = canvas.width / w;
    const whole = Object.assign(document.createElement("canvas"), { width: canvas.width, height: Math.round(high * scale) });
    const c = whole.getContext("2d");
    c.fillStyle = css("--panel");
    c.fillRect(0, 0, whole.width, whole.height);
    c.drawImage(canvas, 0, 0);
    c.scale(scale, scale);
    c.font = font;
    drawCaptions(c, parts, w, em, h);
    blob = await new Promise((done) => whole.toBlob(done, "image/png"));
  }
  S.saved = { name: `${name}.${kind}`, blob };
  download(blob, `${fileName(S.about.name)}-${name}.${kind}`);
}

// How old what is new was when it was drawn, s: by this computer's clock, which in tests is the night's.
function drawn(what, end_s) {
  const list = (S.lag[what] ??= []);
  if (list.last === end_s) return;
  list.last = end_s;
  list.push((Date.now() - S.about.start_unix_ms) / 1000 - end_s);
  if (list.length > 600) list.splice(0, 300);
}

const dirty = new Set();
function redraw(name) {
  if (!dirty.size) requestAnimationFrame(() => { const now = [...dirty]; dirty.clear(); for (const one of now) DRAW[one](); });
  dirty.add(name);
}
function drawAll() {
  for (const name of Object.keys(DRAW)) redraw(name);
}

// --- image --------------------------------------------------------------------------------------------------------------

function decode(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  return { header, pixels: new Uint16Array(buffer, 4 + length) };
}

// Range of colours as IRAF's zscale has it: a line through the sorted sample, outliers left out, contrast 0.25.
export function zscale(values) {
  const n = Math.min(values.length, 1000);
  const step = Math.max(1, Math.floor(values.length / n));
  const sample = Float64Array.from({ length: Math.floor((values.length - 1) / step) + 1 }, (_, i) => values[i * step]).sort().subarray(0, 1000);
  const size = sample.length;
  const [low, high] = [sample[0], sample[size - 1]];
  const least = Math.max(5, Math.floor(size * 0.5));
  let good = new Uint8Array(size).fill(1);
  let [kept, before, slope, offset] = [size, size + 1, 0, 0];
  for (let round = 0; round < 5 && kept < before && kept >= least; round++) {
    let [sw, sx, sy, sxx, sxy] = [0, 0, 0, 0, 0];
    for (let i = 0; i < size; i++) if (good[i]) { sw++; sx += i; sy += sample[i]; sxx += i * i; sxy += i * sample[i]; }
    slope = (sw * sxy - sx * sy) / (sw * sxx - sx * sx || 1);
    offset = (sy - slope * sx) / sw;
    let [mean, square] = [0, 0];
    for (let i = 0; i < size; i++) if (good[i]) mean += sample[i] - slope * i - offset;
    mean /= sw;
    for (let i = 0; i < size; i++) if (good[i]) square += (sample[i] - slope * i - offset - mean) ** 2;
    const limit = 2.5 * Math.sqrt(square / sw);
    const bad = good.map((_, i) => (Math.abs(sample[i] - slope * i - offset) > limit ? 1 : 0));
    // A bad pixel takes its neighbours with it.
    const grow = Math.max(1, Math.floor(size * 0.01));
    const out = new Uint8Array(size);
    const half = Math.floor(grow / 2);
    for (let i = 0; i < size; i++) if (bad[i] || !good[i]) out.fill(1, Math.max(0, i - half), i + half + 1);
    good = good.map((_, i) => 1 - out[i]);
    before = kept;
    kept = good.reduce((sum, g) => sum + g, 0);
  }
  if (kept < least) return [low, high];
  const middle = Math.floor((size - 1) / 2);
  const median = size % 2 ? sample[middle] : (sample[middle] + sample[middle + 1]) / 2;
  const wide = slope / 0.25;
  return [Math.max(low, median - (middle - 1) * wide), Math.min(high, median + (size - middle) * wide)];
}

function stretch(pixels) {
  const kind = $("stretch").value;
  const step = Math.max(1, Math.floor(pixels.length / 20000));
  // Numbers that are typed sort five times as fast: this is done for each frame.
  const sample = new Uint16Array(Math.ceil(pixels.length / step));
  for (let i = 0; i < sample.length; i++) sample[i] = pixels[i * step];
  sample.sort();
  const at = (q) => sample[Math.round(q * (sample.length - 1))] ?? 0;
  let [low, high, curve, soft] = [at(0.002), Math.max(at(0.9998), at(0.002) + 1), (x) => x, null];
  if (kind === "zscale") [low, high] = zscale(pixels);
  if (kind === "asinh") {
    const spread = Math.max(1, 1.4826 * (at(0.5) - at(0.16)));
    low = Math.max(0, at(0.5) - 2 * spread);
    high = clamp(sample[sample.length - 1], low + 10 * spread, Math.max(65535, low + 1));
    soft = (6 * spread) / (high - low);
    const top = Math.asinh(1 / soft);
    curve = (x) => Math.asinh(x / soft) / top;
  }
  const red = theme() === "red";
  const table = new Uint32Array(65536);
  const colour = (part) => { const g = Math.round(255 * curve(part)); return 0xff000000 | (red ? g : (g << 16) | (g << 8) | g); };
  // The curve is worked out between its ends alone.
  const [first, last] = [Math.ceil(Math.max(low, 0)), Math.min(Math.floor(high), 65535)];
  table.fill(colour(0), 0, first);
  for (let v = first; v <= last; v++) table[v] = colour(clamp((v - low) / (high - low || 1), 0, 1));
  table.fill(colour(1), Math.max(0, last + 1));
  return { table, low, high, soft };
}

function develop() {
  const f = S.frame;
  if (!f) return;
  const [w, h] = f.header.shape;
  const { table, low, high, soft } = stretch(f.pixels);
  Object.assign(f, { low, high, soft });
  f.canvas ??= Object.assign(document.createElement("canvas"), { width: w, height: h });
  const image = new ImageData(w, h);
  const out = new Uint32Array(image.data.buffer);
  for (let i = 0; i < out.length; i++) out[i] = table[f.pixels[i]];
  f.canvas.getContext("2d").putImageData(image, 0, 0);
}

// The window of the frame that is shown, in its pixels, with the shape of the canvas.
function windowOf(w, h) {
  const [columns, rows] = S.frame.header.size_px;
  const whole = Math.max(columns / w, rows / h);
  const view = S.view ?? { x: columns / 2, y: rows / 2, scale: 1 };
  const each = whole / view.scale; // frame pixels in one of the canvas
  return { each, x0: view.x - (each * w) / 2, y0: view.y - (each * h) / 2 };
}

function drawImage() {
  const canvas = $("image");
  if (S.frame) {
    const [columns, rows] = S.frame.header.size_px;
    canvas.style.aspectRatio = String(clamp(columns / rows, 0.8, 2));
  }
  const { c, w, h, em } = fit(canvas);
  c.fillStyle = "#000";
  c.fillRect(0, 0, w, h);
  const f = S.frame;
  if (!f) return;
  const { each, x0, y0 } = windowOf(w, h);
  const [x, y, pw, ph] = f.header.part_px;
  c.imageSmoothingEnabled = each > 1;
  c.drawImage(f.canvas, (x - x0) / each, (y - y0) / each, (f.header.shape[0] * f.header.bin) / each, (f.header.shape[1] * f.header.bin) / each);
  if (S.live) drawn("image", f.header.start_s + f.header.exposure_s);
  if (!$("marks").checked) return;
  const red = theme() === "red";
  const place = ([px, py]) => [(px + 0.5 - x0) / each, (py + 0.5 - y0) / each];
  const ring = (at, a, b, colour, dash = []) => {
    c.strokeStyle = colour;
    c.setLineDash(dash);
    c.beginPath();
    c.ellipse(...place(at), a / each, b / each, 0, 0, 7);
    c.stroke();
    c.setLineDash([]);
  };
  c.lineWidth = 1.5;
  const sensor = S.about.sensor_px ?? f.header.size_px;
  // The station describes one camera: its fibres lie on no other's frames.
  if (S.camera === S.about.station_camera) S.about.fibres.forEach((fibre, i) => {
    const at = [0, 1].map((k) => ((sensor[k] - 1) / 2 + fibre.offset_px[k] - f.header.origin_px[k]) / f.header.binning[k]);
    const [a, b] = [0, 1].map((k) => fibre.sigma_px[k] / f.header.binning[k]);
    ring(at, a, b, red ? "#802020" : "#5fd0e0", [4, 4]);
    if (each < 3) {
      c.fillStyle = red ? "#a03030" : "#5fd0e0";
      const [tx, ty] = place(at);
      // Each name at another height: the fields lie within one another.
      c.fillText(fibre.channel, tx + a / each + 0.6 * em, ty + (i - (S.about.fibres.length - 1) / 2) * 1.2 * em);
    }
  });
  const by_hand = reworkedPlace();
  if (by_hand && R.now.aperture_px) {
    const [aperture, ...annulus] = R.now.aperture_px;
    ring(by_hand, aperture, aperture, red ? "#ff4040" : "#ffd24a");
    for (const radius of annulus) ring(by_hand, radius, radius, red ? "#c03030" : "#ffd24a", [6, 4]);
  }
  const m = S.marks;
  if (m?.place_px && m.of === f.of && !by_hand) {
    ring(m.place_px, m.aperture_px, m.aperture_px, red ? "#ff6060" : "#ffffff");
    for (const radius of m.annulus_px) ring(m.place_px, radius, radius, red ? "#c03030" : "#ff9060", [6, 4]);
  }
  if (m?.of === f.of) {
    // Where the reduction looks for a target first.
    const [ex, ey] = place(m.expected_px);
    c.strokeStyle = red ? "#a03030" : "#8fb0ff";
    c.lineWidth = 1;
    c.beginPath();
    for (const [a, b] of [[-1, 0], [1, 0], [0, -1], [0, 1]]) { c.moveTo(ex + 0.2 * em * a, ey + 0.2 * em * b); c.lineTo(ex + 0.5 * em * a, ey + 0.5 * em * b); }
    c.stroke();
    if ($("sources").checked) drawSources(c, m.sources ?? [], place, each, em, red);
    c.lineWidth = 1.5;
  }
  if (S.cross && placing()) {
    const [cx, cy] = [(S.cross[0] - x0) / each, (S.cross[1] - y0) / each];
    c.strokeStyle = red ? "#ff6060" : "#7fff7f";
    c.beginPath();
    for (const [a, b] of [[-1, 0], [1, 0], [0, -1], [0, 1]]) { c.moveTo(cx + 0.3 * em * a, cy + 0.3 * em * b); c.lineTo(cx + em * a, cy + em * b); }
    c.stroke();
  }
}

// All sources of the frame: points in squares, streaks as lines, cosmic rays and hot pixels as crosses, the rest in small circles.
function drawSources(c, sources, place, each, em, red) {
  const colours = red ? { point: "#ff6060", streak: "#ff4040", sharp: "#a03030", other: "#802020" } : { point: "#7fff7f", streak: "#ff9bd0", sharp: "#ffb060", other: "#a0a8b0" };
  const r = 0.45 * em;
  for (const { kind, place_px, trail_px } of sources) {
    const [x, y] = place(place_px);
    c.strokeStyle = colours[kind];
    c.beginPath();
    if (kind === "point") c.rect(x - r, y - r, 2 * r, 2 * r);
    else if (kind === "streak") { const [dx, dy] = trail_px.map((v) => v / each / 2); const long = Math.hypot(dx, dy), more = long ? Math.max(1, em / long) : 0; c.moveTo(x - dx * more, y - dy * more); c.lineTo(x + dx * more, y + dy * more); }
    else if (kind === "sharp") { c.moveTo(x - r / 2, y - r / 2); c.lineTo(x + r / 2, y + r / 2); c.moveTo(x - r / 2, y + r / 2); c.lineTo(x + r / 2, y - r / 2); }
    else c.arc(x, y, r / 2, 0, 7);
    c.stroke();
  }
}

function frameText() {
  const f = S.frame;
  if (!f) return;
  const h = f.header;
  const age = S.live ? `, ${span(S.live.now_s - h.start_s - h.exposure_s)} old` : "";
  const parts = [h.number || !S.live ? `frame ${h.number}` : "looks for the target (not recorded)", `${utc(h.start_s, 3)} UTC`, `${h.exposure_s} s${age}`];
  if (h.target) parts.push(h.target);
  if (h.filter) parts.push(`filter ${h.filter}`);
  if (h.bin > 1) parts.push(`shown ${h.bin} × ${h.bin} binned`);
  parts.push(`${Math.round(f.low)} to ${Math.round(f.high)} ADU`);
  $("frame-text").textContent = parts.join(" · ");
  $("image").setAttribute("aria-label", `frame ${h.number} of camera ${S.camera} at ${utc(h.start_s)} UTC, target ${h.target ?? "none"}`);
}

function measuredText() {
  const m = S.marks;
  // Marks of a frame that is not shown yet are told with it.
  if (m && S.frame && m.of !== S.frame.of) return;
  if (!m) { $("measured").textContent = "\u00a0"; return; }
  const kinds = [["point", "point", "points"], ["streak", "streak", "streaks"], ["sharp", "cosmic ray or hot pixel", "cosmic rays or hot pixels"], ["other", "other", "others"]];
  const counted = kinds.map(([kind, ...names]) => { const n = m.sources?.filter((source) => source.kind === kind).length ?? 0; return n ? `${n} ${names[n === 1 ? 0 : 1]}` : ""; }).filter(Boolean);
  const all = m.sources && $("sources").checked ? ` · ${m.sources.length}${m.sources_left_out ? ` of ${m.sources.length + m.sources_left_out}` : ""} sources${counted.length ? `: ${counted.join(", ")}` : ""}` : "";
  if (!m.place_px) { $("measured").textContent = `no target found on this frame${all}`; return; }
  const planes = m.planes.map((p) => {
    const rate = p.rate_adu_per_s === null ? "no rate" : `${p.rate_adu_per_s.toFixed(0)} ± ${p.sigma_adu_per_s?.toFixed(0) ?? "–"} ADU/s`;
    const flags = p.flags.length ? ` (${p.flags.join(", ").replaceAll("_", " ")})` : "";
    return `${p.colour === "mono" ? "" : p.colour + " "}${rate}${flags}`;
  });
  const width = m.fwhm_px === null ? "" : `, ${m.fwhm_px.toFixed(1)} px wide`;
  // It is measured once a second: between two measurements the last one stands there.
  if (m.hfr_px !== undefined) S.radius = { px: m.hfr_px, of: m.of, camera: S.camera };
  const last = S.radius?.camera === S.camera && Math.abs(m.of - S.radius.of) < 2 ? S.radius.px : undefined;
  const radius = last === undefined ? "" : `, half-flux radius ${last.toFixed(2)} px`;
  $("measured").textContent = `target at ${m.place_px[0].toFixed(1)}, ${m.place_px[1].toFixed(1)} px${width}${radius}: ${planes.join("; ")}${all}`;
}

const loadMarks = latest(async ({ camera, of }) => {
  if (!$("marks").checked) return;
  try {
    const marks = await get(`marks/${part(camera)}/${S.live ? "last" : of}${$("sources").checked ? "?sources=1" : ""}`);
    if (camera !== S.camera) return;
    // A night goes on meanwhile: these may be the marks of the next frame, which is drawn soon.
    S.marks = { ...marks, of: S.live ? marks.start_s : of };
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    if (camera !== S.camera) return;
    if (error.status === 503) {
      // Another page's frame is measured.
      await new Promise((done) => setTimeout(done, 300));
      if (S.frame && S.live) loadMarks({ camera: S.camera, of: S.frame.of });
      return;
    }
    S.marks = null;
    $("measured").textContent = error.message;
    return;
  }
  measuredText();
  redraw("image");
});

const loadFrame = latest(async ({ camera, of, again }) => {
  if (!again && S.frame?.of === of && S.frame.camera === camera) return;
  const canvas = $("image");
  const query = new URLSearchParams({ most: String(clamp(Math.round(canvas.clientWidth * (devicePixelRatio || 1)), 200, 1280)) });
  const size = S.frame?.header.size_px;
  if (S.view && size && Math.max(...size) > 1280) {
    const { each, x0, y0 } = windowOf(canvas.clientWidth, canvas.clientHeight);
    const [w, h] = [each * canvas.clientWidth, each * canvas.clientHeight];
    const values = { x: Math.max(0, x0), y: Math.max(0, y0), w: w + 1, h: h + 1 };
    for (const [key, value] of Object.entries(values)) query.set(key, String(Math.floor(value)));
  }
  const buffer = await ask(`frame/${part(camera)}${S.live ? "" : `/${of}`}?${query}`, null, { as: "arrayBuffer" });
  // Another camera may have been chosen meanwhile.
  if (camera !== S.camera) return;
  const frame = decode(buffer);
  S.frame = { ...frame, of: S.live ? frame.header.start_s : of, camera };
  develop();
  frameText();
  redraw("image");
  if (S.marks?.of === S.frame.of) measuredText();
  loadMarks({ camera, of: S.frame.of });
  if (!S.live) later();
});

function zoom(factor, at) {
  if (!S.frame) return;
  const [columns, rows] = S.frame.header.size_px;
  const now = S.view ?? { x: columns / 2, y: rows / 2, scale: 1 };
  const scale = clamp(now.scale * factor, 1, 64);
  const [ax, ay] = at ?? [now.x, now.y];
  const keep = now.scale / scale;
  S.view = scale === 1 ? null : { x: ax + (now.x - ax) * keep, y: ay + (now.y - ay) * keep, scale };
  redraw("image");
  if (Math.max(columns, rows) > 1280) loadFrame({ camera: S.camera, of: S.frame.of, again: true });
}

function pixelUnder(event) {
  const canvas = $("image");
  const box = canvas.getBoundingClientRect();
  const { each, x0, y0 } = windowOf(canvas.clientWidth, canvas.clientHeight);
  return [x0 + (event.clientX - box.left) * each, y0 + (event.clientY - box.top) * each];
}
function readPixel([fx, fy]) {
  const h = S.frame.header;
  const [column, row] = [Math.floor(fx), Math.floor(fy)];
  const [i, j] = [Math.floor((fx - h.part_px[0]) / h.bin), Math.floor((fy - h.part_px[1]) / h.bin)];
  if (i < 0 || j < 0 || i >= h.shape[0] || j >= h.shape[1]) { $("pixel").textContent = "\u00a0"; return; }
  const value = S.frame.pixels[j * h.shape[0] + i];
  const saturated = h.saturation_adu !== null && value >= h.saturation_adu ? ", saturated" : "";
  $("pixel").textContent = `column ${column}, row ${row}: ${value} ADU${h.bin > 1 ? ` (mean of ${h.bin} × ${h.bin})` : ""}${saturated}`;
}

// What takes the place in the image that a person is asked for; null where none is asked for. It is told by a click, or by a cross that the arrow keys move.
function placing() {
  return R.pointing ? pointAt : S.live && M.mode ? mountPlace : null;
}
function askPlace(text) {
  S.cross = null;
  notice(`${text}; or move the cross there by the arrow keys (shift: by 10) and press Enter`);
  $("image").focus();
}
function crossKey(event) {
  const take = placing();
  const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
  if (!take || !S.frame || !(way || event.key === "Enter")) return;
  event.preventDefault();
  event.stopPropagation();
  const size = S.frame.header.size_px;
  // The light that was found is near to what is meant.
  const found = S.marks?.of === S.frame.of ? S.marks.place_px : null;
  S.cross ??= found ? found.map((v) => v + 0.5) : size.map((v) => v / 2);
  if (way) {
    S.cross = S.cross.map((v, k) => clamp(v + way[k] * (event.shiftKey ? 10 : 1), 0, size[k] - 1e-6));
    readPixel(S.cross);
  } else {
    const at = S.cross;
    S.cross = null;
    take(at);
  }
  redraw("image");
}

// --- counts -------------------------------------------------------------------------------------------------------------

function range() {
  const wanted = $("span").value;
  const now = S.live ? S.live.now_s : S.t;
  if (wanted === "all") return S.live ? [Math.min(now - 60, S.history[S.counter]?.start_s[0] ?? 0), now] : [0, S.about.length_s];
  if (wanted === "visit") {
    const visit = S.live ? S.live.target && { from_s: S.live.target.from_s, to_s: Math.min(now, S.live.target.to_s ?? now) } : visitAt(now);
    if (visit) return [visit.from_s, Math.max(visit.to_s, visit.from_s + 1)];
  }
  const length = Number(wanted) || 60;
  return S.live ? [now - length, now] : [now - length / 2, now + length / 2];
}

const loadCounts = latest(async ({ counter, from, to }) => {
  // A little more than is seen, so that play needs no request for each picture.
  const more = (to - from) * 0.5;
  const points = Math.round(clamp($("counts").clientWidth * 2, 300, 3000));
  const query = new URLSearchParams({ from_s: String(from - more), to_s: String(to + more), points: String(points) });
  const counts = await get(`counts/${part(counter)}?${query}`);
  S.shown = { ...counts, counter, from: from - more, to: to + more, span: to - from };
  redraw("counts");
});

function needCounts() {
  if (S.live || !S.counter) return;
  const [from, to] = range();
  const have = S.shown;
  const near = have?.counter === S.counter && have.from <= from && have.to >= to && Math.abs(have.span - (to - from)) < 0.01 * (to - from);
  if (!near) loadCounts({ counter: S.counter, from, to });
}

function countsNow() {
  return S.live ? S.counts[S.counter] : S.shown;
}

// The whole night in points of some seconds, with the lowest and the highest rate in each: what is older than the points of a tenth of a second.
const loadHistory = latest(async (counter) => {
  const run = S.live.run;
  const have = S.history[counter];
  // The last point grows: it is asked for again.
  const { corrected_hz, ...new_ } = await get(`history/${part(counter)}?from=${have?.last ?? 0}`);
  if (S.live?.run !== run) return;
  const lists = (view) => [view.start_s, view.length_s, view.flags, ...view.rate_hz, ...view.low_hz, ...view.high_hz, ...view.corrected_hz];
  const next = { ...new_, corrected_hz, at: performance.now() };
  if (have) {
    const [old, come] = [lists(have), lists(next)];
    old.forEach((list, i) => { list.pop(); for (const value of come[i]) list.push(value); });
    // As many as the program keeps.
    const over = have.start_s.length - 17280;
    if (over > 0) for (const list of old) list.splice(0, over);
    Object.assign(have, { last: next.last, at: next.at });
  } else S.history[counter] = next;
  redraw("counts");
});

// Counts of a running night from a time on: the small points, and before them the large ones.
function liveCounts(from) {
  const fine = S.counts[S.counter];
  if (!fine?.start_s.length || from >= fine.start_s[0] - 1) return fine;
  const old = S.history[S.counter];
  if (!(old && performance.now() - old.at < 5000)) loadHistory(S.counter);
  if (!old) return fine;
  const first = old.start_s.findIndex((t, i) => t + old.length_s[i] >= from);
  const after = old.start_s.findIndex((t) => t >= fine.start_s[0]);
  const cut = (list) => (first < 0 ? [] : list.slice(first, after < 0 ? undefined : after));
  const join = (a, b) => cut(a).concat(b);
  const all = (a, b) => b.map((list, k) => join(a[k], list));
  const coarse = cut(old.start_s).length;
  // The sky of so long ago is not known any more: no magnitudes.
  const none = fine.channels.map(() => new Array(old.start_s.length).fill(null));
  return {
    channels: fine.channels, bins: 1, coarse, start_s: join(old.start_s, fine.start_s), length_s: join(old.length_s, fine.length_s), flags: join(old.flags, fine.flags),
    rate_hz: all(old.rate_hz, fine.rate_hz), low_hz: all(old.low_hz, fine.rate_hz), high_hz: all(old.high_hz, fine.rate_hz), corrected_hz: all(old.corrected_hz, fine.corrected_hz),
    magnitudes: { magnitude: all(none, fine.magnitudes.magnitude), sigma_mag: all(none, fine.magnitudes.sigma_mag) },
  };
}

function ticks(low, high, most) {
  const raw = (high - low) / most;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((k) => k * power).find((s) => s >= raw);
  const out = [];
  for (let v = Math.ceil(low / step) * step; v <= high * (1 + 1e-9); v += step) out.push(v);
  return out;
}
// Writes the numbers of an axis with as many digits as tell two marks apart.
function numbersOf(marks) {
  const power = (v) => Math.floor(Math.log10(Math.abs(v) || 1));
  const most = Math.max(...marks.map(Math.abs), 0);
  const step = power((marks.length > 1 ? marks[1] - marks[0] : 1) * (1 + 1e-9));
  if (most < 1e5) return (v) => v.toFixed(clamp(-step, 0, 9));
  return (v) => (v === 0 ? "0" : v.toExponential(clamp(power(most) - step, 1, 9)));
}
function timeTicks(low, high, most) {
  const steps = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1200, 1800, 3600, 7200, 14400];
  const step = steps.find((s) => (high - low) / s <= most) ?? 28800;
  const phase = (((S.about.start_unix_ms / 1000) % 86400) + 86400) % 86400;
  const out = [];
  for (let v = Math.ceil((low + phase) / step) * step - phase; v <= high; v += step) out.push(v);
  return { at: out, digits: step < 1 ? 1 : 0, short: step >= 60 };
}

// Lines of a chart at round times, with the times below.
function timeAxis(c, [from, to], x, box, w, em) {
  c.fillStyle = css("--soft");
  c.strokeStyle = css("--line");
  c.lineWidth = 1;
  c.textBaseline = "top";
  const time = timeTicks(from, to, Math.max(2, (box.r - box.l) / (6 * em)));
  for (const t of time.at) {
    c.beginPath(); c.moveTo(x(t), box.t); c.lineTo(x(t), box.b); c.stroke();
    const text = time.short ? utc(t, 0).slice(0, 5) : utc(t, time.digits);
    const half = c.measureText(text).width / 2;
    if (x(t) - half > box.l - 2 * em && x(t) + half < w) c.fillText(text, x(t) - half, box.b + 0.35 * em);
  }
}

function drawCounts() {
  const { c, w, h, em } = fit($("counts"));
  const [from, to] = range();
  const data = S.live ? liveCounts(from) : S.shown;
  S.wideAt = data?.coarse ? performance.now() : 0;
  const box = { l: 4.2 * em, r: w - 0.6 * em, t: 0.8 * em, b: h - 1.7 * em };
  const x = (t) => box.l + ((t - from) / (to - from)) * (box.r - box.l);
  timeAxis(c, [from, to], x, box, w, em);
  // Visits as strips, with their names.
  for (const visit of S.about.visits) {
    if (visit.to_s <= from || visit.from_s >= to) continue;
    const [a, b] = [Math.max(box.l, x(visit.from_s)), Math.min(box.r, x(visit.to_s))];
    c.globalAlpha = visit.kind === "star" || visit.kind === "satellite" ? 0.12 : 0.05;
    c.fillStyle = css("--accent");
    c.fillRect(a, box.t, b - a, box.b - box.t);
    c.globalAlpha = 1;
    const name = visit.name;
    if (c.measureText(name).width < b - a - 0.4 * em) { c.fillStyle = css("--soft"); c.fillText(name, a + 0.2 * em, box.t + 0.7 * em); }
  }
  const canvas = $("counts");
  if (data && magnitudesOf(data)) { c.fillStyle = css("--soft"); c.fillText("mag", 0.2 * em, 0); }
  if (!data || !data.start_s.length) {
    c.fillStyle = css("--soft");
    c.fillText(S.about.devices.some((d) => d.kind === "counter") ? "no counts in this stretch" : "this session has no counter", box.l + em, (box.t + box.b) / 2);
    canvas.setAttribute("aria-label", "no counts in this stretch");
    return;
  }
  const inside = [];
  for (let i = 0; i < data.start_s.length; i++) if (data.start_s[i] + data.length_s[i] >= from && data.start_s[i] <= to) inside.push(i);
  const on = data.channels.map((_, k) => k).filter((k) => !S.off.has(data.channels[k]));
  const corrected = $("corrected").checked;
  const mags = magnitudesOf(data);
  const rates = mags ? mags.magnitude : corrected ? data.corrected_hz : data.rate_hz;
  // The lowest and the highest bin are counted rates.
  const banded = (data.bins > 1 || data.coarse > 0) && !corrected && !mags;
  const [highs, lows] = banded ? [data.high_hz, data.low_hz] : [rates, rates];
  let [least, most] = [Infinity, -Infinity];
  for (const k of on) for (const i of inside) { if (lows[k][i] !== null) least = Math.min(least, lows[k][i]); if (highs[k][i] !== null) most = Math.max(most, highs[k][i]); }
  const foreseen = mags ? null : predictedRange(data.channels, on, [from, to]);
  if (foreseen) [least, most] = [Math.min(least, foreseen[0]), Math.max(most, foreseen[1])];
  if (!(most > -Infinity)) [least, most] = [0, 1];
  const log = $("log").checked && !mags;
  let [bottom, top] = log ? [Math.log10(Math.max(least, 0.5)), Math.log10(Math.max(most, 1))] : [Math.min(0, least), most];
  // Magnitudes are brighter upwards.
  if (mags) [bottom, top] = [most + 0.02, least - 0.02];
  else if (!log && least > 0.7 * most) bottom = least - 0.2 * (most - least + 1e-9 * most);
  const room = 0.06 * (top - bottom) || 1;
  top += room;
  if (log) bottom -= room;
  const y = (rate) => box.b - ((log ? Math.log10(Math.max(rate, 1e-3)) : rate) - bottom) / (top - bottom) * (box.b - box.t);
  c.textBaseline = "middle";
  c.fillStyle = css("--soft");
  const marks = ticks(Math.min(bottom, top), Math.max(bottom, top), Math.max(2, (box.b - box.t) / (2.4 * em)));
  const written = numbersOf(marks);
  for (const v of marks) {
    const rate = log ? 10 ** v : v;
    if (y(rate) < box.t - 1 || y(rate) > box.b + 1) continue;
    c.beginPath(); c.moveTo(box.l, y(rate)); c.lineTo(box.r, y(rate)); c.stroke();
    const text = mags ? written(v) : hertz(rate);
    c.fillText(text, box.l - c.measureText(text).width - 0.4 * em, y(rate));
  }
  c.save();
  c.beginPath(); c.rect(box.l, box.t, box.r - box.l, box.b - box.t); c.clip();
  for (const k of on) {
    const colour = lineColour(k);
    if (banded) {
      c.globalAlpha = 0.3;
      c.fillStyle = colour;
      for (const i of inside) if (lows[k][i] !== null) c.fillRect(x(data.start_s[i]), y(highs[k][i]), Math.max(1, x(data.start_s[i] + data.length_s[i]) - x(data.start_s[i])), Math.max(1, y(lows[k][i]) - y(highs[k][i])));
      c.globalAlpha = 1;
    }
    c.strokeStyle = colour;
    if (mags && inside.length < 700) {
      // One σ up and down.
      c.globalAlpha = 0.4;
      c.lineWidth = 1;
      c.beginPath();
      for (const i of inside) {
        const [value, sigma] = [rates[k][i], mags.sigma_mag[k][i]];
        if (value === null) continue;
        const middle = x(data.start_s[i] + data.length_s[i] / 2);
        c.moveTo(middle, y(value - sigma)); c.lineTo(middle, y(value + sigma));
      }
      c.stroke();
      c.globalAlpha = 1;
    }
    // Red light has one colour: the channels differ by their strokes.
    c.setLineDash(theme() === "red" ? STROKES[k % 4] : []);
    c.lineWidth = 1.5;
    c.beginPath();
    let end = NaN;
    for (const i of inside) {
      const rate = rates[k][i];
      const middle = data.start_s[i] + data.length_s[i] / 2;
      // A gap stays a gap.
      if (rate === null) { end = NaN; continue; }
      if (Math.abs(data.start_s[i] - end) <= 0.5 * data.length_s[i]) c.lineTo(x(middle), y(rate));
      else c.moveTo(x(middle), y(rate));
      end = data.start_s[i] + data.length_s[i];
    }
    c.stroke();
    c.setLineDash([]);
  }
  if (!mags) drawPredicted(c, x, y, data.channels, on, [from, to]);
  // Bins with faults: a mark at the top, whatever the channel. A free clock is no fault.
  c.fillStyle = css("--bad");
  let faults = 0;
  const free = S.about.flag_names.find(([, name]) => name === "clock_free")?.[0] ?? 0;
  for (const i of inside) if (data.flags[i] & ~free) {
    faults++;
    const at = x(data.start_s[i] + data.length_s[i] / 2);
    c.beginPath(); c.moveTo(at - 0.25 * em, box.t); c.lineTo(at + 0.25 * em, box.t); c.lineTo(at, box.t + 0.5 * em); c.fill();
  }
  c.restore();
  const now = S.live ? null : S.t;
  if (now !== null && now >= from && now <= to) {
    c.strokeStyle = css("--ink");
    c.beginPath(); c.moveTo(x(now), box.t); c.lineTo(x(now), box.b); c.stroke();
  }
  if (S.hover !== null) {
    c.strokeStyle = css("--accent");
    c.setLineDash([3, 3]);
    c.beginPath(); c.moveTo(x(S.hover), box.t); c.lineTo(x(S.hover), box.b); c.stroke();
    c.setLineDash([]);
  }
  canvas.plot = { from, to, l: box.l, r: box.r };
  if (S.live) drawn("counts", data.start_s.at(-1) + data.length_s.at(-1));
  readCounts(data, inside, faults);
}

// Magnitudes of the points, where they are wanted and known.
function magnitudesOf(data) {
  return S.about.magnitudes && $("unit").value === "mag" ? data.magnitudes ?? null : null;
}
function unitShown() {
  const of = S.about.magnitudes;
  const wanted = of && $("unit").value === "mag";
  for (const id of ["log", "corrected", "predicted"]) $(id).disabled = Boolean(wanted);
  $("unit-label").hidden = !of;
  const each = of?.channels.map(([name, sigma]) => `${name} ${sigma.toFixed(3)}`).join(", ");
  $("counts-how").textContent = wanted ? [`${of.said}. σ is that of counting alone. κ may shift all of a channel alike, by (mag): ${each}. The sky beside the target is taken off; light that misses the fibre is not added.`, ...of.warnings].join(" · ") : "";
}

// What was predicted, as dashes in the channel's colour; its range in view.
function* predictedPoints(name, [from, to]) {
  if (!$("predicted").checked) return;
  for (const curve of S.predicted ?? []) {
    const k = curve.channels.indexOf(name);
    if (k < 0) continue;
    for (let i = 0; i < curve.at_s.length; i++) {
      const next = curve.at_s[i + 1] ?? curve.at_s[i];
      const last = curve.at_s[i - 1] ?? curve.at_s[i];
      if (next >= from && last <= to) yield [curve.at_s[i], curve.rate_hz[k][i], i === 0];
    }
  }
}
function predictedRange(channels, on, span) {
  let [least, most] = [Infinity, -Infinity];
  for (const k of on) for (const [at, rate] of predictedPoints(channels[k], span)) {
    if (rate === null || at < span[0] || at > span[1]) continue;
    least = Math.min(least, rate);
    most = Math.max(most, rate);
  }
  return most > -Infinity ? [least, most] : null;
}
function drawPredicted(c, x, y, channels, on, span) {
  c.setLineDash([5, 4]);
  c.lineWidth = 1.5;
  for (const k of on) {
    c.strokeStyle = lineColour(k);
    c.globalAlpha = 0.7;
    c.beginPath();
    let before = false;
    for (const [at, rate, first] of predictedPoints(channels[k], span)) {
      if (rate === null) { before = false; continue; }
      before && !first ? c.lineTo(x(at), y(rate)) : c.moveTo(x(at), y(rate));
      before = true;
    }
    c.stroke();
  }
  c.globalAlpha = 1;
  c.setLineDash([]);
}

function readCounts(data, inside, faults) {
  const want = S.hover ?? (S.live ? Infinity : S.t);
  let best = inside[inside.length - 1];
  for (const i of inside) if (data.start_s[i] <= want && want < data.start_s[i] + data.length_s[i]) best = i;
  if (best === undefined) return;
  const corrected = $("corrected").checked;
  const shown = (k) => (corrected ? data.corrected_hz : data.rate_hz)[k][best];
  const mags = magnitudesOf(data);
  const magnitude = (k) => (mags.magnitude[k][best] === null ? "no magnitude" : `${mags.magnitude[k][best].toFixed(2)} ± ${mags.sigma_mag[k][best].toFixed(mags.sigma_mag[k][best] < 0.01 ? 3 : 2)} mag`);
  const rate = (k) => (shown(k) === null ? "saturated or not known" : hertz(shown(k)));
  const rates = data.channels.map((name, k) => `${name} ${mags ? magnitude(k) : rate(k)}`).join(" · ");
  const flags = flagNames(data.flags[best]).filter((name) => name !== "clock free");
  const bins = data.bins > 1 ? ` · mean of ${data.bins} bins` : best < data.coarse ? ` · mean of ${data.length_s[best].toFixed(1)} s` : "";
  $("counts-text").textContent = `${utc(data.start_s[best], 1)} UTC · ${rates}${bins}${flags.length ? ` · ${flags.join(", ")}` : ""}`;
  $("counts").setAttribute("aria-label", `counts of ${S.counter}: ${rates}; ${faults} points with faults in view`);
}

// Background of a legend's line: in red light with the line's own stroke.
function swatchOf(k) {
  const colour = lineColour(k);
  const dash = theme() === "red" ? STROKES[k % 4] : [];
  let [at, stops] = [0, []];
  dash.forEach((length, i) => { stops.push(`${i % 2 ? "transparent" : colour} ${at}px ${at + length}px`); at += length; });
  return dash.length ? `repeating-linear-gradient(90deg, ${stops.join(", ")})` : colour;
}

function legend() {
  const box = $("legend");
  const data = countsNow();
  const channels = data?.channels ?? S.about?.devices.find((d) => d.name === S.counter)?.channels ?? [];
  box.replaceChildren(...channels.map((name, k) => {
    const label = document.createElement("label");
    const input = Object.assign(document.createElement("input"), { type: "checkbox", checked: !S.off.has(name) });
    input.addEventListener("change", () => { input.checked ? S.off.delete(name) : S.off.add(name); redraw("counts"); });
    const swatch = document.createElement("span");
    swatch.className = "swatch";
    swatch.style.background = swatchOf(k);
    label.append(input, swatch, name);
    return label;
  }));
}

// --- sky ----------------------------------------------------------------------------------------------------------------

function drawSky() {
  const { c, w, h, em } = fit($("sky"));
  const radius = Math.min(w, h) / 2 - 1.4 * em;
  const [cx, cy] = [w / 2, h / 2];
  // As one looks up: north above, east on the left.
  const place = ([azimuth, altitude]) => {
    const r = (radius * (90 - altitude)) / 90;
    const a = (azimuth * Math.PI) / 180;
    return [cx - r * Math.sin(a), cy - r * Math.cos(a)];
  };
  // A page that is not laid out yet, or not any more, has no room for a sky.
  if (radius <= 0) return;
  S.place = place;
  c.fillStyle = css("--sky");
  c.beginPath(); c.arc(cx, cy, radius, 0, 7); c.fill();
  c.strokeStyle = css("--line");
  for (const altitude of [0, 30, 60]) { c.beginPath(); c.arc(cx, cy, (radius * (90 - altitude)) / 90, 0, 7); c.stroke(); }
  c.beginPath(); c.moveTo(cx - radius, cy); c.lineTo(cx + radius, cy); c.stroke();
  // The meridian, at which mounts turn over.
  c.strokeStyle = css("--soft");
  c.setLineDash([9, 3, 2, 3]);
  c.beginPath(); c.moveTo(cx, cy - radius); c.lineTo(cx, cy + radius); c.stroke();
  c.setLineDash([]);
  if (S.about.flip) drawFlip(c, place);
  c.fillStyle = css("--soft");
  c.textAlign = "center"; c.textBaseline = "middle";
  for (const [name, azimuth] of [["N", 0], ["E", 90], ["S", 180], ["W", 270]]) c.fillText(name, ...place([azimuth, -90 * (0.75 * em) / radius]));
  c.textAlign = "left";
  const sky = S.sky;
  // Names lie beside their bodies, where there is room; one that would lie over another is left out.
  const taken = [];
  const free = (box) => box[0] >= 0 && box[2] <= w && taken.every((other) => box[2] < other[0] || other[2] < box[0] || box[3] < other[1] || other[3] < box[1]);
  const label = (name, x, y, gap) => {
    const wide = c.measureText(name).width;
    const room = [[x + gap, y], [x - gap - wide, y], [x - wide / 2, y - gap - 0.5 * em], [x - wide / 2, y + gap + 0.5 * em]];
    const at = room.find(([left, middle]) => free([left, middle - 0.45 * em, left + wide, middle + 0.45 * em]));
    if (!at) return;
    taken.push([at[0], at[1] - 0.45 * em, at[0] + wide, at[1] + 0.45 * em]);
    c.fillText(name, ...at);
  };
  const lies = (x, y, r) => taken.push([x - r, y - r, x + r, y + r]);
  const named = sky?.target && sky.target[1][1] > 0 ? place(sky.target[1]) : null;
  const nameAt = named && [clamp(named[0] + 1.1 * em, 0, Math.max(0, w - c.measureText(sky.target[0]).width)), clamp(named[1] - 0.9 * em, em, h - em)];
  if (named) {
    lies(...named, 0.6 * em);
    taken.push([nameAt[0], nameAt[1] - 0.45 * em, nameAt[0] + c.measureText(sky.target[0]).width, nameAt[1] + 0.45 * em]);
  }
  if (sky) {
    c.strokeStyle = css("--soft");
    c.beginPath();
    sky.horizon_deg.concat(sky.horizon_deg[0]).forEach((altitude, i) => c.lineTo(...place([10 * i, altitude])));
    c.stroke();
    c.fillStyle = css("--star");
    for (const star of sky.stars) {
      const [x, y] = place(star.at_deg);
      c.beginPath(); c.arc(x, y, Math.max(0.6, (4.5 - star.v_mag) * 0.055 * em), 0, 7); c.fill();
    }
    c.fillStyle = c.strokeStyle = css("--warn");
    const bodies = [["Sun", sky.sun_deg, 0.6 * em], [`Moon ${Math.round(100 * sky.moon_lit)} %`, sky.moon_deg, 0.5 * em], ...sky.planets.map((p) => [p.name, p.at_deg, Math.max(1.5, (4.5 - (p.v_mag ?? 2)) * 0.055 * em)])].filter(([, at]) => at[1] > 0);
    bodies.forEach(([, at, r], i) => {
      const [x, y] = place(at);
      lies(x, y, r);
      c.lineWidth = 2;
      c.beginPath(); c.arc(x, y, r, 0, 7);
      // Planets are discs, the Sun and the Moon circles.
      /^(Sun|Moon)/.test(bodies[i][0]) ? c.stroke() : c.fill();
    });
    c.lineWidth = 1;
    // About the Moon no star is taken.
    if (sky.moon_deg[1] > 0) around(c, place, sky.moon_deg, sky.moon_limit_deg);
    for (const [name, at, r] of bodies) label(name, ...place(at), r + 0.2 * em);
    c.fillStyle = css("--star");
    for (const star of sky.stars) if (star.name && star.v_mag < 1.3) label(star.name, ...place(star.at_deg), 0.4 * em);
  }
  const now = skyTime();
  for (const track of S.tracks) {
    const last = track.at_s[track.at_s.length - 1];
    const present = track.at_s[0] <= now && now <= last;
    c.strokeStyle = present ? css("--accent") : css("--soft");
    // A satellite in the Earth's shadow is dotted; a ring stands where the shadow begins or ends.
    for (let i = 1; i < track.at_deg.length; i++) {
      const [a, b] = [track.at_deg[i - 1], track.at_deg[i]];
      if (a[1] <= 0 || b[1] <= 0) continue;
      const dark = track.lit.length > 0 && !(track.lit[i] && track.lit[i - 1]);
      // As bright as it is expected to be there, where the plan says it.
      const v = track.v_mag[i] ?? null;
      if (track.v_mag.length) c.strokeStyle = lightColour(v ?? 99);
      c.lineWidth = dark ? 1 : v !== null ? thickness(v) * (present ? 1.5 : 1) : present ? 2.5 : 1;
      c.setLineDash(dark ? [2, 4] : []);
      c.beginPath(); c.moveTo(...place(a)); c.lineTo(...place(b)); c.stroke();
      c.setLineDash([]);
      if (dark && track.lit[i] !== track.lit[i - 1]) { c.lineWidth = 1.5; c.beginPath(); c.arc(...place(b), 0.3 * em, 0, 7); c.stroke(); }
    }
    if (track.lit.length) minuteTicks(c, place, em, track, present || now < last);
  }
  c.lineWidth = 1;
  S.overlay?.({ c, place, em });
  if (S.live) drawMount({ c, place, em });
  if (named) {
    const [x, y] = named;
    c.strokeStyle = css("--bad");
    c.lineWidth = 2;
    c.beginPath(); c.arc(x, y, 0.55 * em, 0, 7); c.moveTo(x - em, y); c.lineTo(x + em, y); c.moveTo(x, y - em); c.lineTo(x, y + em); c.stroke();
    c.lineWidth = 1;
    c.fillStyle = css("--ink");
    c.fillText(sky.target[0], ...nameAt);
  }
}

// Azimuth and altitude of an hour angle and a declination, deg.
export function horizontal(latitude, hour, declination) {
  const rad = Math.PI / 180;
  const [l, H, d] = [latitude * rad, hour * rad, declination * rad];
  const up = Math.sin(l) * Math.sin(d) + Math.cos(l) * Math.cos(d) * Math.cos(H);
  const north = Math.cos(l) * Math.sin(d) - Math.sin(l) * Math.cos(d) * Math.cos(H);
  const east = -Math.cos(d) * Math.sin(H);
  return [(Math.atan2(east, north) / rad + 360) % 360, Math.asin(clamp(up, -1, 1)) / rad];
}

// Where a German mount is turned over: the meridian above the pole, and the stretch behind it into which it still follows.
function drawFlip(c, place) {
  const { latitude_deg, past_deg } = S.about.flip;
  const line = (hour) => Array.from({ length: 91 }, (_, i) => horizontal(latitude_deg, hour, 2 * i - 90)).filter((at) => at[1] > 0);
  const [first, last] = [line(0), line(past_deg)];
  c.fillStyle = css("--warn");
  c.globalAlpha = 0.15;
  c.beginPath();
  [...first, ...last.reverse()].forEach((at, i) => (i ? c.lineTo(...place(at)) : c.moveTo(...place(at))));
  c.fill();
  c.globalAlpha = 1;
  c.strokeStyle = css("--warn");
  c.beginPath();
  last.forEach((at, i) => (i ? c.lineTo(...place(at)) : c.moveTo(...place(at))));
  c.stroke();
}

// The time that the sky shows: the present one, or a later one that somebody looks at.
const ahead = () => (S.live ? Number($("ahead").value) : 0);
const skyTime = () => (S.live ? S.live.now_s + ahead() : S.t);

// What lies under the pointer on the sky, in words; null where nothing does.
function skyUnder(event) {
  if (!S.place || !S.sky) return null;
  const box = $("sky").getBoundingClientRect();
  const [x, y] = [event.clientX - box.left, event.clientY - box.top];
  let best = null;
  const offer = (at, say) => {
    if (at[1] <= 0) return;
    const [px, py] = S.place(at);
    const distance = Math.hypot(px - x, py - y);
    if (distance < 12 && (!best || distance < best.distance)) best = { distance, say };
  };
  const at = ([azimuth, altitude]) => `azimuth ${azimuth.toFixed(1)}°, altitude ${altitude.toFixed(1)}°`;
  for (const star of S.sky.stars) offer(star.at_deg, () => `${star.name || star.plan_name}, V ${star.v_mag.toFixed(1)}, ${at(star.at_deg)}`);
  for (const planet of S.sky.planets) offer(planet.at_deg, () => `${planet.name}${planet.v_mag === null ? "" : `, V ${planet.v_mag.toFixed(1)}`}, ${at(planet.at_deg)}`);
  for (const track of S.tracks) {
    const from = track.at_s[0];
    const to = track.at_s.at(-1);
    const highest = Math.max(...track.at_deg.map((place) => place[1]));
    const dark = track.lit.length && !track.lit.every(Boolean) ? ", part of it in the Earth's shadow" : "";
    const light = track.v_mag.filter((v) => v !== null);
    const best = light.length ? `, V ${Math.min(...light).toFixed(1)} at best` : "";
    track.at_deg.forEach((place, i) => offer(place, () => `${track.name}, ${utc(from, 0)} to ${utc(to, 0)}, up to ${highest.toFixed(0)}°${best}${(track.v_mag[i] ?? null) === null ? "" : `, here V ${track.v_mag[i].toFixed(1)}`}${dark}`));
  }
  return best?.say() ?? null;
}

// Dots of a track at each minute, further apart where they would touch; with their times where there is room.
function minuteTicks(c, place, em, track, told) {
  const first = track.at_s[0];
  const last = track.at_s[track.at_s.length - 1];
  const where = (t) => {
    const i = track.at_s.findIndex((s) => s >= t);
    if (i <= 0) return null;
    const part = (t - track.at_s[i - 1]) / (track.at_s[i] - track.at_s[i - 1]);
    const [a, b] = [track.at_deg[i - 1], track.at_deg[i]];
    const turn = ((b[0] - a[0] + 540) % 360) - 180;
    return [a[0] + part * turn, a[1] + part * (b[1] - a[1])];
  };
  const way = track.at_deg.reduce((sum, at, i) => { if (!i) return 0; const [a, b] = [place(track.at_deg[i - 1]), place(at)]; return sum + Math.hypot(a[0] - b[0], a[1] - b[1]); }, 0);
  const each = [60, 300, 600, 1800, 3600].find((s) => (way * s) / (last - first) > 6) ?? 7200;
  const phase = S.about.start_unix_ms / 1000;
  c.fillStyle = css("--ink");
  let before = null;
  for (let t = Math.ceil((first + phase) / each) * each - phase; t < last; t += each) {
    const at = where(t);
    if (!at || at[1] <= 0) continue;
    const [x, y] = place(at);
    c.beginPath(); c.arc(x, y, 1.8, 0, 7); c.fill();
    if (!told || (before && Math.abs(before[0] - x) < 3 * em && Math.abs(before[1] - y) < em)) continue;
    before = [x, y];
    c.fillText(utc(t, 0).slice(0, 5), x + 0.4 * em, y - 0.5 * em);
  }
}

// A dashed circle on the sky about a place, as far as it is above the horizon.
function around(c, place, [azimuth, altitude], radius) {
  const rad = Math.PI / 180;
  const vector = ([a, h]) => [Math.cos(h * rad) * Math.sin(a * rad), Math.cos(h * rad) * Math.cos(a * rad), Math.sin(h * rad)];
  const s = vector([azimuth, altitude]);
  const e = vector([azimuth + 90, 0]);
  const n = [s[1] * e[2] - s[2] * e[1], s[2] * e[0] - s[0] * e[2], s[0] * e[1] - s[1] * e[0]];
  c.setLineDash([6, 4]);
  c.beginPath();
  let up = false;
  for (let i = 0; i <= 180; i++) {
    const [cos, sin] = [Math.cos(i * 2 * rad), Math.sin(i * 2 * rad)];
    const v = [0, 1, 2].map((k) => Math.cos(radius * rad) * s[k] + Math.sin(radius * rad) * (cos * e[k] + sin * n[k]));
    const h = Math.asin(clamp(v[2], -1, 1)) / rad;
    if (h < 0) { up = false; continue; }
    const p = place([Math.atan2(v[0], v[1]) / rad, h]);
    up ? c.lineTo(...p) : c.moveTo(...p);
    up = true;
  }
  c.stroke();
  c.setLineDash([]);
}

const loadSky = latest(async (at) => {
  if (S.sky && Math.abs(S.sky.at_s - at) < 1) return;
  try {
    S.sky = await get(`sky?at_s=${at}`);
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    $("sky-text").textContent = error.message;
    return;
  }
  S.onSky?.();
  if (S.overlay) { redraw("sky"); await new Promise((done) => setTimeout(done, 50)); return; }
  const target = S.sky.target;
  const later = ahead() ? `${utc(at, 0)} UTC, in ${span(ahead())}: ` : "";
  const text = later + (target ? `${target[0]} at azimuth ${target[1][0].toFixed(1)}°, altitude ${target[1][1].toFixed(1)}°` : "no target with a place");
  const planets = S.sky.planets.map((p) => (p.v_mag === null ? p.name : `${p.name} ${p.v_mag.toFixed(1)}`)).join(", ");
  S.skyText = `${text}; ${planets ? `planets (V): ${planets}; ` : ""}Sun at ${S.sky.sun_deg[1].toFixed(1)}°. North is up, east is left.`;
  if (!S.pointed) $("sky-text").textContent = S.skyText;
  $("sky").setAttribute("aria-label", `sky over ${S.about.station}: ${text}`);
  redraw("sky");
  await new Promise((done) => setTimeout(done, 200));
});

// --- state --------------------------------------------------------------------------------------------------------------

function row(...cells) {
  const tr = document.createElement("tr");
  for (const cell of cells) {
    const td = document.createElement("td");
    cell instanceof Node ? td.append(cell) : (td.textContent = cell);
    tr.append(td);
  }
  return tr;
}

function stateAt(device, t) {
  const at = (name) => S.states[name]?.findLast(([at_s]) => at_s <= t) ?? [-Infinity, "not opened"];
  const [own, end] = [at(device), at("")];
  return end[0] >= own[0] && own[0] > -Infinity ? end[1] : own[1];
}
const STATES = { device: "running", device_back: "running", device_lost: "lost", device_failed: "given up" };
// Changes of each device's state; those of the whole session have no name.
function noteStates(events) {
  for (const { kind, device, at_s } of events) {
    const [name, state] = kind === "end" ? ["", "ended"] : [device, STATES[kind]];
    if (state) (S.states[name] ??= []).push([at_s, state]);
  }
}

function devices() {
  const rows = S.about.devices.map((device) => {
    const live = S.live?.devices[device.name];
    let [state, taken, now] = ["–", device.taken, ""];
    if (live) {
      state = live.state; // its error is the alarm at the top
      taken = live.taken;
      now = live.frame ? `${live.frame.mean_adu.toFixed(0)} … ${live.frame.most_adu} ADU` : live.rates_hz.map(([name, rate]) => `${name} ${hertz(rate)}`).join(" ");
      if (live.refused) now += `, ${live.refused} refused`;
      if (live.losses) now += `, lost ${live.losses === 1 ? "once" : `${live.losses} times`}`;
    } else if (!S.live) {
      state = stateAt(device.name, S.t);
      if (device.kind === "camera") now = S.film && S.camera === device.name && S.frame ? `frame ${S.frame.header.number}` : "";
      else now = `${device.channels.length} channels`;
    }
    return row(device.name, state, String(taken), now);
  });
  const mount = mountOf(S.live);
  if (mount) rows.push(row(mount[0], mount[1].state, "", mount[1].mount.state));
  const text = rows.map((r) => r.textContent).join("\n");
  if (devices.text === text) return;
  devices.text = text;
  $("devices").tBodies[0].replaceChildren(...rows);
}

function visits() {
  const body = $("visits").tBodies[0];
  body.replaceChildren(...S.about.visits.map((visit) => {
    let name = visit.number > 1 ? `${visit.name} (${visit.number})` : visit.name;
    if (!S.live) {
      const button = Object.assign(document.createElement("button"), { type: "button", textContent: name });
      button.addEventListener("click", () => seek(visit.from_s));
      name = button;
    }
    const tr = row(name, visit.kind, utc(visit.from_s, 0), visit.to_s - visit.from_s > 80000 ? "end" : utc(visit.to_s, 0));
    for (const cell of [...tr.cells].slice(2)) cell.className = "number";
    return tr;
  }));
}
function markVisits(t) {
  const body = $("visits").tBodies[0];
  S.about.visits.forEach((visit, i) => body.rows[i]?.classList.toggle("now", visit.from_s <= t && t < visit.to_s));
}

const SHOWN = 600;
function eventItem(event) {
  const li = document.createElement("li");
  li.classList.toggle("alarming", event.alarm);
  let time = document.createElement(S.live ? "span" : "button");
  time.className = "number";
  time.textContent = event.utc.slice(11, 19);
  if (!S.live) {
    time.type = "button";
    time.addEventListener("click", () => seek(event.at_s));
  }
  const text = document.createElement("span");
  text.textContent = `${event.kind.replaceAll("_", " ")}${event.text ? `: ${event.text}` : ""}`;
  li.append(time, text);
  return li;
}
// Events of a running night, the last one first.
function addEvents(events) {
  if (!events.length) return;
  S.events.push(...events);
  if (S.events.length > SHOWN) S.events.splice(0, S.events.length - SHOWN);
  const list = $("events");
  list.prepend(...events.map(eventItem).reverse());
  while (list.children.length > SHOWN) list.lastChild.remove();
  const first = S.events[0].number;
  $("events-more").textContent = first > 1 ? `the ${first - 1} events before these are in the session's log` : "";
}
// Events of a recorded session about a time: of a long log as many as can be scrolled.
function listEvents(from) {
  S.listed = from;
  const more = (text, to) => {
    const li = document.createElement("li");
    li.className = "more";
    const button = Object.assign(document.createElement("button"), { type: "button", textContent: text });
    button.addEventListener("click", () => { listEvents(to); markEvents(S.t); });
    li.append(button);
    return li;
  };
  const items = S.events.slice(from, from + SHOWN).map(eventItem);
  const after = S.events.length - from - items.length;
  if (from) items.unshift(more(`show earlier ones: ${from}`, Math.max(0, from - SHOWN / 2)));
  if (after) items.push(more(`show later ones: ${after}`, Math.min(S.events.length - SHOWN, from + SHOWN / 2)));
  $("events").replaceChildren(...items);
}
function markEvents(t) {
  let [low, high] = [0, S.events.length];
  while (low < high) { const middle = (low + high) >> 1; S.events[middle].at_s <= t ? (low = middle + 1) : (high = middle); }
  // The list follows the time, unless a person looks elsewhere in it.
  if (low !== S.reached && (low <= S.listed || low > S.listed + SHOWN)) listEvents(clamp(low - SHOWN / 2, 0, Math.max(0, S.events.length - SHOWN)));
  S.reached = low;
  [...$("events").querySelectorAll("li:not(.more)")].forEach((li, i) => li.classList.toggle("later", S.events[S.listed + i].at_s > t));
}

function present(t) {
  const now = S.live ? S.live.target : visitAt(t);
  $("clock").textContent = `${S.live ? S.live.utc.slice(0, 10) : new Date(S.about.start_unix_ms + t * 1000).toISOString().slice(0, 10)} ${utc(t, 1)} UTC`;
  const paused = S.live?.paused ? "paused: what is recorded belongs to no visit" : null;
  const named = now && now.kind !== "none";
  const left = named && now.to_s !== null ? `, ${span(now.to_s - t)} left` : "";
  $("target").textContent = paused ?? (named ? `${now.name}${left}` : "no target");
  const next = S.live ? S.live.next : S.about.visits.find((visit) => visit.from_s > t);
  $("next").textContent = next ? `next ${next.name} in ${span(next.from_s - t)}` : "";
}

// --- recorded -----------------------------------------------------------------------------------------------------------

function frameAt(t) {
  const starts = S.film?.start_s ?? [];
  let [low, high] = [0, starts.length];
  while (low < high) { const middle = (low + high) >> 1; starts[middle] <= t ? (low = middle + 1) : (high = middle); }
  return low - 1;
}

function seek(t) {
  S.t = clamp(t, 0, S.about.length_s);
  $("slider").value = String(S.t);
  $("slider").setAttribute("aria-valuetext", `${utc(S.t, 0)} UTC`);
  $("at").textContent = `${utc(S.t, 1)} · ${span(S.t)} of ${span(S.about.length_s)}`;
  const index = frameAt(S.t);
  if (S.camera && index >= 0) loadFrame({ camera: S.camera, of: index });
  present(S.t);
  markVisits(S.t);
  needCounts();
  redraw("counts");
  redraw("sky");
  if (R.on) redraw("curve");
  later();
}
// What need not follow each picture of the film.
let laterAt = 0;
function later() {
  if (laterAt) return;
  laterAt = setTimeout(() => { laterAt = 0; loadSky(S.t); devices(); markEvents(S.t); if (R.on) byHandText(); }, 120);
}

function play(on) {
  S.playing = on;
  $("play").textContent = on ? "Hold" : "Play";
  $("play").setAttribute("aria-pressed", String(on));
  if (!on) return;
  if (S.t >= S.about.length_s) seek(0);
  let before = performance.now();
  const step = (now) => {
    if (!S.playing) return;
    seek(S.t + ((now - before) / 1000) * Number($("speed").value));
    before = now;
    if (S.t >= S.about.length_s) play(false);
    else requestAnimationFrame(step);
  };
  requestAnimationFrame(step);
}

function stepFrame(by) {
  const next = clamp(frameAt(S.t) + by, 0, (S.film?.start_s.length ?? 1) - 1);
  const start = S.film?.start_s[next];
  if (start !== undefined) seek(start + 1e-6);
  else seek(S.t + by);
}

function drawStrip() {
  if (S.live || !S.about) return;
  const { c, w, h } = fit($("strip"));
  const x = (t) => (t / S.about.length_s) * w;
  c.fillStyle = css("--line");
  c.fillRect(0, h / 3, w, h / 3);
  for (const visit of S.about.visits) {
    c.fillStyle = visit.kind === "star" || visit.kind === "satellite" ? css("--accent") : css("--soft");
    c.fillRect(x(visit.from_s), h / 4, Math.max(1, x(visit.to_s) - x(visit.from_s) - 1), h / 2);
  }
  c.fillStyle = css("--bad");
  for (const event of S.events) if (event.alarm) c.fillRect(x(event.at_s), 0, 2, h);
}

async function chooseCamera(name) {
  S.camera = name;
  S.frame = S.marks = S.film = S.cross = null;
  redraw("image");
  if (!name) return;
  if (!S.live) {
    const film = await get(`frames/${part(name)}`);
    // Another one may have been chosen meanwhile.
    if (S.camera !== name) return;
    S.film = film;
    // Before the first frame there is none: show the first.
    const index = Math.max(0, frameAt(S.t));
    if (S.film.start_s.length) loadFrame({ camera: name, of: index });
  }
}
function chooseCounter(name) {
  S.counter = name;
  S.shown = null;
  legend();
  needCounts();
  redraw("counts");
}

function options(select, names) {
  select.replaceChildren(...names.map((name) => Object.assign(document.createElement("option"), { value: name, textContent: name })));
  select.closest("label").hidden = names.length < 2;
}

async function loadPredicted() {
  S.predicted = await get("predicted");
  $("predicted-label").hidden = !S.predicted.length;
  redraw("counts");
}

async function about() {
  S.about = await get("about");
  document.title = `${S.about.name} – sunglint`;
  $("name").textContent = S.about.name;
  const names = (kind) => S.about.devices.filter((d) => d.kind === kind).map((d) => d.name);
  options($("camera"), names("camera"));
  options($("counter"), names("counter"));
  visits();
  warnings(S.about.warnings);
  unitShown();
  get("tracks").then((tracks) => { S.tracks = tracks; redraw("sky"); }, () => {});
  if (S.about.mode === "recorded" || S.about.mode === "live") loadPredicted().catch(() => {});
  clockText(S.about.clock);
  return { camera: names("camera")[0], counter: names("counter")[0] };
}

async function recorded({ camera, counter }) {
  $("mode").textContent = S.about.ended ? "recorded" : "recorded, no good end";
  $("film").hidden = false;
  $("span").value = "visit";
  $("slider").max = String(S.about.length_s);
  for (let more = true; more;) {
    const answer = await get(`events?after=${S.events.at(-1)?.number ?? 0}`);
    S.events.push(...answer.events);
    noteStates(answer.events);
    more = answer.more;
  }
  // In the order of time, also where a clock stepped back.
  S.events.sort((a, b) => a.at_s - b.at_s);
  listEvents(0);
  await chooseCamera(camera);
  chooseCounter(counter);
  onToken(() => {
    $("clip").hidden = !token() || !camera;
    showRework();
  });
  const first = S.about.visits.find((v) => v.kind === "star" || v.kind === "satellite");
  seek(first ? Math.min(first.from_s + 1, first.to_s) : 0);
  devices();
  drawAll();
  root.dataset.ready = "yes";
}

// --- reduction by hand --------------------------------------------------------------------------------------------------

const R = { on: false, visit: null, places: [], refused: new Map(), old: null, now: null, range: null, pointing: false, drag: null, mark: null };
window.sunglint.rework = R;

const choices = () => [...document.querySelectorAll(".choices [data-key]")];

// The recipe, as the program reads it; null where a field is no number.
function recipe() {
  const out = { target: R.visit.name, visit: R.visit.number };
  let good = true;
  for (const input of choices()) {
    const [key, part] = input.dataset.key.split(".");
    if (input.type === "checkbox") { if (input.checked) out[key] = true; continue; }
    const text = input.value.trim();
    const number = Number(text);
    const wrong = text !== "" && !Number.isFinite(number);
    input.classList.toggle("wrong", wrong);
    good &&= !wrong;
    if (text === "" || wrong) continue;
    if (part === undefined) out[key] = number;
    else (out[key] ??= [null, null])[Number(part)] = number;
  }
  // One of two: the other is as usual.
  if (out.annulus_px?.includes(null)) {
    const usual = R.old.aperture_px ?? [8, 12, 20];
    const radius = out.aperture_px ?? usual[0];
    out.annulus_px = out.annulus_px.map((v, i) => v ?? [1.5, 2.5][i] * radius);
  }
  if (out.area_px) out.area_px = out.area_px.map((v, i) => v ?? [4, 2000][i]);
  if (R.places.length) out.place = R.places;
  const refused = [...R.refused].filter(([, frames]) => frames.size).map(([camera, frames]) => ({ camera, frames: [...frames].sort((a, b) => a - b) }));
  if (refused.length) out.refused = refused;
  return good ? out : null;
}

// A reduction may take minutes: it can be ended.
async function reduction(wanted, path = "reduction", as = "json") {
  const shown = setTimeout(() => { $("rework-cancel").hidden = false; }, 500);
  try {
    return await ask(path, wanted, { patience_ms: 3600000, as });
  } finally {
    clearTimeout(shown);
    $("rework-cancel").hidden = true;
  }
}

const loadCurve = latest(async (wanted) => {
  try {
    const curve = await reduction(wanted);
    if (wanted.target !== R.visit.name || wanted.visit !== R.visit.number) return;
    R.now = curve;
    $("curve-why").textContent = curve.warnings.join(" · ");
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    // The curve that is there stays.
    $("curve-why").textContent = error.message;
  }
  curveShown();
});

let reducing = 0;
function reduceSoon() {
  clearTimeout(reducing);
  byHandText();
  reducing = setTimeout(() => { const wanted = recipe(); if (wanted) loadCurve(wanted); }, 60);
}

function curveShown() {
  const curve = R.now;
  if (!curve) return;
  const select = $("rework-channel");
  const names = curve.channels.map((c) => c.name);
  if (names.join() !== [...select.options].map((o) => o.value).join()) {
    const before = select.value;
    select.replaceChildren(...names.map((name) => Object.assign(document.createElement("option"), { value: name, textContent: name })));
    const camera = curve.channels.find((c) => c.unit === "ADU/s");
    select.value = names.includes(before) ? before : (camera ?? curve.channels[0])?.name ?? "";
  }
  curveText();
  redraw("curve");
  redraw("image");
}

function inMagnitudes(channel) {
  return Boolean(channel?.magnitude.length) && $("rework-unit").value === "mag";
}

function curveText() {
  const curve = R.now;
  const channel = curve.channels.find((c) => c.name === $("rework-channel").value);
  $("rework-unit-label").hidden = !channel?.magnitude.length;
  const mags = inMagnitudes(channel);
  const rates = ((mags ? channel.magnitude : channel?.rate) ?? []).filter((rate) => rate !== null).sort((a, b) => a - b);
  const median = rates[rates.length >> 1];
  const [frames, lost] = curve.frames;
  const removed = curve.removed.filter(([, n]) => n).map(([why, n]) => `${n} by ${why}`).join(", ");
  const [aperture, inner, outer] = curve.aperture_px ?? [];
  const least = curve.smallest_aperture_px ?? aperture;
  // Nights of counters alone have none.
  const apertures = aperture === undefined ? "" : aperture - least < 0.05
    ? `aperture ${aperture.toFixed(1)} px, annulus ${inner.toFixed(1)} to ${outer.toFixed(1)} px`
    : `apertures of ${least.toFixed(1)} to ${aperture.toFixed(1)} px, annulus ${(inner / aperture).toFixed(1)} to ${(outer / aperture).toFixed(1)} times as large`;
  $("curve-text").textContent = [
    channel && `${channel.name}: ${rates.length} of ${channel.time_s.length} samples have a value, the median is ${median === undefined ? "–" : median.toPrecision(5)} ${mags ? `mag, ${S.about.magnitudes.said}` : channel.unit}`,
    `${frames} frames, ${lost} without a target`,
    aperture && `${apertures}, points ${curve.fwhm_px?.toFixed(1) ?? "–"} px wide`,
    removed && `sources left out: ${removed}`,
    `${curve.took_s.toFixed(2)} s`,
  ].filter(Boolean).join(" · ");
  $("curve-how").textContent = curve.notes.join(" · ");
  $("curve").setAttribute("aria-label", `light curve of ${R.visit.name}: ${$("curve-text").textContent}`);
}

function byHandText() {
  const frames = [...R.refused.values()].reduce((sum, set) => sum + set.size, 0);
  const parts = [];
  if (R.places.length) parts.push(`followed from frame ${R.places.map((p) => p.frame).join(", ")}`);
  if (frames) parts.push(`${frames} ${frames > 1 ? "frames" : "frame"} refused`);
  $("by-hand").textContent = parts.join(" · ");
  const [from, to] = R.range ?? [];
  const chosen = framesIn(R.range);
  const here = presentFrame();
  const all = R.range ? chosen : here === null ? [] : [here];
  const set = R.refused.get(S.camera);
  const taken = all.length > 0 && all.every((n) => set?.has(n));
  $("refuse").textContent = `${taken ? "Take" : "Refuse"} ${R.range ? `${chosen.length} ${chosen.length === 1 ? "frame" : "frames"} from ${utc(from, 0)} to ${utc(to, 0)}` : "this frame"}${taken ? " again" : ""}`;
  $("refuse").disabled = !all.length;
}

// Numbers of the visit's frames whose middle lies in a stretch.
function framesIn(range) {
  if (!range || !S.film || !R.visit) return [];
  const half = (S.about.devices.find((d) => d.name === S.camera)?.exposure_s ?? 0) / 2;
  const [from, to] = range;
  return S.film.number.filter((_, i) => { const t = S.film.start_s[i]; return t + half >= from && t + half <= to && t >= R.visit.from_s && t < R.visit.to_s; });
}
function presentFrame() {
  const f = S.frame;
  return f && R.visit && f.header.start_s >= R.visit.from_s && f.header.start_s < R.visit.to_s ? f.header.number : null;
}

function refuse() {
  if (!R.on) return;
  const here = presentFrame();
  const frames = R.range ? framesIn(R.range) : here === null ? [] : [here];
  if (!frames.length) return;
  const set = R.refused.get(S.camera) ?? new Set();
  R.refused.set(S.camera, set);
  const all = frames.every((n) => set.has(n));
  for (const n of frames) all ? set.delete(n) : set.add(n);
  R.range = null;
  reduceSoon();
  redraw("curve");
}

// A stretch of the curve by a key: it begins at the frame that is shown, and ends at the one that is shown at the second press.
function markStretch() {
  if (presentFrame() === null) { notice("this frame is not of the visit that is reduced"); return; }
  const { start_s, exposure_s } = S.frame.header;
  if (R.mark) {
    R.range = [Math.min(R.mark[0], start_s), Math.max(R.mark[1], start_s + exposure_s)];
    R.mark = null;
    notice("");
  } else {
    [R.mark, R.range] = [[start_s, start_s + exposure_s], null];
    notice("a stretch begins at this frame: go to its last frame, then press m again");
  }
  byHandText();
  redraw("curve");
}

function pointAt(at) {
  const frame = presentFrame();
  if (frame === null) { notice("this frame is not of the visit that is reduced"); return; }
  const place = at.map((v) => Math.round((v - 0.5) * 100) / 100);
  R.places = R.places.filter((p) => p.frame !== frame || p.camera !== S.camera);
  R.places.push({ camera: S.camera, frame, place_px: place });
  R.places.sort((a, b) => a.frame - b.frame);
  pointing(false);
  reduceSoon();
}
function pointing(on) {
  if (on === R.pointing) return;
  R.pointing = on;
  $("point").setAttribute("aria-pressed", String(on));
  const text = "click on the target in the image";
  if (on) askPlace(text);
  else if ($("notice").textContent.startsWith(text)) notice("");
  redraw("image");
}

async function beginRework() {
  const visit = S.about.visits[Number($("rework-visit").value)];
  if (!visit) return;
  clearTimeout(reducing);
  $("rework-body").hidden = true;
  Object.assign(R, { on: true, visit, places: [], refused: new Map(), old: null, now: null, range: null, mark: null });
  for (const input of choices()) input.type === "checkbox" ? (input.checked = false) : (input.value = "");
  pointing(false);
  if (S.t < visit.from_s || S.t >= visit.to_s) seek(Math.min(visit.from_s + 1, visit.to_s));
  $("rework-begin").disabled = true;
  try {
    const usual = await reduction({ target: visit.name, visit: visit.number });
    R.old = R.now = usual;
    $("rework-body").hidden = false;
    $("rework-channel").parentElement.hidden = false;
    $("curve-why").textContent = usual.warnings.join(" · ");
    byHandText();
    curveShown();
    recipes();
  } catch (error) {
    complain(error);
  } finally {
    $("rework-begin").disabled = false;
  }
}

async function recipes() {
  const { names } = await get("recipes");
  $("recipes").replaceChildren(...names.map((name) => Object.assign(document.createElement("option"), { value: name })));
}

async function saveRecipe(event) {
  event.preventDefault();
  const wanted = recipe();
  if (!wanted) return;
  const name = $("recipe-name").value.trim();
  const replace = saveRecipe.again === name;
  saveRecipe.again = "";
  try {
    const saved = await ask("recipes", { name, recipe: wanted, replace });
    $("saved-text").textContent = `saved as ${saved.file}; the same curve again: ${saved.repeat}`;
    recipes();
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    if (error.status === 409) saveRecipe.again = name;
    $("saved-text").textContent = error.message + (error.status === 409 ? ": Save again replaces it" : "");
  }
}

// A recipe that was saved, into the fields.
async function openRecipe() {
  let saved;
  try {
    saved = await get(`recipes/${part($("recipe-name").value.trim())}`);
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    $("saved-text").textContent = error.status === 404 ? "there is no reduction of this name" : error.message;
    return;
  }
  const at = S.about.visits.findIndex((v) => v.name === saved.target && v.number === saved.visit);
  if (at < 0) { $("saved-text").textContent = "this reduction is not of one visit: open it with sunglint reduce"; return; }
  if (S.about.visits[at] !== R.visit) { $("rework-visit").value = String(at); await beginRework(); }
  for (const input of choices()) {
    const [key, index] = input.dataset.key.split(".");
    const value = index === undefined ? saved[key] : saved[key]?.[Number(index)];
    if (input.type === "checkbox") input.checked = Boolean(value);
    else input.value = value ?? "";
  }
  R.places = saved.place;
  R.refused = new Map(saved.refused.map(({ camera, frames }) => [camera, new Set(frames)]));
  $("saved-text").textContent = "";
  reduceSoon();
}

async function curveFile() {
  const wanted = recipe();
  if (!wanted) return;
  try {
    download(await reduction(wanted, "reduction.ecsv", "blob"), `${$("recipe-name").value.trim() || "curve"}.ecsv`);
  } catch (error) { complain(error); }
}

function drawCurve() {
  if (!R.now || $("rework-body").hidden) return;
  const canvas = $("curve");
  const { c, w, h, em } = fit(canvas);
  const name = $("rework-channel").value;
  const both = [R.old, R.now].map((curve) => curve.channels.find((channel) => channel.name === name));
  const mags = inMagnitudes(both[1]);
  const valuesOf = (channel) => (mags ? channel?.magnitude : channel?.rate) ?? [];
  const [from, to] = [R.visit.from_s, Math.max(R.visit.to_s, R.visit.from_s + 1)];
  const box = { l: 5 * em, r: w - 0.6 * em, t: 0.8 * em, b: h - 1.7 * em };
  const x = (t) => box.l + ((t - from) / (to - from)) * (box.r - box.l);
  canvas.plot = { from, to, l: box.l, r: box.r };
  let [least, most] = [Infinity, -Infinity];
  for (const channel of both) for (const rate of valuesOf(channel)) if (rate !== null) [least, most] = [Math.min(least, rate), Math.max(most, rate)];
  if (!(most > -Infinity)) [least, most] = [0, 1];
  const room = 0.05 * (most - least) || 1;
  if (mags) least -= room;
  else least = Math.min(least, 0.9 * least, least - 0.05 * (most - least));
  // Magnitudes are brighter upwards.
  const y = (rate) => { const part = (rate - least) / (most + room - least); return box.b - (mags ? 1 - part : part) * (box.b - box.t); };
  timeAxis(c, [from, to], x, box, w, em);
  c.textBaseline = "middle";
  const marks = ticks(least, most + room, Math.max(2, (box.b - box.t) / (2.4 * em)));
  const written = numbersOf(marks);
  for (const v of marks) {
    if (y(v) < box.t - 1 || y(v) > box.b + 1) continue;
    c.beginPath(); c.moveTo(box.l, y(v)); c.lineTo(box.r, y(v)); c.stroke();
    const text = written(v);
    c.fillText(text, box.l - c.measureText(text).width - 0.4 * em, y(v));
  }
  const same = R.old === R.now;
  both.forEach((channel, k) => {
    if (!channel || (same && k === 0)) return;
    c.fillStyle = k === 0 ? css("--soft") : css("--accent");
    const size = k === 0 ? 2 : 2.5;
    const sigmas = (mags ? channel.sigma_mag : channel.sigma) ?? [];
    if (k === 1 && channel.time_s.length < 700) {
      // One σ up and down, where the dots leave room for it.
      c.strokeStyle = css("--accent");
      c.save();
      c.beginPath(); c.rect(box.l, box.t, box.r - box.l, box.b - box.t); c.clip();
      c.globalAlpha = 0.4;
      c.beginPath();
      valuesOf(channel).forEach((rate, i) => {
        if (rate === null || sigmas[i] === null || sigmas[i] === undefined) return;
        c.moveTo(x(channel.time_s[i]), y(rate - sigmas[i]));
        c.lineTo(x(channel.time_s[i]), y(rate + sigmas[i]));
      });
      c.stroke();
      c.restore();
      c.globalAlpha = 1;
    }
    valuesOf(channel).forEach((rate, i) => {
      if (rate === null) return;
      const [px, py] = [x(channel.time_s[i]), y(rate)];
      // Red light has one colour: what was there before is hollow.
      if (k === 0) { c.strokeStyle = css("--soft"); c.strokeRect(px - size, py - size, 2 * size, 2 * size); }
      else { c.beginPath(); c.arc(px, py, size, 0, 7); c.fill(); }
    });
  });
  // Where the target was in the fibre's field: a strip at the top. Elsewhere the gate is shut, and counts do not count.
  const gated = R.now.flag_names.find(([, flag]) => flag === "off_axis")?.[0] ?? 0;
  const gates = both[1]?.unit === "Hz" ? both[1] : null;
  if (gates) {
    c.fillStyle = css("--soft");
    c.fillText(gates.flags.every((flags) => flags & gated) ? "gate: always shut" : "gate", 0.4 * em, box.t - 0.25 * em);
    c.fillStyle = css("--good");
    gates.time_s.forEach((t, i) => {
      if (gates.flags[i] & gated) return;
      const next = gates.time_s[i + 1];
      c.fillRect(x(t), box.t - 0.45 * em, Math.max(1.5, next - t < 5 ? x(next) - x(t) : 0), 0.3 * em);
    });
  }
  // Refused frames: a cross at the bottom.
  c.strokeStyle = css("--bad");
  const half = (S.about.devices.find((d) => d.name === S.camera)?.exposure_s ?? 0) / 2;
  const refused = R.refused.get(S.camera);
  if (refused?.size) S.film?.number.forEach((n, i) => {
    if (!refused.has(n)) return;
    const px = x(S.film.start_s[i] + half);
    c.beginPath(); c.moveTo(px - 3, box.b - 9); c.lineTo(px + 3, box.b - 3); c.moveTo(px + 3, box.b - 9); c.lineTo(px - 3, box.b - 3); c.stroke();
  });
  const chosen = R.drag ?? R.range ?? (R.mark && [Math.min(R.mark[0], S.t), Math.max(R.mark[1], S.t)]);
  if (chosen) {
    c.globalAlpha = 0.2;
    c.fillStyle = css("--accent");
    c.fillRect(x(Math.min(...chosen)), box.t, Math.abs(x(chosen[1]) - x(chosen[0])), box.b - box.t);
    c.globalAlpha = 1;
  }
  if (S.t >= from && S.t <= to) {
    c.strokeStyle = css("--ink");
    c.beginPath(); c.moveTo(x(S.t), box.t); c.lineTo(x(S.t), box.b); c.stroke();
  }
}

// Where the present reduction has its target on this frame, px of the frame.
function reworkedPlace() {
  const curve = R.now;
  const f = S.frame;
  if (!R.on || !curve || !f || S.camera !== S.about.station_camera) return null;
  const { start_s, exposure_s, origin_px, binning } = f.header;
  const i = curve.track_s.findIndex((t) => t >= start_s && t <= start_s + exposure_s);
  const sensor = S.about.sensor_px;
  if (i < 0 || !sensor) return null;
  return [0, 1].map((k) => (curve.track_px[i][k] + sensor[k] / 2 - origin_px[k]) / binning[k] - 0.5);
}

function wireRework() {
  $("rework-begin").addEventListener("click", beginRework);
  $("rework-cancel").addEventListener("click", () => ask("reduction/cancel", {}).catch(complain));
  for (const id of ["rework-channel", "rework-unit"]) $(id).addEventListener("change", () => { curveText(); redraw("curve"); });
  for (const input of choices()) input.addEventListener("input", reduceSoon);
  $("point").addEventListener("click", () => pointing(!R.pointing));
  $("refuse").addEventListener("click", refuse);
  $("usual").addEventListener("click", () => {
    for (const input of choices()) input.type === "checkbox" ? (input.checked = false) : (input.value = "");
    Object.assign(R, { places: [], refused: new Map(), range: null, mark: null });
    reduceSoon();
  });
  $("save-form").addEventListener("submit", (event) => saveRecipe(event).catch(complain));
  $("recipe-load").addEventListener("click", () => openRecipe().catch(complain));
  $("curve-file").addEventListener("click", curveFile);
  const canvas = $("curve");
  const timeUnder = (event) => {
    const { from, to, l, r } = canvas.plot ?? {};
    return from === undefined ? null : from + (clamp(event.clientX - canvas.getBoundingClientRect().left, l, r) - l) / (r - l) * (to - from);
  };
  canvas.addEventListener("pointerdown", (event) => { const t = timeUnder(event); if (t !== null) { R.drag = [t, t]; R.dragX = event.clientX; canvas.setPointerCapture(event.pointerId); } });
  canvas.addEventListener("pointermove", (event) => { if (R.drag) { R.drag[1] = timeUnder(event); redraw("curve"); } });
  canvas.addEventListener("pointerup", (event) => {
    if (!R.drag) return;
    const [a, b] = [...R.drag].sort((p, q) => p - q);
    R.drag = null;
    R.range = Math.abs(event.clientX - R.dragX) < 4 ? null : [a, b];
    if (!R.range) seek(a);
    byHandText();
    redraw("curve");
  });
}

function showRework() {
  const list = S.about.visits.map((v, i) => [v, i]).filter(([v]) => v.kind === "star" || v.kind === "satellite");
  $("rework").hidden = !token() || !list.length;
  $("rework-visit").replaceChildren(...list.map(([v, i]) => Object.assign(document.createElement("option"), { value: String(i), textContent: v.number > 1 ? `${v.name} (${v.number})` : v.name })));
}

// --- a clip -------------------------------------------------------------------------------------------------------------

// The frames that are asked for, with what they come to; null where a field is no number.
function clipWish() {
  const whole = (id) => { const text = $(id).value.trim(); return /^\d+$/.test(text) ? Number(text) : null; };
  const [from, to, every, fps] = [whole("clip-from"), whole("clip-to"), whole("clip-every"), Number($("clip-fps").value)];
  if (from === null || to === null || !every || !(fps >= 0.1 && fps <= 100)) return null;
  const h = S.frame.header;
  const { low, high, soft } = S.frame;
  const wish = { camera: S.camera, from, to, every, range_adu: [low, high], red: theme() === "red", shown_ms: Math.round(1000 / fps) };
  if (soft) wish.soft = soft;
  if (S.view) {
    const canvas = $("image");
    const { each, x0, y0 } = windowOf(canvas.clientWidth, canvas.clientHeight);
    const [x, y] = [x0, y0].map((v) => Math.max(0, Math.floor(v)));
    wish.part_px = [x, y, Math.ceil(x0 + each * canvas.clientWidth) - x, Math.ceil(y0 + each * canvas.clientHeight) - y];
  }
  const frames = Math.ceil(S.film.number.filter((n) => n >= from && n <= to).length / every);
  const [w, height] = wish.part_px ? [Math.min(wish.part_px[2], h.size_px[0] - wish.part_px[0]), Math.min(wish.part_px[3], h.size_px[1] - wish.part_px[1])] : h.size_px;
  const bin = Math.ceil(Math.max(w, height) / 1280);
  return { wish, frames, shape: [Math.ceil(w / bin), Math.ceil(height / bin)], plays_s: frames / fps };
}
function clipText() {
  const clip = S.frame && S.film && clipWish();
  const said = clip ? `${clip.frames} frames of ${clip.shape[0]} × ${clip.shape[1]} px, at most ${(clip.frames * clip.shape[0] * clip.shape[1] * 1e-6).toFixed(1)} MB; plays ${span(clip.plays_s)}; stretch and part as shown now` : "expected whole numbers of frames, and 0.1 to 100 frames a second";
  $("clip-text").textContent = said;
}
async function saveClip(event) {
  event.preventDefault();
  const clip = clipWish();
  if (!clip) { clipText(); return; }
  $("clip-text").textContent = "the clip is being made";
  try {
    const blob = await ask("clip", clip.wish, { patience_ms: 600000, as: "blob" });
    S.saved = { name: "clip.png", blob };
    download(blob, `${fileName(S.about.name)}-${clip.wish.from}-${clip.wish.to}.png`);
    $("clip-text").textContent = `${clip.frames} frames, ${(blob.size * 1e-6).toFixed(2)} MB`;
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    $("clip-text").textContent = error.message;
  }
}
function wireClip() {
  $("clip").addEventListener("toggle", () => {
    if (!$("clip").open || !S.film) return;
    // The present visit's frames, or all.
    const visit = visitAt(S.t);
    const own = S.film.number.filter((_, i) => !visit || (S.film.start_s[i] >= visit.from_s && S.film.start_s[i] < visit.to_s));
    const numbers = own.length ? own : S.film.number;
    [$("clip-from").value, $("clip-to").value] = [numbers[0], numbers[numbers.length - 1]].map(String);
    clipText();
  });
  for (const id of ["clip-from", "clip-to", "clip-every", "clip-fps"]) $(id).addEventListener("input", clipText);
  $("clip-form").addEventListener("submit", (event) => saveClip(event).catch(complain));
}

// --- live ---------------------------------------------------------------------------------------------------------------

const KEEP = 6000;
function take(view) {
  const again = S.live && S.live.run !== view.run;
  S.live = view;
  S.anew ||= again;
  if (S.anew) return;
  addEvents(view.events);
  if (view.events.length) S.seen.events = view.events[view.events.length - 1].number;
  let missed = view.events_missed;
  for (const [name, new_] of Object.entries(view.counts)) {
    const have = (S.counts[name] ??= { channels: new_.channels, start_s: [], length_s: [], flags: [], rate_hz: new_.channels.map(() => []), corrected_hz: new_.channels.map(() => []), magnitudes: { magnitude: new_.channels.map(() => []), sigma_mag: new_.channels.map(() => []) }, bins: 1 });
    for (const key of ["start_s", "length_s", "flags"]) have[key].push(...new_[key]);
    new_.rate_hz.forEach((rates, k) => have.rate_hz[k].push(...rates));
    view.corrected_hz[name].forEach((rates, k) => have.corrected_hz[k].push(...rates));
    for (const key of ["magnitude", "sigma_mag"]) have.magnitudes[key].forEach((list, k) => list.push(...(view.magnitudes[name]?.[key][k] ?? [])));
    const over = have.start_s.length - KEEP;
    if (over > 0) for (const list of [have.start_s, have.length_s, have.flags, ...have.rate_hz, ...have.corrected_hz, ...have.magnitudes.magnitude, ...have.magnitudes.sigma_mag]) list.splice(0, over);
    if (S.seen.counts[name] !== undefined) missed += new_.missed;
    S.seen.counts[name] = new_.last;
  }
  const gone = S.since && Date.now() - S.since > 3000 ? (Date.now() - S.since) / 1000 : 0;
  if (gone || missed) {
    const caught = view.events.length ? `, ${view.events.length} events came meanwhile` : "";
    const lost = missed ? `; ${missed} points or events are not on this page (the session has them)` : "";
    notice(gone ? `back after ${span(gone)} without the night${caught}${lost}` : `this page was too slow${lost}`);
  }
  S.since = Date.now();
  if (view.events.some((e) => e.kind === "target" || e.kind === "control")) schedule();
}

// The program was started again: this is another night, of which nothing is known yet.
async function newNight() {
  const away = S.since ? `, ${span((Date.now() - S.since) / 1000)} after this page last heard of the other one` : "";
  Object.assign(S, { seen: { events: 0, counts: {} }, counts: {}, history: {}, looks: null, events: [], sky: null, tracks: [], lag: {}, view: null });
  $("looks-box").hidden = true;
  M.trail = [];
  mountMode(null);
  $("events").replaceChildren();
  $("events-more").textContent = "";
  const chosen = await about();
  await chooseCamera(chosen.camera);
  chooseCounter(chosen.counter);
  S.since = Date.now();
  S.anew = false;
  notice(`the program was started again${away}: this is the new night${token() ? "" : ". To steer it, open the address that its start printed"}`);
}

const schedule = latest(async () => {
  const { visits: list } = await get("about");
  S.about.visits = list;
  visits();
  S.tracks = await get("tracks");
  await loadPredicted();
});

// Alarms: of each kind and device when it was last there, and those that were told, the last ones.
const A = { seen: new Map(), last: new Set(), told: [], full: false, silent: false, audio: null, beeps: 0 };
window.sunglint.alarms = A;
// An alarm that was away for less than this is the same one: a device that comes and goes rings once, ms.
const SAME = 60000;
// Each with what it is, which stays, and its text, whose numbers change.
function alarmsOf(view) {
  const all = [];
  for (const [name, device] of Object.entries(view?.devices ?? {})) if (device.error) all.push([`${device.state} ${name}`, `${name} ${device.state === "failed" ? "was given up" : "is lost"}: ${device.error}`]);
  if (view?.disk_error) all.push(["disk", view.disk_error]);
  if (view?.not_written) all.push(["not written", `${view.not_written} rows or frames are not written`]);
  const left_s = view?.bytes_per_s ? view.free_bytes / view.bytes_per_s : Infinity;
  // Once told it stays until there is clearly more room.
  A.full = left_s < (A.full ? 4500 : 3600);
  if (A.full) all.push(["full", `the disk is full in ${span(left_s)}`]);
  if (A.silent) all.push(["silent", `the program has not answered since ${new Date(S.since).toISOString().slice(11, 19)} UTC: look after it`]);
  return all;
}
function alarms() {
  const all = alarmsOf(S.live);
  const now = Date.now();
  const fresh = all.filter(([key]) => !A.last.has(key) && !(now - A.seen.get(key) < SAME));
  for (const [key] of all) A.seen.set(key, now);
  // The timers of a page that nobody sees may come once a minute: what was there the last time is not new.
  A.last = new Set(all.map(([key]) => key));
  const text = all.map(([, said]) => said).join(" · ");
  if ($("alarm").textContent !== text) $("alarm").textContent = text;
  $("alarm").hidden = !text;
  if (!all.length) $("alarm-said").textContent = "";
  if (!fresh.length) return;
  // What is read aloud is what is new, once.
  $("alarm-said").textContent = fresh.map(([, said]) => said).join(" · ");
  A.told.push(...fresh.map(([key]) => key));
  A.told.splice(0, A.told.length - 100);
  if ($("sound").checked) beep();
}
function beep() {
  A.beeps++;
  A.audio ??= new AudioContext();
  // A page that nobody has touched may not sound yet.
  A.audio.resume();
  const tone = A.audio.createOscillator();
  tone.frequency.value = 880;
  tone.connect(A.audio.destination);
  tone.start();
  tone.stop(A.audio.currentTime + 0.4);
}
function wireSound() {
  $("sound").checked = localStorage.getItem("sunglint-sound") === "yes";
  $("sound").addEventListener("change", () => {
    localStorage.setItem("sunglint-sound", $("sound").checked ? "yes" : "no");
    // So that it is heard what an alarm is like, and the browser lets it sound later.
    if ($("sound").checked) beep();
  });
  // After the page was loaded again the browser waits for a touch.
  const touched = () => { if ($("sound").checked) { A.audio ??= new AudioContext(); A.audio.resume(); } };
  for (const kind of ["pointerdown", "keydown"]) addEventListener(kind, touched, { once: true });
}

function showLive(view) {
  $("mode").textContent = view.ended ? `ended: ${view.ended}` : view.waiting ? "waiting for Start" : view.paused ? "paused" : "live";
  $("mode").className = view.ended ? "badge" : view.paused ? "badge bad" : "badge good";
  present(view.now_s);
  devices();
  markVisits(view.now_s);
  alarms();
  clockText(view.clock);
  if (S.camera) loadLooks(S.camera);
  const free = view.free_bytes === null ? "" : `disk: ${(view.free_bytes * 1e-9).toFixed(1)} GB free`;
  const fills = view.bytes_per_s ? `, full in ${span(view.free_bytes / view.bytes_per_s)} at this rate` : "";
  const dropped = view.dropped ? `; ${view.dropped} bunches of bins or events did not reach the page (the session has them)` : "";
  $("disk").textContent = free + fills + dropped;
  $("pause").textContent = view.paused ? "Resume" : "Pause";
  $("focus").hidden = !S.about.focusers?.includes(S.camera);
  $("focus").disabled = Boolean(view.ended) || !view.can_pause;
  for (const id of ["pause", "skip", "repeat"]) { $(id).disabled = Boolean(view.ended) || !view.can_pause; $(id).title = view.can_pause ? "" : "the visits of a night that is virtual or played back are fixed"; }
  $("stop").disabled = Boolean(view.ended);
  $("start").hidden = !view.waiting || Boolean(view.ended);
  for (const id of ["pause", "skip", "repeat"]) $(id).hidden = Boolean(view.waiting);
  showMount(view);
  const frame = view.devices[S.camera]?.frame;
  if (frame && frame.start_s !== S.frame?.of) loadFrame({ camera: S.camera, of: frame.start_s });
  else frameText();
  if (!S.sky || Math.abs(S.sky.at_s - skyTime()) > 5) loadSky(skyTime());
  // The whole night has many points: once a second is enough.
  if (!S.wideAt || performance.now() - S.wideAt > 1000) redraw("counts");
}

async function live() {
  onToken(() => {
    $("steer").hidden = !token();
    $("note-form").hidden = !token();
    $("expose-form").hidden = !token() || !S.camera;
    if (!token()) mountMode(null);
  });
  $("sound-label").hidden = false;
  $("ahead-label").hidden = false;
  document.body.classList.add("live");
  $("span").value = "60";
  S.since = Date.now();
  let [failed, failing] = [0, 0];
  for (;;) {
    const begun = performance.now();
    try {
      const query = new URLSearchParams({ events: String(S.seen.events) });
      for (const [name, number] of Object.entries(S.seen.counts)) query.set(`c.${name}`, String(number));
      const view = await get(`live?${query}`);
      if (failed) { failed = 0; A.silent = false; notice(""); }
      if (S.live?.waiting && !view.waiting && !view.ended && S.live.run === view.run) {
        // What was shown was the plan; now it is the night, which begins at another time.
        const chosen = await about();
        notice("the night has begun");
        await chooseCamera(chosen.camera);
        chooseCounter(chosen.counter);
      }
      take(view);
      if (S.anew) {
        await newNight();
        continue;
      }
      showLive(view);
      root.dataset.ready = "yes";
      if (view.ended) failed = 0;
    } catch (error) {
      // The token was of another start: without it this page goes on and shows what it may.
      if (error.status === 401) {
        $("mode").textContent = "no token";
        $("mode").className = "badge bad";
        complain(error);
        await wakened(error);
        continue;
      }
      if (!failed++) failing = performance.now();
      $("mode").textContent = S.live?.ended ? `ended: ${S.live.ended}` : "no connection";
      $("mode").className = "badge bad";
      // An ended night's program is gone: nothing is wrong.
      if (!S.live?.ended) {
        complain(error);
        A.silent ||= error instanceof Silent && performance.now() - failing > 3000;
        alarms();
      }
    }
    const pause = failed ? Math.min(1000, 200 * failed) : document.hidden ? 1000 : S.live?.ended ? 100 : inStep(begun);
    await new Promise((done) => setTimeout(done, Math.max(0, pause - (performance.now() - begun))));
  }
}

// How long after the last question to ask for news again, ms: ten times a second, in step with the camera, so that a frame is asked for when it is there and not up to 0.1 s later. The question at which
// a frame is due comes a little earlier each time, until one is too early: that one is asked again at once, and the step is set back.
const STEP = { camera: null, of: null, at: 0, every: 0, early: 0 };
function inStep(begun) {
  const frame = S.live?.devices[S.camera]?.frame;
  if (!frame) return 100;
  if (STEP.camera !== S.camera || frame.start_s !== STEP.of) {
    const every = 1000 * (frame.start_s - STEP.of);
    Object.assign(STEP, { camera: S.camera, of: frame.start_s, at: begun, every: STEP.camera === S.camera && every > 0 && every < 5000 ? every : 0, early: 0 });
  }
  if (!STEP.every) return 100;
  const wait = STEP.at + STEP.every - 4 - begun;
  if (wait > 0) return clamp(wait, 20, 100);
  return ++STEP.early <= 2 ? 20 : 100;
}

async function steer(action, text = "", more = {}) {
  try {
    const { done } = await ask("control", { action, text, ...more });
    notice(done);
    return true;
  } catch (error) {
    complain(error);
    return false;
  }
}

// --- the mount ----------------------------------------------------------------------------------------------------------

// What the next click on the image means: "lock", "keep" or nothing. And where the telescope was.
const M = { mode: null, trail: [] };

function mountOf(view) {
  return Object.entries(view?.devices ?? {}).find(([, device]) => device.mount);
}
function mountMode(mode) {
  if (mode === M.mode) return;
  M.mode = mode;
  $("mount-lock").setAttribute("aria-pressed", String(mode === "lock"));
  $("mount-keep").setAttribute("aria-pressed", String(mode === "keep"));
  if (mode === "lock") askPlace("click the target in the image: the mount follows this light from then on");
  if (mode === "keep") askPlace("click the place in the image at which targets are to be kept");
  redraw("image");
}
function mountPlace([x, y]) {
  const h = S.frame.header;
  const place_px = [x - 0.5, y - 0.5];
  if (place_px.some((v, k) => v < -0.5 || v > h.size_px[k] - 0.5)) { notice("that place lies outside of the frame"); return; }
  const action = M.mode;
  mountMode(null);
  steer(action, "", { camera: S.camera, start_s: h.start_s, place_px });
}

function showMount(view) {
  const [name, device] = mountOf(view) ?? [];
  $("mount").hidden = !device;
  if (!device) return;
  $("mount-steer").hidden = !token();
  const m = device.mount;
  const arcsec = (value) => (value >= 3600 ? `${(value / 3600).toFixed(1)}°` : value >= 120 ? `${(value / 60).toFixed(1)}′` : `${value.toFixed(1)}″`);
  const parts = [`${name}: ${m.state}`];
  if (m.at_deg) parts.push(`azimuth ${m.at_deg[0].toFixed(2)}°, altitude ${m.at_deg[1].toFixed(2)}°`);
  if (m.error_arcsec !== null) parts.push(`${arcsec(m.error_arcsec)} from where it should look`);
  if (m.seen_arcsec !== null) parts.push(`target ${arcsec(m.seen_arcsec)} off in the frame`);
  if (m.sun_deg !== null) parts.push(`Sun ${m.sun_deg.toFixed(0)}° away`);
  $("mount-text").textContent = parts.join(" · ");
  $("mount-text").classList.toggle("warn", ["stopped", "searching", "coasting"].includes(m.state));
  for (const button of $("mount-steer").querySelectorAll("button")) button.disabled = Boolean(view.ended) || !view.can_pause;
  const last = M.trail[M.trail.length - 1];
  if (m.at_deg && (!last || Math.hypot(m.at_deg[0] - last[0], m.at_deg[1] - last[1]) > 0.3)) {
    M.trail.push(m.at_deg);
    if (M.trail.length > 2000) M.trail.splice(0, 500);
    redraw("sky");
  }
}

function wireMount() {
  for (const mode of ["lock", "keep"]) $(`mount-${mode}`).addEventListener("click", () => { const on = M.mode !== mode; mountMode(on ? mode : null); if (!on) notice(""); });
  for (const what of ["follow", "park", "halt"]) $(`mount-${what}`).addEventListener("click", () => { mountMode(null); steer(what); });
  for (const button of document.querySelectorAll("[data-jog]")) button.addEventListener("click", () => {
    const step = Number($("mount-step").value);
    steer("jog", "", { arcsec: button.dataset.jog.split(",").map((way) => Number(way) * step) });
  });
}

// The telescope where its mount says that it looks, and where it was; about the Sun the circle into which it does not go.
function drawMount({ c, place, em }) {
  const device = mountOf(S.live)?.[1];
  if (!device) return;
  c.strokeStyle = css("--soft");
  c.setLineDash([2, 3]);
  c.beginPath();
  let before;
  for (const at of M.trail) {
    const jump = !before || Math.abs(at[0] - before[0]) > 90;
    jump ? c.moveTo(...place(at)) : c.lineTo(...place(at));
    before = at;
  }
  c.stroke();
  c.setLineDash([]);
  const at = device.mount.at_deg;
  if (at && at[1] > 0) {
    const [x, y] = place(at);
    c.strokeStyle = css("--accent");
    c.lineWidth = 2;
    c.strokeRect(x - 0.45 * em, y - 0.45 * em, 0.9 * em, 0.9 * em);
    c.lineWidth = 1;
  }
  const [sun, limit] = [S.sky?.sun_deg, S.about.sun_limit_deg];
  if (!sun || !limit || sun[1] < -limit) return;
  c.strokeStyle = css("--warn");
  around(c, place, sun, limit);
}

// --- focus and background -----------------------------------------------------------------------------------------------

const loadLooks = latest(async (camera) => {
  const have = S.looks?.camera === camera ? S.looks : { camera, start_s: [], fwhm_px: [], hfr_px: [], background_adu: [] };
  const come = await get(`looks/${part(camera)}?after_s=${have.start_s.at(-1) ?? -1e9}`);
  if (camera !== S.camera) return;
  for (const key of ["start_s", "fwhm_px", "hfr_px", "background_adu"]) {
    for (const value of come[key]) have[key].push(value);
    have[key].splice(0, have[key].length - 7200);
  }
  S.looks = have;
  $("looks-box").hidden = have.start_s.length < 2 || [...have.fwhm_px, ...have.background_adu].every((v) => v === null);
  redraw("looks");
  await new Promise((done) => setTimeout(done, 1000));
});

// Width of the target, half-flux radius of the stars and background of a pixel over the time, each in its strip.
function drawLooks() {
  const canvas = $("looks");
  const looks = S.looks;
  if (!S.live || !looks || $("looks-box").hidden) return;
  const { c, w, h, em } = fit(canvas);
  const [from, to] = [Math.max(looks.start_s[0], S.live.now_s - 3600), Math.max(S.live.now_s, looks.start_s[0] + 60)];
  const left = 9.5 * em;
  const x = (t) => left + ((t - from) / (to - from)) * (w - left - 0.4 * em);
  const said = [];
  [["fwhm_px", "width", "px", 2], ["hfr_px", "half-flux", "px", 2], ["background_adu", "background", "ADU", 0]].forEach(([key, name, unit, digits], k) => {
    const [top, bottom] = [(k * h) / 3 + 0.3 * em, ((k + 1) * h) / 3 - 0.3 * em];
    const values = looks[key].filter((v, i) => v !== null && looks.start_s[i] >= from);
    // The middle nine tenths: a frame with a satellite's flare must not flatten the rest.
    const sorted = [...values].sort((a, b) => a - b);
    const at = (q) => sorted[Math.round(q * (sorted.length - 1))] ?? 0;
    const room = Math.max(0.1 * (at(0.95) - at(0.05)), digits ? 0.1 : 1);
    const [low, high] = [at(0.05) - room, at(0.95) + room];
    const y = (v) => bottom - clamp((v - low) / (high - low), 0, 1) * (bottom - top);
    const last = looks[key].findLast((v) => v !== null);
    const text = `${name} ${last === undefined ? "–" : last.toFixed(digits)} ${unit}`;
    said.push(`${text} (${at(0.05).toFixed(digits)} to ${at(0.95).toFixed(digits)})`);
    c.fillStyle = css("--soft");
    c.textBaseline = "middle";
    c.fillText(text, 0.2 * em, (top + bottom) / 2);
    c.strokeStyle = css("--line");
    c.lineWidth = 1;
    c.beginPath(); c.moveTo(left, bottom); c.lineTo(w - 0.4 * em, bottom); c.stroke();
    c.strokeStyle = css(k === 2 ? "--soft" : "--accent");
    c.lineWidth = 1.5;
    c.beginPath();
    let before = false;
    looks[key].forEach((v, i) => {
      // The radius is looked for once a second only.
      if (v === null && key === "hfr_px") return;
      if (v === null || looks.start_s[i] < from) { before = false; return; }
      const p = [x(looks.start_s[i]), y(v)];
      before ? c.lineTo(...p) : c.moveTo(...p);
      before = true;
    });
    c.stroke();
  });
  canvas.setAttribute("aria-label", `focus and background over ${span(to - from)}: ${said.join(", ")}`);
}

// How well the computer knows the time.
function clockText(clock) {
  $("clock-health").hidden = !clock;
  if (!clock) return;
  const { method, synchronised, offset_s, error_s } = clock;
  const how = synchronised === true ? "follows UTC" : synchronised === false ? "does not follow UTC" : "not known whether it follows UTC";
  const ms = (s) => `${(1000 * s).toPrecision(2)} ms`;
  const parts = [`clock: ${how}${method === "none" ? "" : `, by ${method}`}`];
  if (offset_s !== undefined) parts.push(`${offset_s < 0 ? "" : "+"}${ms(offset_s)} from it`);
  if (error_s !== undefined) parts.push(`wrong by ${ms(error_s)} at most`);
  $("clock-health").textContent = parts.join(", ");
  $("clock-health").classList.toggle("warn", synchronised !== true);
}

// --- the person ---------------------------------------------------------------------------------------------------------

const DRAW = { image: drawImage, counts: () => S.about && drawCounts(), sky: () => S.about && drawSky(), looks: drawLooks, strip: drawStrip, curve: drawCurve };

function wire() {
  $("theme").value = localStorage.getItem("sunglint-theme") ?? "auto";
  $("theme").addEventListener("change", () => { localStorage.setItem("sunglint-theme", $("theme").value); develop(); paintTheme(); });
  system.addEventListener("change", () => { develop(); paintTheme(); });
  $("stretch").addEventListener("change", () => { develop(); frameText(); redraw("image"); });
  $("marks").addEventListener("change", () => { redraw("image"); if ($("marks").checked && S.frame) loadMarks({ camera: S.camera, of: S.frame.of }); });
  $("sources").addEventListener("change", () => { if ($("sources").checked) $("marks").checked = true; redraw("image"); if (S.frame) loadMarks({ camera: S.camera, of: S.frame.of }); });
  $("zoom-in").addEventListener("click", () => zoom(2));
  $("zoom-out").addEventListener("click", () => zoom(0.5));
  $("zoom-all").addEventListener("click", () => zoom(0));
  $("image").addEventListener("click", (event) => { if (S.frame) placing()?.(pixelUnder(event)); });
  $("image").addEventListener("keydown", crossKey);
  wireRework();
  $("image").addEventListener("pointermove", (event) => { if (S.frame) readPixel(pixelUnder(event)); });
  $("image").addEventListener("pointerleave", () => { $("pixel").textContent = "\u00a0"; });
  $("image").addEventListener("dblclick", (event) => S.frame && zoom(2, pixelUnder(event)));
  $("image").addEventListener("wheel", (event) => { if (S.frame && event.ctrlKey) { event.preventDefault(); zoom(event.deltaY < 0 ? 1.25 : 0.8, pixelUnder(event)); } }, { passive: false });
  $("camera").addEventListener("change", () => chooseCamera($("camera").value).catch(complain));
  $("counter").addEventListener("change", () => chooseCounter($("counter").value));
  $("span").addEventListener("change", () => { needCounts(); redraw("counts"); });
  for (const id of ["log", "corrected", "predicted"]) $(id).addEventListener("change", () => redraw("counts"));
  $("unit").addEventListener("change", () => { unitShown(); redraw("counts"); });
  for (const button of document.querySelectorAll("[data-figure]")) button.addEventListener("click", () => figure(...button.dataset.figure.split(" ")).catch(complain));
  wireClip();
  const counts = $("counts");
  const timeUnder = (event) => {
    const { from, to, l, r } = counts.plot ?? {};
    return from === undefined ? null : from + (clamp(event.clientX - counts.getBoundingClientRect().left, l, r) - l) / (r - l) * (to - from);
  };
  counts.addEventListener("pointermove", (event) => { S.hover = timeUnder(event); redraw("counts"); });
  counts.addEventListener("pointerleave", () => { S.hover = null; redraw("counts"); });
  counts.addEventListener("click", (event) => { const t = timeUnder(event); if (!S.live && t !== null) seek(t); });
  $("slider").addEventListener("input", () => seek(Number($("slider").value)));
  $("play").addEventListener("click", () => play(!S.playing));
  $("before").addEventListener("click", () => stepFrame(-1));
  $("after").addEventListener("click", () => stepFrame(1));
  $("pause").addEventListener("click", () => steer(S.live?.paused ? "resume" : "pause"));
  $("skip").addEventListener("click", () => steer("skip"));
  $("repeat").addEventListener("click", () => steer("repeat"));
  wireMount();
  wireSound();
  $("start").addEventListener("click", () => steer("start"));
  $("stop").addEventListener("click", () => steer("stop"));
  $("note-form").addEventListener("submit", async (event) => { event.preventDefault(); if (await steer("note", $("note").value)) $("note").value = ""; });
  $("focus").addEventListener("click", () => steer("focus", "", { camera: S.camera }));
  $("expose-form").addEventListener("submit", (event) => {
    event.preventDefault();
    const more = { camera: S.camera };
    for (const [key, id] of [["exposure_s", "expose-s"], ["gain", "expose-gain"]]) {
      const text = $(id).value.trim();
      if (text === "") continue;
      if (!Number.isFinite(Number(text))) { notice(`${text} is no number`); return; }
      more[key] = Number(text);
    }
    steer("expose", "", more);
  });
  $("sky").addEventListener("pointermove", (event) => {
    if (S.overlay) return;
    S.pointed = skyUnder(event);
    $("sky-text").textContent = S.pointed ?? S.skyText ?? "";
  });
  $("sky").addEventListener("pointerleave", () => { if (S.overlay) return; S.pointed = null; $("sky-text").textContent = S.skyText ?? ""; });
  $("ahead").addEventListener("input", () => {
    const said = ahead() ? `in ${span(ahead())}` : "now";
    $("ahead-at").textContent = said;
    $("ahead").setAttribute("aria-valuetext", said);
    if (S.live) loadSky(skyTime());
    redraw("sky");
  });
  const help = () => { $("help").hidden = !$("help").hidden; $("help-button").setAttribute("aria-expanded", String(!$("help").hidden)); };
  $("help-button").addEventListener("click", help);
  const sizes = new ResizeObserver(drawAll);
  for (const canvas of document.querySelectorAll("canvas")) sizes.observe(canvas);
  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey || !S.about) return;
    if (event.target.matches("input[type=text], select")) return;
    const film = S.about.mode === "recorded";
    const onSlider = event.target === $("slider");
    const onButton = event.target.matches("button, input[type=checkbox], summary");
    const visitStart = (by) => {
      const list = S.about.visits;
      const next = by > 0 ? list.find((v) => v.from_s > S.t + 0.01) : list.findLast((v) => v.from_s < S.t - 1);
      if (next) seek(next.from_s);
    };
    const act = {
      " ": film && !onButton && (() => play(!S.playing)),
      ArrowLeft: film && (() => (event.shiftKey ? seek(S.t - 60) : stepFrame(-1))),
      ArrowRight: film && (() => (event.shiftKey ? seek(S.t + 60) : stepFrame(1))),
      Home: film && !onSlider && (() => seek(0)),
      End: film && !onSlider && (() => seek(S.about.length_s)),
      "[": film && (() => visitStart(-1)),
      "]": film && (() => visitStart(1)),
      "+": () => zoom(2), "-": () => zoom(0.5), 0: () => zoom(0),
      x: film && R.on && refuse,
      m: film && R.on && markStretch,
      s: () => { $("stretch").selectedIndex = ($("stretch").selectedIndex + 1) % 3; $("stretch").dispatchEvent(new Event("change")); },
      r: () => { const now = $("theme").value; $("theme").value = now === "red" ? (wire.before ?? "auto") : "red"; if (now !== "red") wire.before = now; $("theme").dispatchEvent(new Event("change")); },
      "?": help,
      Escape: (placing() || R.mark) && (() => { pointing(false); mountMode(null); R.mark = null; notice(""); redraw("curve"); }),
    }[event.key];
    if (!act) return;
    event.preventDefault();
    act();
  });
}

async function begin() {
  wire();
  root.dataset.theme = theme();
  for (;;) {
    try {
      const chosen = await about();
      notice("");
      S.live = S.about.mode === "live" ? S.live : null;
      if (S.about.mode === "live") {
        S.camera = chosen.camera;
        S.counter = chosen.counter;
        S.live = await get("live");
        notice("");
        S.live.counts = {};
        legend();
        await live();
      } else if (S.about.mode === "plan") await (await import("./plan.js")).planning();
      else if (S.about.mode === "lab") await (await import("./lab.js")).lab();
      else await recorded(chosen);
      return;
    } catch (error) {
      // The night has not begun, or the program is not there yet.
      $("mode").textContent = error.status === 401 ? "no token" : "waiting";
      complain(error);
      await wakened(error);
      await new Promise((done) => setTimeout(done, 1000));
    }
  }
}
const setDraw = (name, draw) => { DRAW[name] = draw; };
export { $, S, Refused, STROKES, about, ask, clamp, complain, css, fit, get, hertz, latest, lightColour, lineColour, loadSky, notice, numbersOf, onToken, redraw, row, setDraw, span, swatchOf, theme, thickness, ticks, timeAxis, token, utc, wakened, warnings };
// This program came: theme.js may load the page again when it does not.
try { sessionStorage.setItem("sunglint-reloads", 0); } catch { /* nothing is kept */ }
begin();
