// A night that is planned by hand: passes and stars, picked on the sky or from the list, in an order; saved as NIGHT.toml.
import { $, S, STROKES, Refused, ask, clamp, complain, css, fit, get, hertz, latest, lightColour, lineColour, loadSky, numbersOf, onToken, redraw, row, setDraw, span, swatchOf, theme, thickness, ticks, timeAxis, token, utc } from "./page.js";

const LEFT_OUT = 3;
const P = { picks: [], chosen: null, plan: null, saved: null, curves: null };
window.sunglint.planning = P;

const words = (pass) => `${pass.label}, ${utc(pass.from_s, 0)} to ${utc(pass.to_s, 0)}, V ${pass.v_mag.toFixed(1)}, up to ${Math.round(pass.highest_deg)}°`;

// What lies on the sky: tracks with a tick each minute, and a ring where the shadow begins or ends.
function overlay({ c, place, em }) {
  P.place = place;
  const picked = new Set(P.picks.filter((p) => "pass" in p).map((p) => p.pass));
  S.about.passes.forEach((pass, n) => {
    const faded = picked.size && !picked.has(n) && n !== P.chosen;
    c.globalAlpha = faded ? 0.45 : 1;
    for (let i = 1; i < pass.at_s.length; i++) {
      if (pass.at_deg[i][1] < 0 || pass.at_deg[i - 1][1] < 0) continue;
      const seen = pass.lit[i] && pass.lit[i - 1] && pass.dark[i];
      // As bright as it is there.
      const v = pass.v_at_mag[i] ?? 99;
      c.strokeStyle = lightColour(v);
      c.lineWidth = seen ? thickness(v) * (n === P.chosen ? 1.8 : 1) : 1;
      c.setLineDash(seen ? [] : [2, 4]);
      c.beginPath(); c.moveTo(...place(pass.at_deg[i - 1])); c.lineTo(...place(pass.at_deg[i])); c.stroke();
      if (pass.lit[i] !== pass.lit[i - 1]) {
        c.setLineDash([]);
        c.lineWidth = 1.5;
        c.strokeStyle = css("--ink");
        c.beginPath(); c.arc(...place(pass.at_deg[i]), 0.3 * em, 0, 7); c.stroke();
      }
    }
    c.setLineDash([]);
    c.lineWidth = 1;
    const phase = S.about.start_unix_ms / 1000;
    c.fillStyle = c.strokeStyle = css("--ink");
    // Each minute; of a slow one each fifth, tenth or thirtieth, so that ticks stay apart, and times only where there is room.
    const way = pass.at_deg.reduce((sum, at, i) => { if (!i) return 0; const [a, b] = [place(pass.at_deg[i - 1]), place(at)]; return sum + Math.hypot(a[0] - b[0], a[1] - b[1]); }, 0);
    const each = [60, 300, 600, 1800, 3600].find((s) => (way * s) / (pass.to_s - pass.from_s) > 6) ?? 7200;
    let told = null;
    for (let t = Math.ceil((pass.from_s + phase) / each) * each - phase; t < pass.to_s; t += each) {
      const at = where(pass, t);
      if (!at) continue;
      const [x, y] = place(at);
      c.beginPath(); c.arc(x, y, 1.8, 0, 7); c.fill();
      if (n !== P.chosen || (told && Math.abs(told[0] - x) < 3 * em && Math.abs(told[1] - y) < em)) continue;
      told = [x, y];
      c.fillText(utc(t, 0).slice(0, 5), x + 0.4 * em, y - 0.4 * em);
    }
    const now = where(pass, S.t);
    if (now) { c.fillStyle = css("--bad"); const [x, y] = place(now); c.beginPath(); c.arc(x, y, 0.35 * em, 0, 7); c.fill(); }
    c.globalAlpha = 1;
  });
  // Stars that are picked: a ring, with the place in the list.
  c.strokeStyle = c.fillStyle = css("--accent");
  P.picks.forEach((pick, i) => {
    const star = "star" in pick && S.sky?.stars.find((s) => s.plan_name === pick.star);
    if (!star) return;
    const [x, y] = place(star.at_deg);
    c.lineWidth = 1.5;
    c.beginPath(); c.arc(x, y, 0.5 * em, 0, 7); c.stroke();
    c.fillText(String(i + 1), x - 0.3 * em, y - 0.9 * em);
  });
}

