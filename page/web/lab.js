// A run in the lab: the reading, how steady it is, the curve as it grows, the time left.
import { $, S, Refused, STROKES, about, clamp, complain, css, fit, get, lineColour, notice, onToken, redraw, setDraw, span, swatchOf, theme, ticks, token, wakened } from "./page.js";

const L = { places: [], seen: 0, run: 0, view: null };
window.sunglint.lab = L;

const watts = (power) => (power === null || power === undefined ? "over the range" : `${power.toExponential(3)} W`);
const percent = (part) => (part === null || part === undefined ? "–" : `${(100 * part).toPrecision(2)} %`);

let legendOf = "";
function swatches() {
  const parts = [...new Set(L.places.map((p) => p.part))];
  const key = parts.join() + theme();
  if (key !== legendOf) {
    legendOf = key;
    $("lab-legend").replaceChildren(...parts.map((part, k) => {
      const item = document.createElement("span");
      const swatch = document.createElement("span");
      swatch.className = "swatch";
      swatch.style.background = swatchOf(k);
      item.append(swatch, ` ${part.replaceAll("_", " ")}`);
      return item;
    }));
  }
}

function drawLab() {
  swatches();
  const canvas = $("lab");
  const { c, w, h, em } = fit(canvas);
  const good = L.places.filter((p) => p.mean_w !== null);
  const log = $("lab-log").checked;
  const shown = log ? good.filter((p) => p.mean_w > 0) : good;
  const parts = [...new Set(L.places.map((p) => p.part))];
  const box = { l: 6.5 * em, r: w - 0.8 * em, t: 0.8 * em, b: h - 2.6 * em };
  if (!shown.length) {
    c.fillStyle = css("--soft");
    c.fillText("no place is measured yet", box.l, h / 2);
    return;
  }
  const value = (p) => (log ? Math.log10(p.mean_w) : p.mean_w);
  const bounds = (list) => { const [a, b] = list.reduce(([low, high], v) => [Math.min(low, v), Math.max(high, v)], [Infinity, -Infinity]); const room = 0.05 * (b - a) || 0.05 * Math.abs(b) || 1; return [a - room, b + room]; };
  const [x0, x1] = bounds(shown.map((p) => p.angle_deg));
  const [y0, y1] = bounds(shown.map(value));
  const x = (v) => box.l + ((v - x0) / (x1 - x0)) * (box.r - box.l);
  const y = (v) => box.b - ((v - y0) / (y1 - y0)) * (box.b - box.t);
  c.strokeStyle = css("--line");
  c.fillStyle = css("--soft");
  c.lineWidth = 1;
  c.textBaseline = "top";
  for (const v of ticks(x0, x1, Math.max(2, (box.r - box.l) / (5 * em)))) {
    c.beginPath(); c.moveTo(x(v), box.t); c.lineTo(x(v), box.b); c.stroke();
    const text = `${Math.round(v * 1e4) / 1e4}°`;
    c.fillText(text, x(v) - c.measureText(text).width / 2, box.b + 0.3 * em);
  }
  c.fillText(S.about.angle, (box.l + box.r - c.measureText(S.about.angle).width) / 2, box.b + 1.5 * em);
  c.textBaseline = "middle";
  const marks = ticks(y0, y1, Math.max(2, (box.b - box.t) / (2.6 * em)));
  // As many digits as tell two marks apart.
  const power = (v) => Math.floor(Math.log10(Math.abs(v) || 1));
  const digits = log || marks.length < 2 ? 1 : clamp(Math.max(...marks.map(power)) - power((marks[1] - marks[0]) * (1 + 1e-9)), 1, 9);
  for (const v of marks) {
    c.beginPath(); c.moveTo(box.l, y(v)); c.lineTo(box.r, y(v)); c.stroke();
    const text = `${(log ? 10 ** v : v).toExponential(digits)} W`;
    c.fillText(text, box.l - c.measureText(text).width - 0.4 * em, y(v));
  }
  parts.forEach((part, k) => {
    const list = shown.filter((p) => p.part === part).sort((a, b) => a.angle_deg - b.angle_deg);
    c.strokeStyle = c.fillStyle = lineColour(k);
    c.lineWidth = 1.5;
    c.setLineDash(theme() === "red" ? STROKES[k % 4] : []);
    c.beginPath();
    for (const p of list) c.lineTo(x(p.angle_deg), y(value(p)));
    c.stroke();
    c.setLineDash([]);
    for (const p of list) { c.beginPath(); c.arc(x(p.angle_deg), y(value(p)), 2, 0, 7); c.fill(); }
  });
}

