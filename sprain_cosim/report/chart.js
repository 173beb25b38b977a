"use strict";
// Draws the page's data as lines: choose what is shown, switch series, read values off at the pointer. No library.
(function () {
  const NS = "http://www.w3.org/2000/svg";
  const data = JSON.parse(document.getElementById("data").textContent);
  const make = (name, attributes, parent, text) => {
    const e = document.createElementNS(NS, name);
    for (const key in attributes) e.setAttribute(key, attributes[key]);
    if (text !== undefined) e.textContent = text;
    if (parent) parent.appendChild(e);
    return e;
  };
  const html = (name, parent, text, className) => {
    const e = document.createElement(name);
    if (text !== undefined) e.textContent = text;
    if (className) e.className = className;
    parent.appendChild(e);
    return e;
  };
  const number = (v) => (Math.abs(v) >= 1000 ? v.toFixed(0) : Math.abs(v) >= 100 ? v.toFixed(1) : v.toFixed(2)).replace(/^-(?=[0.]*$)/, "").replace("-", "\u2212");
  const step = (span) => {
    const raw = span / 5, power = Math.pow(10, Math.floor(Math.log10(raw)));
    return [1, 2, 5, 10].map((k) => k * power).find((s) => s >= raw);
  };
  // the marks of figures/style.py, 8 wide
  const MARKS = {
    o: "M4,0A4,4 0 1 1 -4,0A4,4 0 1 1 4,0Z", s: "M-3.5,-3.5H3.5V3.5H-3.5Z", "^": "M0,-4.5L4,3.5H-4Z", v: "M0,4.5L4,-3.5H-4Z",
    D: "M0,-4.8L4.8,0L0,4.8L-4.8,0Z", "<": "M-4.5,0L3.5,-4V4Z", ">": "M4.5,0L-3.5,-4V4Z",
    P: "M-1.5,-4.5H1.5V-1.5H4.5V1.5H1.5V4.5H-1.5V1.5H-4.5V-1.5H-1.5Z", X: "M-4,-2L-2,-4L0,-2L2,-4L4,-2L2,0L4,2L2,4L0,2L-2,4L-4,2L-2,0Z",
    "*": "M0,-5L1.5,-1.5L5,-1.5L2,1L3,4.5L0,2.5L-3,4.5L-2,1L-5,-1.5L-1.5,-1.5Z", p: "M0,-4.5L4.3,-1.4L2.6,3.6H-2.6L-4.3,-1.4Z",
    h: "M0,-4.5L3.9,-2.2V2.2L0,4.5L-3.9,2.2V-2.2Z",
  };
  const mark = (s, x, y, parent) => make("path", { d: MARKS[s.mark] || MARKS.o, transform: `translate(${x.toFixed(1)},${y.toFixed(1)})`, fill: s.color, class: "spot" }, parent);
  // y of a series at x: the last value at or before x for a distribution, else between the neighbours
  const at = (s, x, kind) => {
    let low = 0, high = s.x.length;
    while (low < high) { const mid = (low + high) >> 1; if (s.x[mid] <= x) low = mid + 1; else high = mid; }
    if (kind === "cdf") return low / s.x.length;
    if (low === 0 || low === s.x.length) return low ? (x > s.x[low - 1] ? null : s.y[low - 1]) : null;
    const t = (x - s.x[low - 1]) / (s.x[low] - s.x[low - 1]);
    return s.y[low - 1] + t * (s.y[low] - s.y[low - 1]);
  };

  for (const chart of data) {
    const box = document.getElementById(chart.id);
    const hidden = new Set();
    let choice = 0;
    if (chart.options.length > 1) {
      const select = html("select", html("label", box, "Show "), undefined);
      chart.options.forEach((o, k) => { html("option", select, o.label).value = k; });
      select.addEventListener("change", () => { choice = Number(select.value); draw(); });
    }
    const choices = html("div", box, undefined, "choices");
    const svg = make("svg", { role: "img", "aria-label": `${chart.title}. Left and right arrow keys read values off.`, tabindex: 0 }, box);
    const readout = html("p", box, chart.hint, "readout");
    readout.setAttribute("aria-live", "polite");
    let scale = null;

    const legend = () => {
      choices.textContent = "";
      chart.options[choice].series.forEach((s) => {
        const label = html("label", choices);
        const tick = html("input", label);
        tick.type = "checkbox";
        tick.checked = !hidden.has(s.name);
        tick.addEventListener("change", () => { if (tick.checked) hidden.delete(s.name); else hidden.add(s.name); plot(); });
        const swatch = make("svg", { viewBox: "0 0 36 12", class: "line", "aria-hidden": "true" }, label);
        make("path", { d: "M0,6H36", fill: "none", stroke: s.color, "stroke-width": 3, "stroke-dasharray": s.dash || "none" }, swatch);
        if (s.mark) mark(s, 18, 6, swatch);
        html("span", label, s.name);
      });
    };

    const plot = () => {
      const option = chart.options[choice];
      const shown = option.series.filter((s) => !hidden.has(s.name) && s.x.length);
      const W = Math.max(320, Math.min(1700, svg.clientWidth || 860)), H = Math.max(250, Math.min(420, 0.62 * W));
      const left = 58, right = 12, top = 12, bottom = 46;
      svg.textContent = "";
      readout.textContent = chart.hint + (option.hint || ""); // a value read off before belongs to other curves
      svg.setAttribute("viewBox", `0 0 ${W} ${H}`);
      svg.setAttribute("font-size", "13");
      scale = null;
      if (!shown.length) { make("text", { x: W / 2, y: H / 2, "text-anchor": "middle" }, svg, "nothing chosen"); return; }
      const marks = option.kind === "cdf" ? shown.flatMap((s) => s.marks || []) : [];
      const xs = shown.flatMap((s) => [s.x[0], s.x[s.x.length - 1]]).concat(marks.map((m) => m[0]));
      let x0 = Math.min(...xs), x1 = Math.max(...xs), y0 = 0, y1 = 1;
      if (option.kind !== "cdf") {
        y0 = Infinity; y1 = -Infinity;
        shown.forEach((s) => s.y.forEach((v) => { if (v < y0) y0 = v; if (v > y1) y1 = v; }));
        const pad = 0.05 * (y1 - y0) || 1; y0 -= pad; y1 += pad;
      } else { const pad = 0.03 * (x1 - x0) || 1; x0 -= pad; x1 += pad; }
      if (x1 === x0) x1 = x0 + 1;
      const X = (v) => left + (v - x0) / (x1 - x0) * (W - left - right), Y = (v) => H - bottom - (v - y0) / (y1 - y0) * (H - top - bottom);
      if (option.band) {
        const a = Math.max(option.band[0], x0), b = Math.min(option.band[1], x1);
        if (a < b) make("rect", { x: X(a), y: top, width: X(b) - X(a), height: H - top - bottom, fill: "#9aa5b1", "fill-opacity": 0.25 }, svg);
      }
      const sx = step(x1 - x0), sy = option.kind === "cdf" ? 0.25 : step(y1 - y0);
      for (let v = Math.ceil(x0 / sx) * sx; v <= x1 + 1e-9; v += sx) {
        make("line", { x1: X(v), x2: X(v), y1: top, y2: H - bottom, class: "grid" }, svg);
        make("text", { x: X(v), y: H - bottom + 17, "text-anchor": "middle", class: "ink" }, svg, String(+v.toFixed(6)).replace("-", "\u2212"));
      }
      for (let v = Math.ceil(y0 / sy) * sy; v <= y1 + 1e-9; v += sy) {
        make("line", { x1: left, x2: W - right, y1: Y(v), y2: Y(v), class: "grid" }, svg);
        const text = option.kind === "cdf" ? `${Math.round(100 * v)} %` : String(+v.toFixed(6)).replace("-", "\u2212");
        make("text", { x: left - 7, y: Y(v) + 4.5, "text-anchor": "end", class: "ink" }, svg, text);
      }
      make("text", { x: (left + W - right) / 2, y: H - 8, "text-anchor": "middle", class: "ink" }, svg, option.xlabel);
      for (const s of shown) {
        const n = s.x.length;
        let d = "";
        if (option.kind === "cdf") {
          d = `M${X(s.x[0]).toFixed(1)},${Y(0).toFixed(1)}`;
          s.x.forEach((v, k) => { d += `H${X(v).toFixed(1)}V${Y((k + 1) / n).toFixed(1)}`; });
        } else {
          s.x.forEach((v, k) => { d += `${k ? "L" : "M"}${X(v).toFixed(1)},${Y(s.y[k]).toFixed(1)}`; });
        }
        make("path", { d, fill: "none", stroke: s.color, "stroke-width": 2, "stroke-dasharray": s.dash || "none", class: "series" }, svg);
        if (s.mark) {
          const every = Math.max(1, Math.floor(n / 8));
          for (let k = Math.min(n - 1, every >> 1); k < n; k += every) mark(s, X(s.x[k]), Y(option.kind === "cdf" ? (k + 1) / n : s.y[k]), svg);
        }
      }
      marks.forEach((m) => make("circle", { cx: X(m[0]), cy: Y(m[1]), r: 5, fill: "none", class: "mark", "stroke-width": 1.4 }, svg));
      const cursor = make("line", { y1: top, y2: H - bottom, class: "cursor", visibility: "hidden" }, svg);
      scale = { option, shown, cursor, x0, x1, left, right, W, X };
    };

    const read = (event) => {
      if (!scale) return;
      const frame = svg.getBoundingClientRect(), pixel = (event.clientX - frame.left) * scale.W / frame.width;
      const x = scale.x0 + (pixel - scale.left) / (scale.W - scale.left - scale.right) * (scale.x1 - scale.x0);
      show(x);
    };
    const show = (x) => {
      if (x < scale.x0 || x > scale.x1) return;
      scale.x = x;
      scale.cursor.setAttribute("x1", scale.X(x));
      scale.cursor.setAttribute("x2", scale.X(x));
      scale.cursor.setAttribute("visibility", "visible");
      const words = scale.shown.map((s) => {
        const y = at(s, x, scale.option.kind);
        if (y === null) return `${s.name}: no value`;
        return scale.option.kind === "cdf" ? `${(100 * y).toFixed(1)} % of ${s.name} stay below` : `${s.name}: ${number(y)} ${scale.option.unit}`;
      });
      readout.textContent = `At ${number(x)} ${scale.option.xunit}: ${words.join(" · ")}`;
    };
    svg.addEventListener("pointermove", read);
    svg.addEventListener("pointerdown", read);
    svg.addEventListener("keydown", (event) => {
      const way = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
      if (!way || !scale) return;
      event.preventDefault();
      const { x0, x1, x = 0.5 * (x0 + x1) } = scale;
      show(Math.min(x1, Math.max(x0, x + way * (x1 - x0) / 100)));
    });

    const draw = () => { legend(); plot(); };
    draw();
    let width = svg.clientWidth;
    window.addEventListener("resize", () => { if (svg.clientWidth !== width) { width = svg.clientWidth; plot(); } });
  }
  document.querySelectorAll(".figures figure, .hero figure").forEach((figure) => {
    const grow = () => { figure.setAttribute("aria-expanded", String(figure.classList.toggle("large"))); figure.scrollIntoView({ block: "nearest" }); };
    figure.tabIndex = 0;
    figure.title = "Enlarge or shrink: click or Enter";
    figure.addEventListener("click", grow);
    figure.addEventListener("keydown", (event) => { if (event.key === "Enter") grow(); });
  });
  window.addEventListener("beforeprint", () => document.querySelectorAll("details").forEach((d) => { d.open = true; }));
})();