// Where a pass is at a time, deg; null where it is not up.
function where(pass, t) {
  const i = pass.at_s.findIndex((s) => s >= t);
  if (i <= 0) return null;
  const part = (t - pass.at_s[i - 1]) / (pass.at_s[i] - pass.at_s[i - 1]);
  const [a, b] = [pass.at_deg[i - 1], pass.at_deg[i]];
  const turn = ((b[0] - a[0] + 540) % 360) - 180;
  return [a[0] + part * turn, a[1] + part * (b[1] - a[1])];
}

// What lies under the pointer: a star that a plan finds, or a pass.
function under(event) {
  if (!P.place) return null;
  const box = $("sky").getBoundingClientRect();
  const [x, y] = [event.clientX - box.left, event.clientY - box.top];
  const far = (at) => { const [px, py] = P.place(at); return Math.hypot(px - x, py - y); };
  let best = null;
  const offer = (distance, what) => { if (distance < 12 && (!best || distance < best.distance)) best = { distance, ...what }; };
  for (const star of S.sky?.stars ?? []) offer(far(star.at_deg), { star: star.plan_name });
  S.about.passes.forEach((pass, n) => pass.at_deg.forEach((at) => { if (at[1] > 0) offer(far(at), { pass: n }); }));
  return best;
}

const has = (pick) => P.picks.findIndex((p) => ("star" in pick ? p.star === pick.star : p.pass === pick.pass));

function add(pick) {
  if (has(pick) >= 0 && "pass" in pick) return;
  if ("pass" in pick) {
    // Passes keep the order of time.
    const from = S.about.passes[pick.pass].from_s;
    const at = P.picks.findIndex((p) => "pass" in p && S.about.passes[p.pass].from_s > from);
    P.picks.splice(at < 0 ? P.picks.length : at, 0, pick);
  } else P.picks.push(pick);
  changed();
}
function move(i, by) {
  const j = i + by;
  if (j < 0 || j >= P.picks.length) return;
  [P.picks[i], P.picks[j]] = [P.picks[j], P.picks[i]];
  changed();
}

function choose(n) {
  P.chosen = n;
  const pass = S.about.passes[n];
  $("pass-title").textContent = words(pass);
  $("pass-rates").replaceChildren(...pass.rates.map((rate) => row(
    rate.channel,
    rate.arriving === null ? "not known" : `${rate.arriving.toPrecision(3)} ${rate.unit}`,
    rate.counted_hz === null ? "–" : `${rate.counted_hz.toPrecision(3)} Hz`,
    rate.saturated ? "saturated" : "",
  )));
  const speeds = pass.speed_deg_per_s.filter((v) => v !== null);
  $("pass-speed").textContent = speeds.length ? `over the sky at ${Math.min(...speeds).toPrecision(2)} to ${Math.max(...speeds).toPrecision(2)} °/s` : "";
  P.curves = null;
  curves(n);
  $("pass-details").hidden = false;
  redraw("pass-curve");
  $("pass-add").disabled = has({ pass: n }) >= 0;
  seek(clamp((pass.from_s + pass.to_s) / 2, 0, S.about.length_s));
}

// The light of the chosen pass along its course.
const curves = latest(async (n) => {
  try {
    const found = await get(`curves?pass=${n}`);
    if (n !== P.chosen) return;
    P.curves = found;
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    complain(error);
  }
  const units = $("pass-unit");
  const known = (P.curves ?? []).filter((curve) => curve.arriving.some((v) => v !== null));
  const names = ["V", ...known.map((curve) => curve.unit)].filter((name, i, all) => all.indexOf(name) === i);
  const before = units.value;
  units.replaceChildren(...names.map((name) => Object.assign(document.createElement("option"), { value: name, textContent: name === "V" ? "V magnitude" : name })));
  if (names.includes(before)) units.value = before;
  redraw("pass-curve");
});

// Lines of the chart: V at the station, or the channels that have this unit; of a counter what it reports, dashed, too.
function lines() {
  const pass = S.about.passes[P.chosen];
  if ($("pass-unit").value !== "V" && P.curves) {
    const known = P.curves.filter((curve) => curve.unit === $("pass-unit").value && curve.arriving.some((v) => v !== null));
    return known.flatMap((curve, k) => [{ name: curve.channel, k, values: curve.arriving, saturated: curve.saturated }, ...(curve.counted_hz.some((v) => v !== null) ? [{ name: null, k, values: curve.counted_hz, saturated: [] }] : [])]);
  }
  return [{ name: "V", k: 0, values: pass.v_at_mag, saturated: [] }];
}