function show(view) {
  L.view = view;
  $("mode").textContent = view.ended ? `ended: ${view.ended}` : view.paused ? "paused" : "running";
  $("mode").className = view.ended ? "badge" : view.paused ? "badge bad" : "badge good";
  $("clock").textContent = `${view.done} of ${view.of} places`;
  $("target").textContent = view.left_s === null || view.ended ? "" : `about ${span(view.left_s)} left`;
  $("next").textContent = `${span(view.worked_s)} at work`;
  const now = view.now;
  $("lab-now").textContent = now ? `${now.part.replaceAll("_", " ")}, ${now.place}: ${watts(now.power_w)}, range ${now.range.replace(/(\d)W$/, "$1 W")}` : "no reading yet";
  const last = L.places.at(-1);
  $("lab-steady").textContent = last ? `last place: ${last.place}, ${watts(last.mean_w)}, ${last.readings} readings, scatter ${percent(last.scatter)}` : "\u00a0";
  $("lab").setAttribute("aria-label", `curve of ${L.places.length} places; ${$("lab-now").textContent}`);
  $("lab-said").replaceChildren(...view.messages.slice(-50).reverse().map((text) => Object.assign(document.createElement("li"), { textContent: text })));
  $("pause").textContent = view.paused ? "Resume" : "Pause";
  for (const id of ["pause", "stop"]) $(id).disabled = Boolean(view.ended);
  redraw("lab");
}

export async function lab() {
  for (const panel of document.querySelectorAll("main > .panel")) panel.hidden = !panel.matches(".lab");
  document.body.classList.add("live", "lab-page");
  onToken(() => { $("steer").hidden = !token(); });
  for (const id of ["skip", "repeat"]) $(id).hidden = true;
  $("stop").textContent = "Stop the run";
  $("lab-log").addEventListener("change", () => redraw("lab"));
  setDraw("lab", drawLab);
  let failed = 0;
  for (;;) {
    const begun = performance.now();
    try {
      const view = await get(`lab?seen=${L.seen}&run=${L.run}`);
      if (failed) { failed = 0; notice(""); }
      if (view.run !== L.run) {
        // Another start of the program: what came is its curve from the beginning.
        const again = L.run !== 0;
        if (again) await about();
        Object.assign(L, { places: [], seen: 0, run: view.run });
        if (again) notice(`the program was started again: this is the new run${token() ? "" : ". To steer it, open the address that its start printed"}`);
      }
      L.places.push(...view.places);
      L.seen = view.last;
      S.live = { paused: view.paused };
      if (view.missed) notice(`${view.missed} places are not on this page (the run's folder has them)`);
      show(view);
      document.documentElement.dataset.ready = "yes";
      if (view.more) continue;
    } catch (error) {
      if (error.status === 401) {
        complain(error);
        await wakened(error);
        continue;
      }
      failed++;
      const over = L.view && (L.view.ended || L.view.done >= L.view.of);
      $("mode").textContent = over ? "ended" : "no connection";
      $("mode").className = over ? "badge" : "badge bad";
      if (!over || error instanceof Refused) complain(error);
    }
    const pause = failed ? Math.min(1000, 200 * failed) : document.hidden ? 1000 : 200;
    await new Promise((done) => setTimeout(done, Math.max(0, pause - (performance.now() - begun))));
  }
}
