// The figures of a page, drawn by uPlot: zoom, values under the pointer, series by the legend; axes
// of the same quantity move together. What cannot be drawn keeps its SVG, as do print and no
// JavaScript.
(() => {
  "use strict";
  const told = JSON.parse(document.getElementById("drawn").textContent);
  const ROW = 9; // of a strip of modes, px
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
  const grids = told.grids.map((text) => new Float64Array(bytes(text)));
  const ends = {}; // of x, by its quantity
  for (const plot of told.plots) {
    if (!plot) continue;
    const x = grids[plot.grid];
    const own = plot.seconds ? [x[0], x[x.length - 1]] : plot.ends;
    const [low, high] = ends[plot.axis] || own;
    ends[plot.axis] = [Math.min(low, own[0]), Math.max(high, own[1])];
  }
  let shown = [];
  let linking = false;
  let seeking = false; // a cursor that the view of orbit and attitude sets

  function values(series) {
    const raw = new Float32Array(bytes(series.data));
    return Array.from(raw, (v) => (Number.isFinite(v) ? v + series.offset : null));
  }

  function link(from) {
    if (linking) return;
    linking = true;
    const { min, max } = from.scales.x;
    for (const other of shown) {
      const now = other.scales.x;
      if (other.quantity !== from.quantity || (now.min === min && now.max === max)) continue;
      other.setScale("x", { min, max });
    }
    const zoomed = shown.some((u) => {
      const [low, high] = ends[u.quantity];
      return u.scales.x.min > low || u.scales.x.max < high;
    });
    document.documentElement.classList.toggle("zoomed", zoomed);
    linking = false;
  }

  function reset() {
    for (const made of shown) {
      const [min, max] = ends[made.quantity];
      made.setScale("x", { min, max });
    }
  }

  // A plot by keyboard, while it has the focus: + and - zoom, arrows move along, 0 shows all.
  function steer(made, plot, place) {
    const title = place.closest("figure").querySelector("figcaption").firstChild.textContent.trim();
    place.tabIndex = 0;
    place.setAttribute("role", "group");
    place.setAttribute("aria-label", `${title}: plus and minus zoom, arrows move, 0 shows all`);
    const [to, from] = plot.xlog ? [Math.log, Math.exp] : [Number, Number];
    place.onkeydown = (event) => {
      const change = { "+": [1, -1], "=": [1, -1], "-": [-2, 2], ArrowLeft: [-1, -1], ArrowRight: [1, 1], 0: null }[event.key];
      if (event.target !== place || change === undefined || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      if (!change) return reset();
      const [first, last] = ends[plot.axis].map(to);
      let [low, high] = [made.scales.x.min, made.scales.x.max].map(to);
      const quarter = (high - low) / 4;
      [low, high] = [low + change[0] * quarter, high + change[1] * quarter];
      const wide = Math.min(high - low, last - first);
      low = Math.max(first, Math.min(low, last - wide));
      made.setScale("x", { min: from(low), max: from(low + wide) });
    };
  }

  function under(u, plot) { // strips of modes, and bands and limits across
    const { left, top, width, height } = u.bbox;
    const ctx = u.ctx;
    const ratio = devicePixelRatio;
    ctx.save();
    ctx.beginPath();
    ctx.rect(left, top, width, height + (1 + rows(plot) * ROW) * ratio);
    ctx.clip();
    for (const strip of plot.strips) {
      ctx.fillStyle = strip.colour;
      for (let i = 0; i < strip.spans.length; i += 2) {
        const x = u.valToPos(strip.spans[i], "x", true);
        const wide = u.valToPos(strip.spans[i + 1], "x", true) - x;
        ctx.globalAlpha = 1;
        ctx.fillRect(x, top + height + (1 + strip.row * ROW) * ratio, wide, (ROW - 2) * ratio);
        if (strip.row === 0 && strip !== plot.strips[0]) { // all but what holds longest
          ctx.globalAlpha = 0.18;
          ctx.fillRect(x, top, wide, height);
        }
      }
    }
    ctx.restore();
    ctx.save();
    ctx.beginPath();
    ctx.rect(left, top, width, height);
    ctx.clip();
    for (const level of plot.across) {
      if (level.low === null) continue; // far beyond: named alone
      const low = u.valToPos(level.low, "y", true);
      const high = u.valToPos(level.high, "y", true);
      if (level.filled) {
        ctx.globalAlpha = level.alpha;
        ctx.fillStyle = level.colour;
        ctx.fillRect(left, high, width, low - high);
        continue;
      }
      ctx.globalAlpha = 1;
      ctx.strokeStyle = colour(level.colour);
      ctx.lineWidth = 1.2 * ratio;
      ctx.setLineDash(level.dash.map((d) => 1.7 * d * ratio));
      ctx.beginPath();
      ctx.moveTo(left, low);
      ctx.lineTo(left + width, low);
      ctx.stroke();
    }
    for (const line of plot.upright) {
      const x = u.valToPos(line.at, "x", true);
      ctx.strokeStyle = colour(line.colour);
      ctx.lineWidth = 1.2 * ratio;
      ctx.setLineDash([4 * ratio, 3 * ratio]);
      ctx.beginPath();
      ctx.moveTo(x, top);
      ctx.lineTo(x, top + height);
      ctx.stroke();
    }
    ctx.restore();
  }

  function nameLevels(u, plot) { // over the lines
    const { left, top, width } = u.bbox;
    const named = [];
    for (const level of plot.across.filter(({ low, filled }) => low !== null && !filled)) {
      const y = u.valToPos(level.low, "y", true);
      nameLevel(u.ctx, level.label, colour(level.colour), left + width, y, top, named);
    }
  }

  const rows = (plot) => plot.strips.reduce((most, s) => Math.max(most, s.row + 1), 0);

  function key(plot, into) { // what limits and strips are; of strips, what holds under the pointer
    const list = document.createElement("p");
    list.className = "key note";
    const entries = [...plot.across, ...plot.upright].filter((x) => x.label).concat(plot.strips);
    const spots = entries.map((entry) => {
      const item = document.createElement("span");
      const spot = document.createElement("i");
      spot.style.background = entry.spans || entry.filled ? entry.colour : "none";
      if (!entry.spans) spot.style.opacity = entry.filled ? 0.5 : 1;
      const side = "at" in entry ? "borderLeft" : "borderTop";
      if (!entry.spans && !entry.filled) spot.style[side] = `2px ${entry.dash?.[0] > 4 ? "dashed" : "dotted"} ${colour(entry.colour)}`;
      item.append(spot, entry.label);
      list.append(item);
      return item;
    });
    if (entries.length) into.append(list);
    return (t) => entries.forEach((entry, i) => {
      if (!entry.spans) return;
      let holds = false;
      for (let k = 0; k < entry.spans.length && !holds; k += 2) {
        holds = t !== null && entry.spans[k] <= t && t < entry.spans[k + 1];
      }
      spots[i].classList.toggle("now", holds);
    });
  }

  function draw(plot, place) {
    const x = grids[plot.grid];
    const [first, last] = ends[plot.axis];
    const unit = plot.seconds || 1;
    const ink = css("--ink");
    const axis = { stroke: ink, grid: { stroke: css("--grid"), width: 1 }, font: "12px system-ui",
      labelFont: "12px system-ui", labelSize: 18 };
    const inks = { ...axis, ticks: { stroke: ink, width: 1, size: 5 } };
    const depth = rows(plot) * ROW;
    const y = plot.series.map(values);
    let now = () => {};
    const all = (u) => u.series.every((s) => s.show !== false);
    const whole = (u) => u.scales.x.min == null || u.scales.x.min <= first && u.scales.x.max >= last;
    const range = (u, min, max) => {
      if (min === null || (whole(u) && all(u))) return plot.range;
      if (plot.log) return uPlot.rangeLog(min, max, 10, false);
      const size = Math.max(Math.abs(min), Math.abs(max));  // a constant differs by its rounding
      const rim = max - min > 1e-12 * size ? 0.05 * (max - min) : 0.05 * size || 1;
      return [min - rim, max + rim];
    };
    const wide = (u, labels) => 16 + 7.5 * Math.max(3, ...(labels || []).map((s) => (s || "").length));
    const options = {
      width: place.clientWidth, height: (plot.small ? 170 : 290) + depth,
      scales: { x: { time: false, distr: plot.xlog ? 3 : 1, range: (u, min, max) => [min, max] },
        y: { distr: plot.log ? 3 : 1, range } },
      axes: [
        { ...inks, ticks: { ...inks.ticks, show: !depth }, label: plot.unit ? `${plot.axis} [${plot.unit}]` : plot.axis,
          size: 32 + depth, gap: 5 + depth, filter: (u, at) => at,
          splits: (u, i, min, max) => plot.xlog ? decades(min, max) : multiples(min / unit, max / unit,
            (u.width - 80) / 75).map((t) => t * unit),
          values: (u, at) => at.map((t) => text(t / unit, plot.xlog ? t : finer(apart(at, unit)))) },
        { ...inks, label: plot.label, size: wide,
          splits: plot.log ? (u, i, min, max) => decades(min, max)
            : (u, i, min, max) => multiples(min, max, 8),
          filter: (u, at) => at,
          values: (u, at) => at.map((v) => text(v, plot.log ? v : finer(apart(at, 1)))) },
      ],
      series: [
        { label: plot.axis, value: (u, t) => (t === null ? "–"
          : `${text(t / unit, (last - first) / unit / 1e4)} ${plot.unit}`) },
        ...plot.series.map((s) => ({
          label: s.label, stroke: colour(s.colour), width: s.area ? 0.5 : s.width,
          dash: s.dash.map((d) => 1.5 * d), spanGaps: !s.gaps,
          points: s.points ? { show: true, size: s.points + 1, stroke: colour(s.colour),
            fill: s.hollow ? css("--paper") : colour(s.colour) } : { show: false },
          paths: s.area || s.width ? (s.stepped ? uPlot.paths.stepped({ align: 1 }) : undefined)
            : () => null,
          value: (u, v) => reading(v, plot.log ? Math.abs(v) / 1e4
            : (u.scales.y.max - u.scales.y.min) / 1e4, plot.label),
        })),
      ],
      bands: plot.series.flatMap((s, i) => (s.area && plot.series[i + 1]?.area
        && s.label.endsWith(": least") ? [{ series: [i + 2, i + 1],
          fill: colour(s.colour) + Math.round(255 * s.area).toString(16).padStart(2, "0") }] : [])),
      legend: { markers: { width: 2, dash: border } },
      cursor: {
        y: false,
        sync: { key: plot.axis, setSeries: false, scales: ["x", null],
          filters: { pub: (type) => type === "mousemove" || type === "mouseleave" } },
        drag: { x: true, y: false, setScale: true },
        bind: { dblclick: () => () => { reset(); return null; } },
      },
      hooks: {
        drawClear: [(u) => under(u, plot)],
        draw: [(u) => nameLevels(u, plot)],
        setScale: [(u, name) => name === "x" && u.status === 1 && link(u)],
        setCursor: [(u) => {
          const t = u.cursor.left >= 0 ? u.posToVal(u.cursor.left, "x") : null;
          now(t);
          if (plot.seconds && !seeking) {
            document.dispatchEvent(new CustomEvent("moment", { detail: t }));
          }
        }],
      },
    };
    const made = new uPlot(options, [x, ...y], place);
    made.quantity = plot.axis;
    made.isTime = plot.seconds > 0;
    now = key(plot, place);
    operable(place);
    steer(made, plot, place);
    new ResizeObserver(() => {
      if (place.clientWidth && place.clientWidth !== made.width) {
        made.setSize({ width: place.clientWidth, height: options.height });
      }
    }).observe(place);
    return made;
  }

  function drawAll() {
    for (const made of shown) made.destroy();
    shown = [];
    told.plots.forEach((plot, i) => {
      if (!plot) return;
      const figure = document.getElementById(`plot-${i}`);
      const place = figure.querySelector(".live");
      place.replaceChildren();
      figure.classList.add("drawn");
      try {
        shown.push(draw(plot, place));
      } catch (error) { // the SVG stays
        console.error(error);
        figure.classList.remove("drawn");
      }
    });
    reset(); // outputs of intervals have no last row
    document.documentElement.classList.toggle("lively", shown.length > 0);
  }

  drawAll();
  dark.addEventListener("change", drawAll);
  for (const button of document.querySelectorAll(".whole")) button.addEventListener("click", reset);
  document.addEventListener("seek", (event) => {
    seeking = true;
    for (const made of shown) {
      if (!made.isTime) continue;
      made.setCursor({ left: made.valToPos(event.detail, "x"), top: 10 });
    }
    seeking = false;
  });

  async function inflated(text) {
    const stream = new Blob([bytes(text)]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Response(stream).arrayBuffer();
  }

  const digits = (v, count) => Number(v.toPrecision(count));
  const precise = (v, offset) => digits(digits(v, 6) + offset, 15);

  // all samples, as figures/interactive.py packs them
  async function samples(column) {
    const packed = new Uint8Array(await inflated(column.data));
    const rows = packed.length / 4;
    const bits = new Int32Array(rows);
    for (let k = 0, last = 0; k < rows; k++) {
      const step = packed[k] | packed[k + rows] << 8 | packed[k + 2 * rows] << 16 | packed[k + 3 * rows] << 24;
      last = last + ((step >>> 1) ^ -(step & 1)) | 0;
      bits[k] = last;
    }
    return Array.from(new Float32Array(bits.buffer), (v) => (Number.isFinite(v) ? precise(v, column.offset) : null));
  }

  async function sampleGrid(text) {
    let x = 0;
    return Array.from(new Float64Array(await inflated(text)), (step) => digits(x += step, 12));
  }

  // The values of a figure, to six digits: all samples, or what the first line says; null where it is
  // not drawn here.
  function csv(figure) {
    const plot = told.plots[Number(figure.id.split("-")[1])];
    if (!plot) return null;
    const unit = plot.seconds ? "s" : plot.unit;
    const y = unitOf(plot.label) && ` [${unitOf(plot.label)}]`;
    const head = [unit ? `${plot.axis} [${unit}]` : plot.axis, ...plot.series.map((s) => s.label + y)];
    return async () => {
      const all = plot.samples;
      if (all?.columns && globalThis.DecompressionStream) {
        return csvText(head, [await sampleGrid(told.sample_grids[all.grid]), ...await Promise.all(all.columns.map(samples))]);
      }
      const drawn = plot.series.map((s) => values(s).map((v) => v === null ? v : precise(v - s.offset, s.offset)));
      const note = all ? binsLine(grids[plot.grid].length, all.rows) : "";
      return note + csvText(head, [Array.from(grids[plot.grid], (x) => digits(x, 12)), ...drawn]);
    };
  }
  window.desat = { get shown() { return shown; }, csv };
})();