function drawPassCurve() {
  const pass = S.about.passes[P.chosen];
  if (!pass) return;
  const { c, w, h, em } = fit($("pass-curve"));
  const box = { l: 4.4 * em, r: w - 0.8 * em, t: 0.8 * em, b: h - 1.7 * em };
  const shown = lines();
  // Until the rates come the magnitudes are shown.
  const magnitudes = shown[0]?.name === "V";
  const points = shown.flatMap((line) => line.values.filter((v) => v !== null && (magnitudes || v > 0)));
  const [from, to] = [pass.at_s[0], pass.at_s.at(-1)];
  const x = (t) => box.l + ((t - from) / (to - from)) * (box.r - box.l);
  c.fillStyle = css("--soft");
  $("pass-curve").plot = null;
  $("pass-legend").replaceChildren();
  $("pass-curve").setAttribute("aria-label", "no light is expected of this pass");
  if (!points.length) { c.textBaseline = "middle"; c.fillText("no light is expected", box.l, h / 2); return; }
  const value = (v) => (magnitudes ? -v : Math.log10(v));
  let [low, high] = [Math.min(...points.map(value)), Math.max(...points.map(value))];
  // Near the horizon and near the shadow light goes to nothing: what is below a millionth of the highest is not drawn.
  low = Math.max(low, high - (magnitudes ? 15 : 6));
  const room = 0.06 * (high - low) || 0.1;
  [low, high] = [low - room, high + room];
  const y = (v) => box.b - ((value(v) - low) / (high - low)) * (box.b - box.t);
  // Where it cannot be seen: in the shadow, by day.
  c.fillStyle = css("--line");
  for (let i = 1; i < pass.at_s.length; i++) {
    if (pass.lit[i] && pass.lit[i - 1] && pass.dark[i]) continue;
    c.globalAlpha = 0.5;
    c.fillRect(x(pass.at_s[i - 1]), box.t, x(pass.at_s[i]) - x(pass.at_s[i - 1]), box.b - box.t);
    c.globalAlpha = 1;
  }
  timeAxis(c, [from, to], x, box, w, em);
  c.textBaseline = "middle";
  const marks = ticks(low, high, Math.max(2, (box.b - box.t) / (2.4 * em)));
  const written = numbersOf(marks);
  for (const v of marks) {
    const at = box.b - ((v - low) / (high - low)) * (box.b - box.t);
    c.beginPath(); c.moveTo(box.l, at); c.lineTo(box.r, at); c.stroke();
    const text = magnitudes ? written(v === 0 ? 0 : -v) : $("pass-unit").value === "Hz" ? hertz(10 ** v) : (10 ** v).toPrecision(2);
    c.fillText(text, box.l - c.measureText(text).width - 0.4 * em, at);
  }
  c.save();
  c.beginPath(); c.rect(box.l, box.t, box.r - box.l, box.b - box.t); c.clip();
  for (const line of shown) {
    c.strokeStyle = c.fillStyle = lineColour(line.k);
    c.lineWidth = 1.5;
    c.setLineDash(line.name === null ? [4, 3] : theme() === "red" ? STROKES[line.k % 4] : []);
    c.beginPath();
    let on = false;
    line.values.forEach((v, i) => {
      if (v === null || (!magnitudes && v <= 0)) { on = false; return; }
      on ? c.lineTo(x(pass.at_s[i]), y(v)) : c.moveTo(x(pass.at_s[i]), y(v));
      on = true;
    });
    c.stroke();
    c.setLineDash([]);
    // A thick line where a counter saturates.
    c.lineWidth = 5;
    c.globalAlpha = 0.4;
    c.beginPath();
    line.saturated.forEach((is, i) => { if (is && line.saturated[i - 1]) { c.moveTo(x(pass.at_s[i - 1]), y(line.values[i - 1])); c.lineTo(x(pass.at_s[i]), y(line.values[i])); } });
    c.stroke();
    c.globalAlpha = 1;
  }
  c.restore();
  if (S.t >= from && S.t <= to) {
    c.lineWidth = 1;
    c.strokeStyle = css("--ink");
    c.beginPath(); c.moveTo(x(S.t), box.t); c.lineTo(x(S.t), box.b); c.stroke();
  }
  $("pass-curve").plot = { from, to, l: box.l, r: box.r };
  const best = magnitudes ? `brightest V ${Math.min(...points).toFixed(1)}` : `up to ${Math.max(...points).toPrecision(3)} ${$("pass-unit").value}`;
  $("pass-curve").setAttribute("aria-label", `predicted light of ${words(pass)}: ${best}`);
  const known = shown.filter((line) => line.name !== null);
  $("pass-legend").replaceChildren(...known.map((line) => {
    const item = document.createElement("span");
    const swatch = document.createElement("span");
    swatch.className = "swatch";
    swatch.style.background = swatchOf(line.k);
    item.append(swatch, ` ${line.name === "V" ? "V at the station" : line.name}`);
    return item;
  }));
  if (shown.some((line) => line.name === null)) $("pass-legend").append(Object.assign(document.createElement("span"), { textContent: "dashed: as the counter reports it; thick: saturated" }));
}

