// Orbit and attitude of a craft at a time: the Earth or the Sun with the orbit, and the craft in its
// orbit's frame with field, Sun and the momentum of its wheels. Drawn on two canvases; a drag turns
// them.
"use strict";
function makeScene(root, seek) {
  const views = [...root.querySelectorAll("canvas")];
  const slider = root.querySelector("input");
  const play = root.querySelector("button");
  const readout = root.querySelector("output");
  const paper = views.map((canvas) => canvas.getContext && canvas.getContext("2d"));
  if (paper.some((ctx) => !ctx)) {
    readout.textContent = "This browser has no canvas: orbit and attitude are not shown.";
    return { show() {}, at() {}, turned };
  }
  const cameras = [{ turn: 0.9, tilt: 0.45 }, { turn: 0.7, tilt: 0.35 }];
  const AU = 149597870.7; // km
  const EARTH = { name: "Earth", radius: 6378.137, mu: 398600.4418 }; // km, km3/s2
  const SUN = { name: "Sun", radius: 695700, mu: 1.32712440018e11 };
  const FILLS = { Sun: ["#e0a100", "#e0a100"], Earth: ["#a9cbe8", "#2f5f8f"],
    Moon: ["#c9c9c9", "#707070"], Mars: ["#dcae91", "#8a5a40"] }; // by day: light, dark
  const FARTHEST = 1e6; // km: positions beyond are from the Sun
  let data = null, series = {}, row = 0, playing = 0, seenBefore = false;

  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2],
    a[0] * b[1] - a[1] * b[0]];
  const times = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
  const plus = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
  const length = (a) => Math.hypot(a[0], a[1], a[2]);
  const unit = (a) => { const n = length(a); return n > 0 ? times(a, 1 / n) : [0, 0, 0]; };
  const vector = (name, k, n = 3) => series[name] && [...series[name].slice(n * k, n * k + n)];

  function decode({ data: packed, scale }) {
    const raw = new Int16Array(Uint8Array.from(atob(packed), (c) => c.charCodeAt(0)).buffer);
    return Float64Array.from(raw, (v) => v * scale);
  }

  function turned(q, v) { // body to eci: C(q)' v = v + w t + u x t with t = 2 u x v
    const u = [q[0], q[1], q[2]];
    const t = times(cross(u, v), 2);
    return plus(plus(v, times(t, q[3])), cross(u, t));
  }

  function camera(k) { // right, up and toward the viewer
    const { turn, tilt } = cameras[k];
    const toward = [Math.cos(turn) * Math.cos(tilt), Math.sin(turn) * Math.cos(tilt), Math.sin(tilt)];
    const right = [-Math.sin(turn), Math.cos(turn), 0];
    return { right, up: cross(toward, right), toward };
  }

  function begin(k) { // a clean canvas in its pixels; returns half its width and the scale
    const canvas = views[k], ctx = paper[k], ratio = devicePixelRatio || 1;
    const wide = canvas.clientWidth, high = canvas.clientHeight;
    if (canvas.width !== Math.round(wide * ratio) || canvas.height !== Math.round(high * ratio)) {
      canvas.width = Math.round(wide * ratio);
      canvas.height = Math.round(high * ratio);
    }
    ctx.setTransform(ratio, 0, 0, ratio, 0.5 * canvas.width, 0.5 * canvas.height);
    ctx.clearRect(-wide, -high, 2 * wide, 2 * high);
    ctx.font = "12px system-ui, sans-serif";
    ctx.textAlign = "center";
    ctx.textBaseline = "middle";
    ctx.lineCap = ctx.lineJoin = "round";
    return { ctx, half: 0.5 * Math.min(wide, high) };
  }

  function arrow(ctx, from, to, hue, label, width = 2) {
    const dx = to[0] - from[0], dy = to[1] - from[1], n = Math.hypot(dx, dy);
    ctx.strokeStyle = ctx.fillStyle = colour(hue);
    ctx.lineWidth = width;
    ctx.beginPath();
    ctx.moveTo(...from);
    ctx.lineTo(...to);
    if (n > 8) {
      const x = dx / n, y = dy / n;
      ctx.moveTo(to[0] - 8 * x + 4 * y, to[1] - 8 * y - 4 * x);
      ctx.lineTo(...to);
      ctx.lineTo(to[0] - 8 * x - 4 * y, to[1] - 8 * y + 4 * x);
    }
    ctx.stroke();
    if (label && n > 4) ctx.fillText(label, to[0] + 12 * dx / n, to[1] + 12 * dy / n);
  }

  function drawOrbit() {
    const { ctx, half } = begin(0);
    const { right, up, toward } = camera(0);
    const zoom = 0.82 * half / Math.max(data.reach, data.radius);
    const flat = (p) => [zoom * dot(p, right), -zoom * dot(p, up)];
    const radius = zoom * data.radius;
    const r = vector("r", row);
    const sun = series.sun ? unit(vector("sun", row)) : [0, 0, 0];
    const hidden = (p) => dot(p, toward) < 0 && Math.hypot(...flat(p)) < radius;
    const ring = ellipse();
    const path = (behind) => {
      ctx.strokeStyle = css("--ink");
      ctx.lineWidth = 1.5;
      ctx.globalAlpha = behind ? 0.35 : 1;
      ctx.beginPath();
      let open = false;
      for (const p of ring) {
        if (hidden(p) !== behind) { open = false; continue; }
        ctx[open ? "lineTo" : "moveTo"](...flat(p));
        open = true;
      }
      ctx.stroke();
      ctx.globalAlpha = 1;
    };
    path(true);
    ctx.beginPath();
    ctx.arc(0, 0, Math.max(radius, 3), 0, 2 * Math.PI);
    ctx.fillStyle = FILLS[data.centre][Number(dark.matches)];
    ctx.fill();
    if (data.centre !== "Sun") {
      night(ctx, radius, sun, right, up, toward);
      graticule(ctx, flat, toward);
    }
    path(false);
    const at = flat(r);
    ctx.globalAlpha = hidden(r) ? 0.4 : 1;
    const along = (v, hue, label) => {
      const u = unit(v);
      if (length(u)) arrow(ctx, at, plus([...at, 0], [46 * dot(u, right), -46 * dot(u, up), 0])
        .slice(0, 2), hue, label);
    };
    if (series.b) along(vector("b", row), data.colours.b, "B");
    if (series.sun && data.centre !== "Sun") along(sun, data.colours.sun, "Sun");
    const h = momentum();
    if (h) along(h, data.colours.h, "h");
    ctx.fillStyle = css("--ink");
    ctx.beginPath();
    ctx.arc(...at, 4, 0, 2 * Math.PI);
    ctx.fill();
    ctx.globalAlpha = 1;
  }

  function night(ctx, radius, sun, right, up, toward) { // the half of the disc that has no Sun
    const first = unit(cross(sun, toward));
    if (!length(first)) return;
    const second = cross(sun, first);
    const front = dot(second, toward) > 0 ? second : times(second, -1);
    const limb = cross(toward, first);
    const away = dot(limb, sun) < 0 ? limb : times(limb, -1);
    ctx.beginPath();
    for (const [a, b] of [[first, front], [times(first, -1), away]]) {
      for (let k = 0; k <= 24; k++) {
        const turn = Math.PI * k / 24;
        const p = plus(times(a, Math.cos(turn)), times(b, Math.sin(turn)));
        ctx.lineTo(radius * dot(p, right), -radius * dot(p, up));
      }
    }
    ctx.closePath();
    ctx.fillStyle = "rgba(10, 20, 45, 0.42)";
    ctx.fill();
  }

  function graticule(ctx, flat, toward) { // lines of latitude and of right ascension, 30 deg apart
    ctx.strokeStyle = "rgba(255, 255, 255, 0.45)";
    ctx.lineWidth = 0.6;
    const line = (point) => {
      ctx.beginPath();
      let open = false;
      for (let k = 0; k <= 72; k++) {
        const p = times(point(2 * Math.PI * k / 72), data.radius);
        if (dot(p, toward) <= 0) { open = false; continue; }
        ctx[open ? "lineTo" : "moveTo"](...flat(p));
        open = true;
      }
      ctx.stroke();
    };
    for (let d = -60; d <= 60; d += 30) {
      const z = Math.sin(d * Math.PI / 180), c = Math.cos(d * Math.PI / 180);
      line((t) => [c * Math.cos(t), c * Math.sin(t), z]);
    }
    for (let d = 0; d < 180; d += 30) {
      const x = Math.cos(d * Math.PI / 180), y = Math.sin(d * Math.PI / 180);
      line((t) => [x * Math.cos(t), y * Math.cos(t), Math.sin(t)]);
    }
  }

  function momentum() { // of the wheels, eci
    return series.h && turned(vector("q", row, 4), vector("h", row));
  }

  function frame() { // along the track, across it, and away from the Earth; eci without an orbit
    if (!data.orbit) return [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
    const away = unit(vector("r", row));
    const across = unit(cross(vector("r", row), vector("v", row)));
    return [cross(across, away), across, away];
  }

  function fires(piece) { // whether a nozzle was open since the row before
    return piece.kind === "nozzle" && series.fired
      && series.fired[row * data.nozzles + Number(piece.label.slice(1)) - 1] > 0;
  }

  function drawCraft() {
    const { ctx, half } = begin(1);
    const { right, up, toward } = camera(1);
    const axes = frame();
    const q = vector("q", row, 4);
    const seen = (p) => [dot(p, axes[0]), dot(p, axes[1]), dot(p, axes[2])]; // eci to the frame
    const zoom = 0.8 * half / data.size;
    const flat = (p) => [zoom * dot(p, right), -zoom * dot(p, up)];
    const strokes = [];
    for (const piece of data.craft) {
      const move = (p) => seen(turned(q, p));
      for (const face of piece.faces) strokes.push([face.map(move), piece, true]);
      for (const line of piece.lines) strokes.push([line.map(move), piece, false]);
    }
    const depth = (points) => points.reduce((sum, p) => sum + dot(p, toward), 0) / points.length;
    strokes.sort((a, b) => depth(a[0]) - depth(b[0]));
    for (const [points, piece, filled] of strokes) {
      ctx.beginPath();
      points.forEach((p, k) => ctx[k ? "lineTo" : "moveTo"](...flat(p)));
      ctx.strokeStyle = ctx.fillStyle = colour(piece.colour);
      if (filled) {
        ctx.closePath();
        ctx.globalAlpha = piece.kind === "wheel" ? 0.75 : 0.22;
        ctx.fill();
        ctx.globalAlpha = 1;
      }
      ctx.lineWidth = piece.kind === "coil" ? 3 : piece.kind === "axis" ? 1.6 : fires(piece) ? 4 : 1;
      ctx.globalAlpha = piece.kind === "nozzle" && series.fired && !fires(piece) ? 0.45 : 1;
      ctx.stroke();
      ctx.globalAlpha = 1;
    }
    for (const piece of data.craft) {
      if (piece.kind !== "axis") continue;
      ctx.fillStyle = colour(piece.colour);
      ctx.fillText(piece.label, ...flat(seen(turned(q, piece.place))));
    }
    const reach = 0.9 * half / zoom;
    const draw = (v, hue, label, share = 1) => {
      const u = unit(v);
      if (length(u)) arrow(ctx, [0, 0], flat(times(seen(u), share * reach)), hue, label, 2.4);
    };
    if (data.orbit) {
      draw(times(vector("r", row), -1), data.colours.orbit, data.centre, 0.86);
      draw(axes[0], data.colours.orbit, "ahead", 0.72);
    }
    if (series.b) draw(vector("b", row), data.colours.b, "B", 0.86);
    if (series.sun) draw(vector("sun", row), data.colours.sun, "Sun", 0.86);
    const h = momentum();
    if (h) draw(h, data.colours.h, "h", Math.max(0.15, 0.86 * length(h) / data.largest));
    if (series.fill) fillBars(ctx);
  }

  function fillBars(ctx) { // of each wheel, at the lower left; a full bar is the wheel's capacity
    const wide = views[1].clientWidth, high = views[1].clientHeight, tall = 34;
    const middle = 0.5 * high - tall - 18;
    ctx.fillStyle = css("--ink");
    ctx.textAlign = "left";
    ctx.fillText("wheels", 10 - 0.5 * wide, middle - tall - 9);
    ctx.textAlign = "center";
    for (let w = 0; w < data.wheels; w++) {
      const share = series.fill[row * data.wheels + w], x = 12 - 0.5 * wide + 22 * w;
      const reach = Math.min(1, Math.abs(share)) * tall;
      ctx.fillStyle = colour(data.colours.h);
      ctx.fillRect(x, share > 0 ? middle - reach : middle, 12, reach);
      ctx.strokeStyle = ctx.fillStyle = css(Math.abs(share) > 0.999 ? "--bad" : "--ink");
      ctx.lineWidth = 1;
      ctx.strokeRect(x, middle - tall, 12, 2 * tall);
      ctx.fillText(`w${w + 1}`, x + 6, middle + tall + 9);
      ctx.fillRect(x, middle - 0.5, 12, 1);
    }
  }

  function say() {
    const t = data.times[row];
    const end = data.times[data.count - 1];
    const [size, name] = end > 5 * 86400 ? [86400, "d"] : end > 3 * 3600 ? [3600, "h"]
      : end > 1200 ? [60, "min"] : [1, "s"];
    const parts = [`${text(t / size, end / size / 1e3)} ${name}`];
    if (data.orbit) {
      const r = length(vector("r", row));
      parts.push(data.centre !== "Sun" ? `altitude ${text(r - data.radius, 1)} km`
        : `${text(r / AU, 1e-3)} au from the Sun`);
    }
    if (series.light && series.sun) { // far from the Sun the whole of its light is less than 1
      const share = series.light[row] / (data.brightest || 1);
      parts.push(share > 0.5 ? "in sunlight" : share > 0.01 ? "in penumbra" : "in shadow");
    }
    const h = momentum();
    if (series.fired) {
      const open = data.craft.filter(fires);
      if (open.length) parts.push(`firing: ${open.map((p) => p.label).join(", ")}`);
    }
    if (h) {
      const [factor, unitName] = data.largest < 1 ? [1e3, "mN m s"] : [1, "N m s"];
      parts.push(`wheels h = ${text(factor * length(h), factor * data.largest / 1e3)} ${unitName}`);
      const b = series.b && vector("b", row);
      if (b && length(b) && length(h)) {
        const c = Math.abs(dot(unit(h), unit(b)));
        parts.push(`${text(Math.acos(Math.min(1, c)) * 180 / Math.PI, 1)} deg from the field's line`);
      }
    }
    readout.textContent = parts.join(" · ");
    slider.value = row;
    slider.setAttribute("aria-valuetext", parts[0]);
  }

  function draw() {
    if (!data) return;
    if (data.orbit) drawOrbit();
    drawCraft();
    say();
  }

  function at(t) { // the row of a time (s)
    if (!data || t === null) return;
    let low = 0, high = data.count - 1;
    while (high - low > 1) {
      const mid = (low + high) >> 1;
      if (data.times[mid] <= t) low = mid; else high = mid;
    }
    row = t - data.times[low] < data.times[high] - t ? low : high;
    draw();
  }

  function centreOf(count, body) { // what the craft orbits; null where it stays at a place
    if (!series.r || !series.v) return null;
    let moves = false;
    for (let i = 3; i < 3 * count && !moves; i++) moves = series.r[i] !== series.r[i % 3];
    if (!moves) return null;
    return length(vector("r", 0)) > FARTHEST ? SUN : body || EARTH;
  }

  function ellipse() { // points of the osculating orbit, km; none of an open one
    const r = vector("r", row), v = vector("v", row), mu = data.mu;
    const h = cross(r, v);
    const a = 1 / (2 / length(r) - dot(v, v) / mu);
    const shape = plus(times(cross(v, h), 1 / mu), times(unit(r), -1));
    const e = length(shape);
    if (!(a > 0) || e >= 1) return [];
    const first = e > 1e-8 ? unit(shape) : unit(r);
    const second = cross(unit(h), first);
    return Array.from({ length: 145 }, (_, k) => {
      const E = 2 * Math.PI * k / 144;
      return plus(times(first, a * (Math.cos(E) - e)),
        times(second, a * Math.sqrt(1 - e * e) * Math.sin(E)));
    });
  }

  function show(told) { // data as of report/scene.py, or with series as arrays of numbers
    series = {};
    for (const [name, s] of Object.entries(told.series)) series[name] = s.data ? decode(s) : s;
    for (const name of ["b", "sun", "h"]) {
      if (series[name] && !series[name].some((v) => v !== 0)) delete series[name];
    }
    const body = centreOf(told.count, told.body);
    const centre = body ? body.name : "";
    const clock = Float64Array.from({ length: told.count }, (_, k) => told.first + k * told.step);
    data = { ...told, times: clock, centre, orbit: centre !== "",
      radius: (body || EARTH).radius, mu: (body || EARTH).mu };
    const r = series.r;
    data.reach = 0;
    for (let k = 0; r && k < told.count; k++) data.reach = Math.max(data.reach, length(vector("r", k)));
    data.brightest = 0;
    for (let k = 0; series.light && k < told.count; k++) {
      data.brightest = Math.max(data.brightest, series.light[k]);
    }
    data.largest = 0;
    for (let k = 0; series.h && k < told.count; k++) {
      data.largest = Math.max(data.largest, length(vector("h", k)));
    }
    data.wheels = series.fill ? series.fill.length / told.count : 0;
    data.nozzles = series.fired ? series.fired.length / told.count : 0;
    data.size = Math.max(...told.craft.flatMap((p) => [...p.faces, ...p.lines]).flat().map(length));
    if (!seenBefore && series.sun && centre && centre !== "Sun") { // the day's side, obliquely
      const sun = vector("sun", 0);
      cameras[0].turn = Math.atan2(sun[1], sun[0]) + 0.7;
    }
    seenBefore = true;
    views[0].hidden = !centre;
    root.classList.toggle("orbiting", Boolean(centre));
    slider.max = told.count - 1;
    row = Math.min(row, told.count - 1);
    root.classList.add("drawn");
    draw();
  }

  views.forEach((canvas, k) => {
    canvas.addEventListener("pointermove", (event) => {
      if (!event.buttons) return;
      cameras[k].turn -= 0.01 * event.movementX;
      cameras[k].tilt = Math.max(-1.5, Math.min(1.5, cameras[k].tilt + 0.01 * event.movementY));
      draw();
    });
    canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
  });
  slider.addEventListener("input", () => {
    row = Number(slider.value);
    draw();
    seek(data.times[row]);
  });
  function advance() {
    if (!playing) return;
    row = (row + 1) % data.count;
    draw();
    seek(data.times[row]);
    playing = requestAnimationFrame(advance);
  }
  play.addEventListener("click", () => {
    if (playing) cancelAnimationFrame(playing);
    playing = playing ? 0 : 1;
    play.textContent = playing ? "pause" : "play";
    if (playing) advance();
  });
  addEventListener("resize", draw);
  addEventListener("beforeprint", draw);
  dark.addEventListener("change", draw);
  return { show, at, turned, get row() { return row; }, get data() { return data; } };
}
