"use strict";
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const numbers = data.pool.map((text) => {
    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    return new Float32Array(bytes.buffer);
  });
  const shown = data.channels.map(() => true);
  const LEFT = 66, RIGHT = 12, TOP = 8, BOTTOM = 40, HEIGHT = 250;
  const style = () => getComputedStyle(document.documentElement);
  const number = (v, digits) => {
    if (!isFinite(v)) return "–";
    if (v === 0) return "0";
    const a = Math.abs(v);
    if (a < 1e6 && a >= 1e-3) return String(Number(v.toPrecision(digits)));
    const [m, e] = v.toExponential(digits - 1).split("e");
    return `${Number(m)}e${Number(e)}`;
  };
  const utc = (ms) => (isFinite(ms) ? new Date(ms).toISOString().replace("Z", " UTC").replace("T", " ") : "");

  const ticks = (lo, hi, log, most) => {
    const out = [];
    if (log) {
      for (const steps of [[1, 2, 3, 5], [1, 3], [1]]) {
        out.length = 0;
        for (let k = Math.floor(Math.log10(lo)); k <= Math.ceil(Math.log10(hi)); k++)
          for (const m of steps) { const v = m * 10 ** k; if (v >= lo && v <= hi) out.push(v); }
        if (out.length >= 2 && out.length <= most) return out;
      }
      if (out.length >= 2) return out.filter((_, i) => i % Math.ceil(out.length / most) === 0);
      out.length = 0;
    }
    const raw = (hi - lo) / most, power = 10 ** Math.floor(Math.log10(raw));
    const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= raw) || 10 * power;
    for (let k = Math.ceil(lo / step); k * step <= hi * (1 + 1e-12); k++) out.push(Number((k * step).toPrecision(12)));
    return out;
  };
  const first = (xs, x) => {
    let a = 0, b = xs.length;
    while (a < b) { const m = (a + b) >> 1; if (xs[m] < x) a = m + 1; else b = m; }
    return a;
  };
  const nearest = (xs, x) => {
    const i = first(xs, x);
    if (i === 0) return 0;
    if (i === xs.length) return i - 1;
    return x - xs[i - 1] < xs[i] - x ? i - 1 : i;
  };

  class Chart {
    constructor(group, figure, own) {
      Object.assign(this, own);
      this.group = group;
      for (const line of this.lines) {
        line.x = numbers[line.x]; line.y = numbers[line.y];
        line.s = line.s === null ? null : numbers[line.s];
        const steps = [];
        for (let i = 1; i < line.x.length && steps.length < 2000; i++) if (line.x[i] > line.x[i - 1]) steps.push(line.x[i] - line.x[i - 1]);
        steps.sort((a, b) => a - b);
        line.gap = 5 * (steps[Math.floor(0.9 * steps.length)] || Infinity);
      }
      this.svg = figure.querySelector("svg");
      this.svg.classList.add("static");
      this.svg.style.display = "none";
      this.canvas = document.createElement("canvas");
      this.canvas.tabIndex = 0;
      this.canvas.setAttribute("role", "application");
      this.canvas.setAttribute("aria-label", `${this.title}: ${this.label}. Arrow keys move the read-out, plus and minus zoom, 0 shows all.`);
      figure.append(this.canvas);
      this.listen();
    }
    visible(line) { return line.channel === null || shown[line.channel]; }
    // The vertical range of what is in view; the given one while all of it is.
    extent() {
      const { from, to } = this.group.view, log = this.scale === "log";
      if (this.range && this.group.whole()) return this.range;
      let lo = Infinity, hi = -Infinity;
      const all = [];
      for (const line of this.lines) {
        if (!this.visible(line) || line.kind === "out") continue;
        for (let i = first(line.x, from); i < line.x.length && line.x[i] <= to; i++) {
          const y = line.y[i];
          if (!isFinite(y) || (log && y <= 0)) continue;
          if (this.range) all.push(y);
          if (y < lo) lo = y;
          if (y > hi) hi = y;
        }
      }
      if (all.length > 4) { all.sort((a, b) => a - b); const t = Math.floor(all.length * 0.01); lo = all[t]; hi = all[all.length - 1 - t]; }
      if (!(lo <= hi)) return this.range || (log ? [0.1, 1] : [0, 1]);
      if (log) return [Math.max(lo, 1e-6 * hi) / 1.3, hi * 1.3];
      const margin = 0.08 * Math.max(hi - lo, 1e-9 * Math.abs(hi), 1e-12);
      return [lo - margin, hi + margin];
    }
    place() {
      const width = this.canvas.clientWidth, { from, to } = this.group.view;
      const [lo, hi] = this.extent(), log = this.scale === "log", of = (v) => (log ? Math.log10(v) : v);
      const a = of(lo), b = of(hi), height = HEIGHT - TOP - BOTTOM;
      this.x = (x) => LEFT + ((width - LEFT - RIGHT) * (x - from)) / (to - from);
      this.back = (px) => from + ((to - from) * (px - LEFT)) / (width - LEFT - RIGHT);
      this.y = (y) => { const f = (of(y) - a) / (b - a); return TOP + height * (this.scale === "inverted" ? f : 1 - f); };
      return { lo, hi, log, width };
    }
    draw() {
      const ratio = window.devicePixelRatio || 1, width = this.canvas.clientWidth;
      if (!width) return;
      if (this.canvas.width !== Math.round(width * ratio)) {
        this.canvas.width = Math.round(width * ratio);
        this.canvas.height = Math.round(HEIGHT * ratio);
        this.canvas.style.height = HEIGHT + "px";
      }
      const css = style(), colour = (name) => css.getPropertyValue(name).trim(), c = this.canvas.getContext("2d");
      c.setTransform(ratio, 0, 0, ratio, 0, 0);
      c.clearRect(0, 0, width, HEIGHT);
      const { lo, hi, log } = this.place(), right = width - RIGHT, bottom = HEIGHT - BOTTOM;
      c.font = "11px system-ui, sans-serif";
      c.lineWidth = 1;
      c.strokeStyle = colour("--faint");
      c.fillStyle = colour("--soft");
      c.textAlign = "center";
      const { from, to } = this.group.view;
      for (const t of ticks(from, to, false, Math.max(3, Math.floor(width / 95)))) {
        const x = this.x(t);
        c.beginPath(); c.moveTo(x, TOP); c.lineTo(x, bottom); c.stroke();
        c.fillText(number(t, 8), x, bottom + 15);
      }
      c.textAlign = "right";
      for (const t of ticks(lo, hi, log, 6)) {
        const y = this.y(t);
        c.beginPath(); c.moveTo(LEFT, y); c.lineTo(right, y); c.stroke();
        c.fillText(number(t, 6), LEFT - 6, y + 4);
      }
      c.save();
      c.beginPath(); c.rect(LEFT, TOP, right - LEFT, bottom - TOP); c.clip();
      if (this.rule !== null) {
        c.strokeStyle = colour("--ink"); c.globalAlpha = 0.55; c.setLineDash([4, 4]);
        c.beginPath(); c.moveTo(LEFT, this.y(this.rule)); c.lineTo(right, this.y(this.rule)); c.stroke();
        c.setLineDash([]); c.globalAlpha = 1;
      }
      for (const kind of ["out", "dots", "line"]) for (const line of this.lines) if (line.kind === kind && this.visible(line)) this.stroke(c, line, colour, log, bottom);
      const at = this.group.cursor;
      if (at !== null) {
        c.strokeStyle = colour("--soft");
        c.beginPath(); c.moveTo(this.x(at), TOP); c.lineTo(this.x(at), bottom); c.stroke();
      }
      if (this.group.drag) {
        const [p, q] = this.group.drag.map((v) => this.x(v));
        c.fillStyle = colour("--accent"); c.globalAlpha = 0.16;
        c.fillRect(Math.min(p, q), TOP, Math.abs(q - p), bottom - TOP);
        c.globalAlpha = 1;
      }
      c.restore();
      c.strokeStyle = colour("--soft");
      c.beginPath(); c.moveTo(LEFT, TOP); c.lineTo(LEFT, bottom); c.lineTo(right, bottom); c.stroke();
      c.fillStyle = colour("--ink");
      c.textAlign = "center";
      c.fillText(this.group.label, (LEFT + right) / 2, HEIGHT - 6);
      c.save(); c.translate(13, (TOP + bottom) / 2); c.rotate(-Math.PI / 2); c.fillText(this.label, 0, 0); c.restore();
    }
    stroke(c, line, colour, log, bottom) {
      const { from, to } = this.group.view, hue = line.channel === null ? line.hue : data.channels[line.channel].hue;
      const start = Math.max(0, first(line.x, from) - 1), ink = colour(`--h${hue}`);
      let many = 0;
      for (let i = start; i < line.x.length && line.x[i] <= to; i++) many++;
      c.strokeStyle = c.fillStyle = ink;
      if (line.kind === "line") {
        // A line over dots of its own colour stands out by an edge of paper.
        for (const [width, paint, alpha] of [[3.4, colour("--bg"), 0.75], [1.6, ink, 1]]) {
          c.lineWidth = width; c.strokeStyle = paint; c.globalAlpha = alpha; c.lineJoin = "round";
          c.beginPath();
          let before = null;
          for (let i = start; i < line.x.length; i++) {
            const y = line.y[i];
            if (!isFinite(y) || (log && y <= 0)) { before = null; continue; }
            const px = this.x(line.x[i]), py = this.y(y);
            if (before !== null && line.x[i] - before <= line.gap) c.lineTo(px, py); else c.moveTo(px, py);
            before = line.x[i];
            if (line.x[i] > to) break;
          }
          c.stroke();
        }
        return;
      }
      const size = many > 4000 ? 1.6 : many > 800 ? 2.2 : 3.2;
      c.globalAlpha = line.kind === "out" ? 0.5 : many > 1500 ? 0.55 : 0.9;
      c.lineWidth = 1;
      for (let i = start; i < line.x.length && line.x[i] <= to; i++) {
        const y = line.y[i], px = this.x(line.x[i]);
        if (!isFinite(y)) continue;
        if (log && y <= 0) { c.fillRect(px - 0.5, bottom - 5, 1, 5); continue; }
        const py = this.y(y);
        if (line.kind === "out") { c.strokeRect(px - 2, py - 2, 4, 4); continue; }
        if (many < 160 && line.s && isFinite(line.s[i])) {
          const low = y - line.s[i];
          c.beginPath(); c.moveTo(px, log && low <= 0 ? bottom : this.y(low)); c.lineTo(px, this.y(y + line.s[i])); c.stroke();
        }
        c.fillRect(px - size / 2, py - size / 2, size, size);
      }
      c.globalAlpha = 1;
    }
    listen() {
      const canvas = this.canvas, group = this.group;
      const at = (event) => this.back(event.clientX - canvas.getBoundingClientRect().left);
      canvas.addEventListener("pointermove", (event) => {
        if (group.drag) group.drag[1] = at(event);
        group.point(at(event));
      });
      canvas.addEventListener("pointerdown", (event) => {
        if (event.button !== 0) return;
        canvas.focus({ preventScroll: true });
        if (event.pointerType !== "touch") { canvas.setPointerCapture(event.pointerId); group.drag = [at(event), at(event)]; }
        group.point(at(event));
      });
      canvas.addEventListener("pointerup", (event) => {
        const drag = group.drag;
        group.drag = null;
        if (drag && Math.abs(this.x(drag[1]) - this.x(drag[0])) > 6) group.zoom(Math.min(...drag), Math.max(...drag)); else group.redraw();
      });
      canvas.addEventListener("pointercancel", () => { group.drag = null; group.redraw(); });
      canvas.addEventListener("dblclick", () => group.reset());
      canvas.addEventListener("wheel", (event) => {
        // A page that scrolls is not held up by a chart that nobody asked.
        if (document.activeElement !== canvas && !event.ctrlKey) return;
        event.preventDefault();
        group.scale(Math.exp(0.0016 * event.deltaY), at(event));
      }, { passive: false });
      canvas.addEventListener("keydown", (event) => {
        const { from, to } = group.view, step = (event.shiftKey ? 0.1 : 0.01) * (to - from), middle = (from + to) / 2;
        const cursor = group.cursor === null ? middle : group.cursor;
        if (event.key === "ArrowRight" || event.key === "ArrowLeft") {
          const next = Math.min(group.to, Math.max(group.from, cursor + (event.key === "ArrowRight" ? step : -step)));
          if (next < from || next > to) group.zoom(from + next - cursor, to + next - cursor);
          group.point(next);
        } else if (event.key === "+" || event.key === "=") group.scale(0.6, cursor);
        else if (event.key === "-") group.scale(1 / 0.6, cursor);
        else if (event.key === "0" || event.key === "Escape") group.reset();
        else if (event.key === "Home") group.point(from);
        else if (event.key === "End") group.point(to);
        else return;
        event.preventDefault();
      });
    }
  }

  class Group {
    constructor(element, own) {
      Object.assign(this, { label: own.label, start: own.start, from: own.from, to: own.to > own.from ? own.to : own.from + 1 });
      this.element = element;
      this.view = { from: this.from, to: this.to };
      this.cursor = null;
      this.drag = null;
      element.querySelectorAll(".live").forEach((e) => { e.hidden = false; });
      this.readout = element.querySelector(".readout");
      this.button = element.querySelector(".reset");
      this.button.addEventListener("click", () => this.reset());
      this.button.disabled = true;
      const figures = [...element.querySelectorAll("figure")];
      this.charts = own.charts.map((chart, i) => new Chart(this, figures[i], chart));
      this.readout.textContent = "Move over a chart to read its values.";
    }
    whole() { return this.view.from <= this.from && this.view.to >= this.to; }
    zoom(from, to) {
      const least = 1e-5 * (this.to - this.from), width = Math.min(this.to - this.from, Math.max(least, to - from));
      const start = Math.min(Math.max(from, this.from), this.to - width);
      this.view = { from: start, to: start + width };
      this.button.disabled = this.whole();
      this.redraw();
    }
    scale(factor, around) {
      const { from, to } = this.view;
      this.zoom(around - (around - from) * factor, around + (to - around) * factor);
    }
    reset() { this.zoom(this.from, this.to); }
    point(x) {
      this.cursor = Math.min(this.to, Math.max(this.from, x));
      this.read();
      this.redraw();
    }
    read() {
      const put = (parent, tag, text, name) => {
        const e = document.createElement(tag);
        if (name) e.className = name;
        if (text !== null) e.textContent = text;
        parent.append(e);
        return e;
      };
      this.readout.replaceChildren();
      put(this.readout, "b", `${number(this.cursor, 6)} s`);
      this.readout.append(this.start === null ? " " : `  ${utc(this.start + 1000 * this.cursor)} `);
      put(this.readout, "br", null);
      const reach = 0.03 * (this.view.to - this.view.from);
      const values = (line) => {
        const i = nearest(line.x, this.cursor);
        return line.x.length && Math.abs(line.x[i] - this.cursor) <= Math.max(reach, line.gap) ? [line.y[i], line.s ? line.s[i] : NaN] : null;
      };
      const rates = this.charts[0].lines;
      data.channels.forEach((channel, c) => {
        if (!shown[c]) return;
        const of = (kind) => rates.find((l) => l.channel === c && l.kind === kind);
        const m = of("dots") && values(of("dots")), s = of("line") && values(of("line"));
        if (!m && !s) return;
        const span = put(this.readout, "span", null);
        put(span, "i", "", `h${channel.hue}`);
        put(span, "b", channel.name);
        const sigma = m && isFinite(m[1]) ? ` ± ${number(m[1], 2)}` : "";
        span.append(` ${m ? number(m[0], 4) + sigma : "–"} / ${s ? number(s[0], 4) : "–"}`);
      });
      for (const chart of this.charts.slice(1)) for (const line of chart.lines) {
        if (line.channel !== null || line.kind !== "line") continue;
        const v = values(line);
        if (v) { const span = put(this.readout, "span", null); span.append(`${line.name} `); put(span, "b", number(v[0], 5)); }
      }
    }
    redraw() {
      if (this.waiting) return;
      this.waiting = true;
      requestAnimationFrame(() => { this.waiting = false; this.charts.forEach((chart) => chart.draw()); });
    }
  }

  document.querySelectorAll(".how .live").forEach((e) => { e.hidden = false; });
  const groups = [...document.querySelectorAll(".group")].map((e, i) => new Group(e, data.groups[i]));
  const all = () => groups.forEach((group) => group.redraw());
  document.querySelectorAll(".key input").forEach((box) => {
    box.disabled = false;
    box.checked = true;
    box.addEventListener("change", () => {
      const channel = Number(box.dataset.channel);
      shown[channel] = box.checked;
      document.querySelectorAll(`.ch${channel}`).forEach((e) => e.classList.toggle("off", !box.checked));
      groups.forEach((group) => group.cursor !== null && group.read());
      all();
    });
  });
  new ResizeObserver(all).observe(document.body);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", all);
  all();
})();