const plan = latest(async (picks) => {
  try {
    P.plan = await ask("plan", { picks });
    // A night of many passes leaves most of them out: a few are told, the others in the pointer's text.
    const [told, more] = [P.plan.left_out.slice(0, LEFT_OUT), P.plan.left_out.slice(LEFT_OUT)];
    $("plan-why").textContent = [...P.plan.warnings, ...told.map((what) => `left out: ${what}`), ...(more.length ? [`and ${more.length} more are left out`] : [])].join(" · ");
    $("plan-why").title = more.join("\n");
    $("plan-save").disabled = false;
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    P.plan = null;
    $("plan-why").textContent = error.message;
    $("plan-save").disabled = true;
  }
  list();
  root();
});

function changed() {
  P.saved = null;
  $("plan-result").replaceChildren();
  if (P.chosen !== null) $("pass-add").disabled = has({ pass: P.chosen }) >= 0;
  list();
  redraw("sky");
  plan(P.picks);
}

// The visits with their times; where there is no plan the picks alone.
function list() {
  $("plan-title-line").textContent = P.picks.length ? `${P.picks.filter((p) => "pass" in p).length} passes, ${P.picks.filter((p) => "star" in p).length} stars` : "nothing picked: this is the night that the program would choose";
  $("picks").replaceChildren(...P.picks.map((pick, i) => {
    const li = document.createElement("li");
    const text = document.createElement("span");
    text.textContent = "star" in pick ? pick.star : words(S.about.passes[pick.pass]);
    li.append(text, ...[["↑", -1, "earlier"], ["↓", 1, "later"]].map(([sign, by, name]) => {
      const button = Object.assign(document.createElement("button"), { type: "button", textContent: sign, disabled: i + by < 0 || i + by >= P.picks.length });
      button.setAttribute("aria-label", `${text.textContent}: ${name}`);
      button.addEventListener("click", () => move(i, by));
      return button;
    }));
    const out = Object.assign(document.createElement("button"), { type: "button", textContent: "×" });
    out.setAttribute("aria-label", `leave out ${text.textContent}`);
    out.addEventListener("click", () => { P.picks.splice(i, 1); changed(); });
    li.append(out);
    return li;
  }));
  $("planned").tBodies[0].replaceChildren(...(P.plan?.visits ?? []).map((visit) => row(
    visit.name, visit.from_utc.slice(11, 19), span(visit.for_s), visit.altitude_deg === null ? "" : `${Math.round(visit.altitude_deg)}°`, visit.v_mag === null ? "" : visit.v_mag.toFixed(1),
  )));
}
const root = () => { document.documentElement.dataset.planned = String(P.picks.length); };

// Stars that are up at the time that is shown, the brightest first: whoever has no pointer picks them here.
let starsOf = "";
function listStars() {
  // Those that stand above what is about the station.
  const free = ({ at_deg: [azimuth, altitude] }) => altitude > S.sky.horizon_deg[Math.round(azimuth / 10) % 36];
  const stars = (S.sky?.stars ?? []).filter(free).sort((a, b) => a.v_mag - b.v_mag);
  const key = `${S.sky?.at_s} ${Boolean(token())}`;
  if (key === starsOf) return;
  starsOf = key;
  $("stars").tBodies[0].replaceChildren(...stars.map((star) => {
    const button = Object.assign(document.createElement("button"), { type: "button", textContent: star.plan_name });
    button.setAttribute("aria-label", `add ${star.plan_name}`);
    button.addEventListener("click", () => add({ star: star.plan_name }));
    return row(token() ? button : star.plan_name, `${Math.round(star.at_deg[1])}°`, `${Math.round(star.at_deg[0])}°`, star.v_mag.toFixed(1));
  }));
}
// Not while the time is being moved: a list that changes under the hand helps nobody.
let starsAt = 0;
function listStarsSoon() {
  clearTimeout(starsAt);
  starsAt = setTimeout(listStars, 250);
}

