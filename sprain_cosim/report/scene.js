"use strict";
// The landing to turn: two views with one camera, drawn with plain WebGL. No library; what it needs is one shader, round
// cones, a box, arrows. Where a browser has no WebGL, the film's frame stays.
(function () {
  const place = document.getElementById("stage"), source = document.getElementById("scene");
  if (!place || !source) return;
  const scene = JSON.parse(source.textContent);
  const VERTEX = `
    attribute vec3 position, normal, colour; attribute float body;
    uniform vec4 origins[8], turns[8]; uniform mat4 view; uniform vec3 pivot; uniform vec2 tilt; uniform float shadow;
    varying vec3 n, c, p; varying vec3 on;
    vec3 turned(vec4 q, vec3 v) { return v + 2.0 * cross(q.xyz, cross(q.xyz, v) + q.w * v); }
    vec3 level(vec3 v) { v -= pivot; return vec3(v.x, tilt.x * v.y + tilt.y * v.z, -tilt.y * v.y + tilt.x * v.z); }
    void main() {
      int k = int(body + 0.5);
      vec4 q = vec4(0.0, 0.0, 0.0, 1.0); vec3 o = vec3(0.0);
      for (int i = 0; i < 8; i++) if (i == k) { q = turns[i]; o = origins[i].xyz; }
      p = turned(q, position) + o; n = turned(q, normal); c = colour;
      on = vec3(0.0);
      if (shadow > 0.5) {
        float high = level(p).y / tilt.x;
        p.y -= high; on = level(p); on.y = high; p += 0.0015 * vec3(0.0, tilt.x, tilt.y);
      }
      gl_Position = view * vec4(p, 1.0);
    }`;
  const FRAGMENT = `
    precision highp float;
    varying vec3 n, c, p; varying vec3 on;
    uniform vec3 eye, half_, edge; uniform float shadow, alpha, flat_;
    void main() {
      if (shadow > 0.5) {
        if (abs(on.x) > half_.x || abs(on.z) > half_.z || dot(on.xz, edge.xy) > edge.z || on.y < -0.03 || on.y > 0.35) discard;
        gl_FragColor = vec4(0.08, 0.10, 0.14, 0.30 * exp(-5.0 * max(on.y, 0.0))); return;
      }
      vec3 m = normalize(n), to = normalize(eye - p), light = normalize(vec3(-0.45, 0.80, -0.40));
      float lit = 0.5 + 0.5 * dot(m, light), rim = max(dot(m, to), 0.0);
      vec3 colour = c * mix(0.60 + 0.44 * lit * sqrt(lit), 1.0, flat_) * mix(0.80 + 0.20 * sqrt(rim), 1.0, flat_);
      float shine = pow(max(dot(m, normalize(light + to)), 0.0), 40.0) * 0.14 * (1.0 - flat_);
      gl_FragColor = vec4(colour + shine, alpha < 1.0 ? mix(min(1.0, 2.3 * alpha), alpha, rim) : 1.0);
    }`;

  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
  const along = (a, s, b) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const size = (a) => Math.sqrt(dot(a, a));
  const unit = (a) => { const s = size(a) || 1; return [a[0] / s, a[1] / s, a[2] / s]; };
  const beside = (d) => unit(cross(d, Math.abs(d[1]) < 0.9 ? [0, 1, 0] : [1, 0, 0]));

  // a mesh that grows: 10 numbers a vertex (place, normal, colour, body), triangles of indices
  const mesh = () => ({ v: [], i: [] });
  // a surface of revolution from `from` along `d`: rows of [distance, radius, slope of the normal along d]
  function revolve(m, from, d, rows, rgb, body, around) {
    const u = beside(d), w = cross(d, u), first = m.v.length / 10;
    rows.forEach(([s, r, lean]) => {
      const out = Math.sqrt(Math.max(0, 1 - lean * lean));
      for (let k = 0; k <= around; k++) {
        const t = 2 * Math.PI * k / around, e = along([u[0] * Math.cos(t), u[1] * Math.cos(t), u[2] * Math.cos(t)], Math.sin(t), w);
        const x = along(along(from, s, d), r, e), n = along([out * e[0], out * e[1], out * e[2]], lean, d);
        m.v.push(x[0], x[1], x[2], n[0], n[1], n[2], rgb[0], rgb[1], rgb[2], body);
      }
    });
    for (let row = 0; row + 1 < rows.length; row++)
      for (let k = 0; k < around; k++) {
        const a = first + row * (around + 1) + k, b = a + around + 1;
        m.i.push(a, b, a + 1, a + 1, b, b + 1);
      }
  }
  // two balls and the cone that touches both
  function roundCone(m, body, [ax, ay, az, bx, by, bz, ra, rb], rgb) {
    const a = [ax, ay, az], b = [bx, by, bz], long = size(minus(b, a));
    const d = long > 1e-9 ? unit(minus(b, a)) : [0, 1, 0], rows = [], RING = 5;
    const lean = long > Math.abs(ra - rb) ? Math.asin((ra - rb) / long) : ra > rb ? Math.PI / 2 : -Math.PI / 2;
    for (let k = 0; k <= RING; k++) {
      const t = -Math.PI / 2 + (lean + Math.PI / 2) * k / RING;
      rows.push([ra * Math.sin(t), ra * Math.cos(t), Math.sin(t)]);
    }
    for (let k = 0; k <= RING; k++) {
      const t = lean + (Math.PI / 2 - lean) * k / RING;
      rows.push([long + rb * Math.sin(t), rb * Math.cos(t), Math.sin(t)]);
    }
    revolve(m, a, d, rows, rgb, body, 16);
  }
  // the platform: `outline` [x, z] of its upper face, `deep` below it
  function slab(m, outline, deep, rgb, body) {
    const face = (places, n) => {
      const first = m.v.length / 10;
      for (const x of places) m.v.push(...x, ...n, ...rgb, body);
      for (let k = 1; k + 1 < places.length; k++) m.i.push(first, first + k, first + k + 1);
    };
    face(outline.map(([x, z]) => [x, 0, z]), [0, 1, 0]);
    face(outline.map(([x, z]) => [x, -deep, z]), [0, -1, 0]);
    outline.forEach(([x, z], k) => {
      const [p, q] = outline[(k + 1) % outline.length];
      face([[x, 0, z], [p, 0, q], [p, -deep, q], [x, -deep, z]], unit([q - z, 0, x - p]));
    });
  }
  function arrow(m, from, to, thick, rgb) {
    const way = minus(to, from), long = size(way), d = unit(way), head = Math.min(4.5 * thick, 0.7 * long);
    if (long < 1e-4) return;
    revolve(m, from, d, [[0, 0, -1], [0, thick, -1], [0, thick, 0], [long - head, thick, 0]], rgb, 7, 12);
    revolve(m, from, d, [[long - head, 0, -1], [long - head, 2.4 * thick, -1], [long - head, 2.4 * thick, 0.45], [long, 0, 0.45]], rgb, 7, 14);
  }
  // an arc of `turn` [rad] about the axis `d` through `c`, its middle on top, with a head where it ends
  function arc(m, c, d, radius, turn, thick, rgb) {
    if (Math.abs(turn) < 0.05) return;
    const up = along([0, 1, 0], -d[1], d), u = size(up) > 0.1 ? unit(up) : beside(d), w = cross(d, u), N = 28, A = 8, first = m.v.length / 10;
    const at = (t) => along(along(c, radius * Math.cos(t), u), radius * Math.sin(t), w);
    for (let k = 0; k <= N; k++) {
      const t = turn * (k / N - 0.5), x = at(t), out = unit(minus(x, c));
      for (let j = 0; j <= A; j++) {
        const f = 2 * Math.PI * j / A, n = along([out[0] * Math.cos(f), out[1] * Math.cos(f), out[2] * Math.cos(f)], Math.sin(f), d), y = along(x, thick, n);
        m.v.push(...y, ...n, ...rgb, 7);
      }
    }
    for (let k = 0; k < N; k++) for (let j = 0; j < A; j++) { const a = first + k * (A + 1) + j, b = a + A + 1; m.i.push(a, b, a + 1, a + 1, b, b + 1); }
    const sign = Math.sign(turn), end = at(0.5 * turn), next = at(0.5 * turn + sign * 5 * thick / radius);
    const way = unit(minus(next, end)), long = size(minus(next, end));
    revolve(m, end, way, [[0, 0, -1], [0, 2.5 * thick, -1], [0, 2.5 * thick, 0.45], [long, 0, 0.45]], rgb, 7, 12);
  }

  const landings = scene.landings.map((l) => {
    const bytes = Uint8Array.from(atob(l.data), (c) => c.charCodeAt(0)), table = new Float32Array(bytes.buffer), wide = table.length / l.steps;
    const row = (t) => { // all numbers at the time t [s], between two of the record
      const at = Math.min(l.steps - 1, Math.max(0, t / l.step)), k = Math.min(l.steps - 2, Math.floor(at)), part = at - k, out = new Float32Array(wide);
      for (let c = 0; c < wide; c++) out[c] = (1 - part) * table[k * wide + c] + part * table[(k + 1) * wide + c];
      return out;
    };
    return { ...l, row, end: (l.steps - 1) * l.step };
  });
  const END = Math.max(...landings.map((l) => l.end));
  const camera = { around: 0.35, up: 0.16, far: 0.82, target: [0, 0, 0] };
  const first = landings[scene.shown[0]], state = { time: first.peak * first.step, playing: false, glass: true, views: [] };
  const VIEWS = { ankle: [0.35, 0.16, 0.82], back: [0, 0.05, 0.82], side: [Math.PI / 2, 0.05, 0.82], body: [0.35, 0.1, 3.2] };

  function viewMatrix(aspect, target, far) {
    const e = [-Math.cos(camera.up) * Math.cos(camera.around), Math.sin(camera.up), Math.cos(camera.up) * Math.sin(camera.around)];
    const distance = 2.1 * far * Math.max(1, 0.8 / aspect), eye = along(target, distance, e), z = e, x = unit(cross([0, 1, 0], z)), y = cross(z, x);
    const f = 1 / Math.tan(0.5 * 0.32), near = 0.05 * distance, last = distance + 6, a = (last + near) / (near - last), b = 2 * last * near / (near - last);
    const r = [x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2]], t = [-dot(x, eye), -dot(y, eye), -dot(z, eye)], s = f / aspect;
    return { eye, m: new Float32Array([s * r[0], f * r[1], a * r[2], -r[2], s * r[3], f * r[4], a * r[5], -r[5], s * r[6], f * r[7], a * r[8], -r[8], s * t[0], f * t[1], a * t[2] + b, -t[2]]) };
  }

  class View {
    constructor(holder, index) {
      this.canvas = document.createElement("canvas");
      this.gl = this.canvas.getContext("webgl", { antialias: true, stencil: true, alpha: true, preserveDrawingBuffer: true });
      if (!this.gl) throw new Error("no WebGL");
      this.canvas.tabIndex = 0;
      this.canvas.setAttribute("role", "img");
      const gl = this.gl, program = gl.createProgram();
      for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
        const shader = gl.createShader(kind);
        gl.shaderSource(shader, text); gl.compileShader(shader); gl.attachShader(program, shader);
        if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      }
      ["position", "normal", "colour", "body"].forEach((name, k) => gl.bindAttribLocation(program, k, name));
      gl.linkProgram(program);
      if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
      gl.useProgram(program);
      this.at = (name) => gl.getUniformLocation(program, name);
      holder.appendChild(this.canvas);
      this.moving = { v: gl.createBuffer(), i: gl.createBuffer(), count: 0 };
      this.choose(index);
    }
    upload(m, into) {
      const gl = this.gl, target = into || { v: gl.createBuffer(), i: gl.createBuffer() }, use = into ? gl.DYNAMIC_DRAW : gl.STATIC_DRAW;
      gl.bindBuffer(gl.ARRAY_BUFFER, target.v); gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(m.v), use);
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, target.i); gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, new Uint16Array(m.i), use);
      target.count = m.i.length;
      return target;
    }
    choose(index) {
      const l = this.landing = landings[index], groups = { far: mesh(), glass: mesh(), sole: mesh(), bone: mesh(), cuff: mesh() }, floor = mesh();
      for (const [body, group, ends, rgb] of l.shapes) roundCone(groups[group], body, ends, rgb);
      slab(floor, l.outline, 2 * scene.half[1], scene.platform, 6);
      for (const old of Object.values(this.groups || {})) { this.gl.deleteBuffer(old.v); this.gl.deleteBuffer(old.i); }
      this.groups = { floor: this.upload(floor) };
      for (const key in groups) this.groups[key] = this.upload(groups[key]);
      this.accent = [1, 3, 5].map((k) => parseInt(l.colour.slice(k, k + 2), 16) / 255);
    }
    draw() {
      const gl = this.gl, l = this.landing, ratio = Math.min(2, window.devicePixelRatio || 1);
      const W = Math.round(this.canvas.clientWidth * ratio), H = Math.round(this.canvas.clientHeight * ratio);
      if (!W || !H) return;
      if (this.canvas.width !== W || this.canvas.height !== H) { this.canvas.width = W; this.canvas.height = H; }
      const now = l.row(state.time), b = 7 * l.bodies, get = (k) => [now[k], now[k + 1], now[k + 2]];
      const ankle = get(b), axis = unit(get(b + 3)), force = get(b + 6), point = get(b + 9), angle = now[b + 12], anatomy = now[b + 13], brace = now[b + 14];
      const origins = new Float32Array(32), turns = new Float32Array(32);
      for (let k = 0; k < l.bodies; k++) {
        const q = [0, 1, 2, 3].map((j) => now[7 * k + 3 + j]), s = Math.hypot(...q);
        for (let j = 0; j < 3; j++) origins[4 * k + j] = now[7 * k + j];
        for (let j = 0; j < 4; j++) turns[4 * k + j] = q[j] / s;
      }
      for (let j = 0; j < 3; j++) origins[24 + j] = l.pivot[j];
      turns[24] = Math.sin(0.5 * l.tilt); turns[27] = Math.cos(0.5 * l.tilt); turns[31] = 1;
      const pulled = mesh(), longest = 0.5, long = size(force) * scene.newton, shrink = Math.min(1, longest / (long || 1));
      if (long > 0.005) arrow(pulled, point, along(point, scene.newton * shrink, force), 0.006, scene.colours.force);
      const toward = axis.map((c) => -c); // a positive moment resists supination: it turns the foot back
      arc(pulled, ankle, toward, 0.085, Math.max(-5, Math.min(5, scene.radian * anatomy)), 0.0045, scene.colours.anatomy);
      if (l.braced) arc(pulled, ankle, toward, 0.11, Math.max(-5, Math.min(5, scene.radian * brace)), 0.0045, this.accent);
      this.upload(pulled, this.moving);

      const zoomed = camera.far > 1.8, target = zoomed ? [l.pivot[0], l.pivot[1] + 0.85, l.pivot[2]] : [l.pivot[0], l.pivot[1] + 0.13, l.pivot[2]];
      const { m, eye } = viewMatrix(W / H, along(target, 1, camera.target), camera.far);
      gl.viewport(0, 0, W, H); gl.clearColor(0, 0, 0, 0); gl.clearStencil(0);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT | gl.STENCIL_BUFFER_BIT);
      gl.enable(gl.DEPTH_TEST); gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
      gl.uniformMatrix4fv(this.at("view"), false, m); gl.uniform4fv(this.at("origins"), origins); gl.uniform4fv(this.at("turns"), turns);
      gl.uniform3fv(this.at("eye"), eye); gl.uniform3fv(this.at("half_"), scene.half); gl.uniform3fv(this.at("pivot"), l.pivot); gl.uniform3fv(this.at("edge"), l.edge);
      gl.uniform2f(this.at("tilt"), Math.cos(l.tilt), Math.sin(l.tilt));
      const pass = (group, alpha, shadow, flat) => {
        if (!group.count) return;
        gl.uniform1f(this.at("alpha"), alpha); gl.uniform1f(this.at("shadow"), shadow ? 1 : 0); gl.uniform1f(this.at("flat_"), flat || 0);
        gl.bindBuffer(gl.ARRAY_BUFFER, group.v); gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, group.i);
        [[0, 3, 0], [1, 3, 12], [2, 3, 24], [3, 1, 36]].forEach(([k, n, offset]) => { gl.enableVertexAttribArray(k); gl.vertexAttribPointer(k, n, gl.FLOAT, false, 40, offset); });
        gl.drawElements(gl.TRIANGLES, group.count, gl.UNSIGNED_SHORT, 0);
      };
      const g = this.groups, glass = state.glass;
      pass(g.floor, 1);
      gl.enable(gl.BLEND); gl.enable(gl.STENCIL_TEST); gl.stencilFunc(gl.EQUAL, 0, 255); gl.stencilOp(gl.KEEP, gl.KEEP, gl.INCR); gl.depthMask(false);
      [g.glass, g.sole, g.cuff].concat(zoomed ? [g.far] : []).forEach((group) => pass(group, 1, true));
      gl.disable(gl.STENCIL_TEST); gl.depthMask(true); gl.disable(gl.BLEND);
      if (zoomed) pass(g.far, 1);
      pass(this.moving, 1, false, 0.55);
      if (glass) pass(g.bone, 1);
      const clear = (group, alpha) => { // only the nearest of a group's surfaces is seen through
        gl.colorMask(false, false, false, false); pass(group, 1); gl.colorMask(true, true, true, true);
        gl.enable(gl.BLEND); gl.depthFunc(gl.LEQUAL); pass(group, alpha); gl.depthFunc(gl.LESS); gl.disable(gl.BLEND);
      };
      if (glass) { clear(g.sole, 0.45); clear(g.cuff, 0.5); clear(g.glass, 0.2); } else { pass(g.sole, 1); pass(g.glass, 1); pass(g.cuff, 1); }
      gl.disable(gl.DEPTH_TEST); gl.enable(gl.BLEND); pass(this.moving, 0.16, false, 1); gl.disable(gl.BLEND); // also through the foot
      const plain = (v) => v.toFixed(1).replace("-0.0", "0.0").replace("-", "\u2212");
      const words = [`subtalar ${plain(angle)}°`, `anatomy ${plain(anatomy)} N·m`].concat(l.braced ? [`brace ${plain(brace)} N·m`] : [], [`ground ${plain(size(force) / 1000)} kN`]);
      this.figures.textContent = words.join(" · ");
      this.canvas.setAttribute("aria-label", `${l.name} at ${(1000 * state.time).toFixed(0)} ms: ${words.join(", ")}. Arrow keys turn it, plus and minus zoom.`);
    }
  }

  const html = (name, parent, text, className) => {
    const e = document.createElement(name);
    if (text !== undefined) e.textContent = text;
    if (className) e.className = className;
    parent.appendChild(e);
    return e;
  };
  const pair = document.createElement("div");
  pair.className = "pair";
  try {
    for (let k = 0; k < scene.shown.length; k++) {
      const side = html("div", pair, undefined, "view"), head = html("div", side, undefined, "head"), swatch = html("span", head, undefined, "swatch");
      const view = new View(side, scene.shown[k]);
      swatch.style.borderTopColor = view.landing.colour;
      if (landings.length > 2) {
        const select = html("select", head);
        select.setAttribute("aria-label", `Landing shown ${k ? "on the right" : "on the left"}`);
        landings.forEach((l, n) => { const o = html("option", select, l.name); o.value = n; o.selected = n === scene.shown[k]; });
        select.addEventListener("change", () => { view.choose(Number(select.value)); swatch.style.borderTopColor = view.landing.colour; draw(); });
      } else html("b", head, view.landing.name);
      view.figures = html("p", side, "", "figures-now");
      state.views.push(view);
    }
  } catch (problem) {
    place.dataset.flat = problem.message; // the frame stays
    return;
  }
  place.querySelector(".frame").hidden = true;
  place.insertBefore(pair, place.firstChild);
  const bars = html("div", place, undefined, "bars"), bar = html("div", bars, undefined, "bar");
  const play = html("button", bar, "Play");
  play.type = "button";
  const label = html("label", bar, "time "), slider = html("input", label), clock = html("output", label);
  Object.assign(slider, { type: "range", min: 0, max: Math.round(1e4 * END) / 10, step: 0.5, value: 1000 * state.time });
  slider.setAttribute("aria-label", "Time after contact in milliseconds");
  const buttons = html("div", bars, undefined, "bar");
  for (const [text, key] of [["Ankle", "ankle"], ["From behind", "back"], ["From the side", "side"], ["Whole body", "body"]]) {
    const b = html("button", buttons, text);
    b.type = "button";
    b.addEventListener("click", () => { [camera.around, camera.up, camera.far] = VIEWS[key]; camera.target = [0, 0, 0]; draw(); });
  }
  const skin = html("label", buttons), tick = html("input", skin);
  tick.type = "checkbox"; tick.checked = true;
  skin.append(" bones");
  tick.addEventListener("change", () => { state.glass = tick.checked; draw(); });
  const key = html("p", place, undefined, "key");
  [["force on the foot", scene.colours.force], ["moment of the anatomy", scene.colours.anatomy]].forEach(([text, rgb]) => {
    const entry = html("span", key), s = html("span", entry, undefined, "swatch");
    s.style.borderTopColor = `rgb(${rgb.map((c) => Math.round(255 * c)).join(",")})`;
    entry.append(` ${text}`);
  });
  if (landings.some((l) => l.braced)) html("span", key, "moment of the brace: arc in its own colour");
  html("span", key, "Drag to turn, Ctrl and wheel or two fingers to zoom.");

  let pending = false;
  const draw = () => {
    if (pending) return;
    pending = true;
    requestAnimationFrame(() => {
      pending = false;
      state.views.forEach((v) => v.draw());
      clock.textContent = ` ${(1000 * state.time).toFixed(1)} ms`;
      if (document.activeElement !== slider || state.playing) slider.value = 1000 * state.time;
    });
  };
  const zoom = (factor) => { camera.far = Math.max(0.35, Math.min(5, camera.far * factor)); draw(); };
  const turn = (dx, dy) => { camera.around -= dx; camera.up = Math.max(-0.3, Math.min(1.5, camera.up + dy)); draw(); };
  state.views.forEach(({ canvas }) => {
    const held = new Map();
    canvas.addEventListener("pointerdown", (e) => { held.set(e.pointerId, e); if (e.isTrusted) canvas.setPointerCapture(e.pointerId); });
    const release = (e) => held.delete(e.pointerId);
    ["pointerup", "pointercancel", "lostpointercapture"].forEach((name) => canvas.addEventListener(name, release));
    canvas.addEventListener("pointermove", (e) => {
      const before = held.get(e.pointerId);
      if (!before) return;
      if (held.size === 2) {
        const other = [...held.values()].find((o) => o.pointerId !== e.pointerId), apart = (p) => Math.hypot(p.clientX - other.clientX, p.clientY - other.clientY) || 1;
        zoom(apart(before) / apart(e));
      } else turn((e.clientX - before.clientX) / 150, (e.clientY - before.clientY) / 150);
      held.set(e.pointerId, e);
    });
    canvas.addEventListener("wheel", (e) => { if (e.ctrlKey || document.activeElement === canvas) { e.preventDefault(); zoom(Math.exp(e.deltaY / 400)); } }, { passive: false });
    canvas.addEventListener("keydown", (e) => {
      const act = { ArrowLeft: () => turn(-0.12, 0), ArrowRight: () => turn(0.12, 0), ArrowUp: () => turn(0, 0.08), ArrowDown: () => turn(0, -0.08), "+": () => zoom(0.85), "=": () => zoom(0.85), "-": () => zoom(1.18), " ": () => play.click() }[e.key];
      if (act) { e.preventDefault(); act(); }
    });
  });
  slider.addEventListener("input", () => { state.time = Number(slider.value) / 1000; state.playing = false; play.textContent = "Play"; draw(); });
  let last = 0;
  const run = (now) => {
    if (!state.playing) return;
    state.time += Math.min(50, now - last) / 1000 / 20; // slowed 20 times, as the film
    last = now;
    if (state.time >= END) { state.time = END; state.playing = false; play.textContent = "Play"; }
    draw();
    requestAnimationFrame(run);
  };
  play.addEventListener("click", () => {
    state.playing = !state.playing;
    play.textContent = state.playing ? "Stop" : "Play";
    if (state.playing) { if (state.time >= END - 1e-4) state.time = 0; last = performance.now(); requestAnimationFrame(run); }
  });
  new ResizeObserver(draw).observe(pair);
  draw();
})();