async function save() {
  try {
    const saved = await ask("save", { picks: P.picks }, { patience_ms: 60000 });
    P.saved = saved;
    const lines = [`saved: ${saved.files.join(", ")}`, saved.errors ? `the check finds ${saved.errors} error${saved.errors > 1 ? "s" : ""}` : "the check finds no error"];
    lines.push(...saved.check.findings.filter((f) => f.level === "error" || f.level === "warning").map((f) => `${f.level}: ${f.about}: ${f.text}`));
    $("plan-result").replaceChildren(...lines.map((text) => Object.assign(document.createElement("li"), { textContent: text })));
  } catch (error) { complain(error); }
}

function seek(t) {
  S.t = t;
  $("plan-time").value = String(t);
  $("plan-time").setAttribute("aria-valuetext", `${utc(t, 0)} UTC`);
  $("plan-at").textContent = `${utc(t, 0)} UTC`;
  $("clock").textContent = `${new Date(S.about.start_unix_ms + t * 1000).toISOString().slice(0, 10)} ${utc(t, 0)} UTC`;
  loadSky(t);
  redraw("sky");
  if (P.chosen !== null) redraw("pass-curve");
}

export async function planning() {
  for (const panel of document.querySelectorAll("main > .panel")) panel.hidden = !panel.matches(".sky, .planner");
  document.body.classList.add("plans");
  $("mode").textContent = "plan";
  $("target").textContent = `night at ${S.about.station}`;
  $("next").textContent = "";
  S.overlay = overlay;
  S.onSky = listStarsSoon;
  S.tracks = [];
  $("plan-time").max = String(S.about.length_s);
  $("plan-time").addEventListener("input", () => seek(Number($("plan-time").value)));
  $("passes").tBodies[0].replaceChildren(...S.about.passes.map((pass, n) => {
    const button = Object.assign(document.createElement("button"), { type: "button", textContent: pass.label });
    button.addEventListener("click", () => choose(n));
    return row(button, utc(pass.from_s, 0), span(pass.to_s - pass.from_s), `${Math.round(pass.highest_deg)}°`, pass.v_mag.toFixed(1));
  }));
  $("sky").addEventListener("click", (event) => {
    const what = under(event);
    if (!what) return;
    if ("pass" in what) choose(what.pass);
    else if (token()) add({ star: what.star });
  });
  $("sky").addEventListener("pointermove", (event) => {
    const what = under(event);
    $("sky").style.cursor = what ? "pointer" : "";
    $("sky-text").textContent = what ? ("pass" in what ? words(S.about.passes[what.pass]) : what.star) : "click a star to add it, a pass to see what it gives; north is up, east is left";
  });
  setDraw("pass-curve", drawPassCurve);
  $("pass-unit").addEventListener("change", () => redraw("pass-curve"));
  $("pass-curve").addEventListener("click", (event) => {
    const plot = $("pass-curve").plot;
    if (!plot) return;
    const at = event.clientX - $("pass-curve").getBoundingClientRect().left;
    seek(clamp(plot.from + ((at - plot.l) / (plot.r - plot.l)) * (plot.to - plot.from), plot.from, plot.to));
  });
  $("pass-add").addEventListener("click", () => add({ pass: P.chosen }));
  $("plan-clear").addEventListener("click", () => { P.picks = []; changed(); });
  $("plan-save").addEventListener("click", save);
  onToken(() => {
    for (const id of ["pass-add", "plan-save", "plan-clear"]) $(id).hidden = !token();
    if (token()) changed();
    else { list(); $("plan-why").textContent = "open the whole address that the start printed to make a plan"; }
    listStarsSoon();
  });
  const first = S.about.passes[0];
  seek(first ? first.from_s : S.about.length_s / 2);
  document.documentElement.dataset.ready = "yes";
}
