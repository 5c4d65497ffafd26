// The page of `desat export web`: sliders, charts and numbers over the worker, which flies. What is set
// stands in the address, behind #.
(() => {
  const told = JSON.parse(document.getElementById("told").textContent);
  const $id = (id) => document.getElementById(id);
  const make = (tag, of = {}, ...inside) => {
    const made = Object.assign(document.createElement(tag), of);
    made.append(...inside);
    return made;
  };
  const bytes = (base64) => Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
  const WAIT = 60; // ms after a move
  let law = 0;
  let moved = {}; // of sliders by their names the value in the shown unit
  let kept = {}; // what was moved under other laws, where these have other ranges: by the law, as `moved`
  let address = []; // what is wrong with the address, a line each
  let warned = []; // what `desat run` would warn of, of the flight
  let asked = 0;
  let shown = null; // what was flown last: {law, moved, plots, numbers}
  const references = []; // flights that are kept, drawn pale beside the one of now
  const MOST_KEPT = told.dashes.length - 1;
  let own = null; // a table of the reader's: {name, times, columns, text}
  let dragged = null; // the limit under the pointer, {i, k}, and the range of y that its chart keeps meanwhile
  let pulled = null; // where it was dragged to, until its flight has come: {i, k, value}
  let model = null; // of the flight that was asked for: {id, line, text}
  let charts = [];
  let seeking = false; // cursors follow the view of orbit and attitude
  const scene = makeScene($id("scene"), (t) => {
    seeking = true;
    for (const { plot } of charts) plot?.setCursor({ left: plot.valToPos(t, "x"), top: 10 });
    seeking = false;
  });

  // --- values --------------------------------------------------------------------------------------

  // as `desat run` prints it (numbers/text.py)
  const number = (x) => {
    if (x === null) return "not reached";
    if (x === undefined) return "";
    const size = Math.abs(x);
    if (x !== 0 && !(size >= 1e-3 && size < 1e9)) {
      return x.toExponential(3).replace(/e([+-])(\d)$/, "e$10$2");
    }
    return size < 1000 ? String(Number(x.toPrecision(4))) : Math.round(x).toLocaleString("en-US");
  };
  const sliders = () => told.laws[law].sliders;
  const at = (slider) => moved[slider.name] ?? slider.start;
  const within = (slider, value) => slider.low <= value && value <= slider.high;
  const amount = (value, slider) => `${String(Number(value.toPrecision(12)))} ${slider.shown}`.trim();
  const range = (slider) => `${String(slider.low)} to ${amount(slider.high, slider)}`;
  const grid = (slider, value) => { // of a moved slider: a step of a round size
    const step = multiples(0, slider.high - slider.low, 300)[1];
    return Number(Math.min(slider.high, Math.max(slider.low, Math.round(value / step) * step)).toPrecision(8));
  };
  const python = (x) => (Number.isInteger(x) && Math.abs(x) < 1e16 ? `${x}.0` : String(x));
  const quoted = (text) => (/^[\w@%+=:,./-]+$/.test(text) ? text : `'${text.replace(/'/g, "'\"'\"'")}'`);

  // another law: what was moved stays moved where its slider is the same; else each law has its own
  function choose(other) {
    const alike = (a, b) => ["unit", "factor", "offset", "form", "low", "high"].every((k) => a[k] === b[k]);
    const now = Object.fromEntries(told.laws[other].sliders.map((s) => [s.name, s]));
    const same = (s) => s.name in now && alike(s, now[s.name]);
    const before = Object.entries(moved);
    const named = Object.fromEntries(sliders().map((s) => [s.name, s]));
    const shared = before.filter(([name]) => same(named[name]));
    kept[law] = Object.fromEntries(before.filter(([name]) => !same(named[name])));
    law = other;
    moved = { ...kept[law], ...Object.fromEntries(shared) };
    address = [];
    controls();
    changed();
  }
  function reset() {
    [law, moved, kept, address] = [0, {}, {}, []];
    controls();
    changed();
  }

  // `--set` of what is moved, as Slider.value_text has it
  function assignment(slider) {
    const shownValue = moved[slider.name];
    const own = shownValue * slider.factor + slider.offset;
    const before = told.laws[law].values[slider.targets[0]];
    if (slider.form === "one" || slider.form === "element") {
      return `${slider.name}=${slider.unit ? `${shownValue} ${slider.unit}` : python(own)}`;
    }
    const whole = slider.form === "length" ? Math.sqrt(before.reduce((sum, x) => sum + x * x, 0)) : Math.max(...before.map(Math.abs));
    const values = slider.form === "each" ? slider.there.map((t) => (t ? own : 0))
      : before.map((v) => v * (own / whole));
    return `${slider.name}=${values.map(python).join(",")}`;
  }
  function command() {
    const { sets, arguments: others } = told.laws[law];
    const ours = sliders().filter((s) => s.name in moved);
    const stays = sets.filter((text) => !ours.some((s) => s.name === text.split("=")[0].trim()));
    const given = [...stays, ...ours.map(assignment)].map((text) => ` --set ${quoted(text)}`);
    return `desat run ${quoted(told.target)}${others}${given.join("")}`;
  }

  // --- the address ---------------------------------------------------------------------------------

  function toAddress() {
    const query = new URLSearchParams();
    if (law) query.set("law", told.laws[law].name);
    for (const [name, value] of Object.entries(moved)) query.set(name, value);
    history.replaceState(null, "", location.pathname + (query.size ? `#${query}` : ""));
  }
  function fromAddress() {
    const query = new URLSearchParams(location.search);
    for (const [name, value] of new URLSearchParams(location.hash.slice(1))) query.set(name, value);
    [law, moved, kept, address] = [0, {}, {}, []];
    const names = told.laws.map((l) => l.name);
    if (query.has("law")) law = names.indexOf(query.get("law"));
    if (law < 0) {
      law = 0;
      address.push(`address: law=${query.get("law")}: no such law on this page; there is ${names.join(", ")}`);
    }
    query.delete("law");
    for (const [name, text] of query) {
      const slider = sliders().find((s) => s.name === name);
      const value = Number(text);
      if (!slider) {
        address.push(`address: ${name}=${text}: no slider of this page under the law ${names[law]}; there is `
          + `${sliders().map((s) => s.name).join(", ")}`);
      } else if (!text.trim() || !Number.isFinite(value)) {
        address.push(`address: ${name}=${text}: a number is needed, in ${slider.shown || "no unit"}`);
      } else if (value !== slider.start) moved[name] = value;
    }
  }

  // --- controls ------------------------------------------------------------------------------------

  let updates = [];
  function controls() {
    updates = [];
    $id("law").replaceChildren(...told.laws.map((l, i) => make("option", { value: i, textContent: l.name })));
    $id("law").onchange = (e) => choose(Number(e.target.value));
    $id("sliders").replaceChildren(...sliders().map((slider) => {
      const thumb = make("input", { type: "range", min: slider.low, max: slider.high, step: "any", id: `range-${slider.name}` });
      const field = make("input", { type: "text", inputMode: "decimal", id: `value-${slider.name}` });
      field.setAttribute("aria-label", `${slider.title}${slider.shown ? `, in ${slider.shown}` : ""}`);
      thumb.setAttribute("aria-label", slider.title);
      const aside = make("span", { className: "note" });
      const refusal = make("span", { className: "bad refused" });
      refusal.setAttribute("role", "alert");
      const set = (value) => {
        if (value === slider.start) delete moved[slider.name];
        else moved[slider.name] = value;
        changed();
      };
      const refuse = (text) => {
        refusal.textContent = text;
        field.setAttribute("aria-invalid", String(Boolean(text)));
      };
      thumb.oninput = () => set(grid(slider, Number(thumb.value)));
      field.onchange = () => {
        const value = Number(field.value);
        if (!field.value.trim() || !Number.isFinite(value)) {
          return refuse(`${slider.name} = ${field.value}: a number is needed, from ${range(slider)}; `
            + `it stays at ${amount(at(slider), slider)}`);
        }
        if (within(slider, value) || value === slider.start) return set(value);
        return refuse(`${slider.name} = ${amount(value, slider)}: allowed is ${range(slider)}; `
          + `it stays at ${amount(at(slider), slider)}`);
      };
      const label = make("label", { title: slider.name },
        make("span", { className: "line" }, make("span", { className: "what", textContent: slider.title }),
          make("span", { className: "value" }, field, ` ${slider.shown}`)), thumb, aside, refusal);
      updates.push(() => {
        refuse("");
        label.classList.toggle("moved", slider.name in moved);
        thumb.value = at(slider);
        field.value = String(Number(at(slider).toPrecision(slider.name in moved ? 12 : 6)));
        aside.textContent = slider.name + (slider.height
          ? `, ${number((at(slider) * slider.factor - told.ground) / 1e3)} km above the equator` : "")
          + (slider.form === "length" ? ": size of the vector" : slider.form === "largest"
            ? ": the largest element" : slider.form === "each" ? ": each of them" : "");
      });
      return label;
    }));
    $id("controls").onsubmit = (event) => event.preventDefault();
    $id("reset").onclick = reset;
    $id("compare").onclick = () => {
      if (!shown || references.includes(shown)) return;
      samplesOf(shown); // before another flight takes its place
      references.push(shown);
      beside();
    };
    $id("own").onchange = ({ target }) => {
      if (target.files[0]) read(target.files[0]);
      target.value = "";
    };
    $id("copy").onclick = async () => {
      try {
        await navigator.clipboard.writeText(command());
      } catch { // not from file:// everywhere: select it
        getSelection().selectAllChildren($id("command"));
      }
    };
  }

  // What is drawn beside the flight, each with a button that takes it away; then all of it is drawn.
  function beside() {
    const entry = (textContent, remove) => {
      const button = make("button", { type: "button", textContent: "×", onclick: () => { remove(); beside(); } });
      button.setAttribute("aria-label", `without ${textContent}`);
      return make("li", {}, button, ` ${textContent}`);
    };
    const entries = references.map((flight, j) => entry(`kept ${j + 1}: ${stateOf(flight)}`, () => references.splice(j, 1)));
    if (own) entries.push(entry(own.text, () => { own = null; }));
    $id("kept").replaceChildren(...entries);
    $id("compare").disabled = references.length === MOST_KEPT;
    if (shown) draw();
  }
  function stateOf(flight) {
    const { name, sliders: of } = told.laws[flight.law];
    const values = of.filter((s) => s.name in flight.moved).map((s) => `${s.title} ${amount(flight.moved[s.name], s)}`);
    return [...(told.laws.length > 1 ? [name] : []), ...(values.length ? values : ["as the scenario has it"])].join(", ");
  }

  let timer = 0;
  function changed() {
    for (const update of updates) update();
    $id("law").value = law;
    $id("command").textContent = command();
    warn();
    $id("substeps").textContent = `${told.laws[law].substeps} substep${told.laws[law].substeps > 1 ? "s" : ""} each`;
    toAddress();
    clearTimeout(timer);
    timer = setTimeout(ask, WAIT);
  }
  // what of the present values `desat run` would say, or this page was not made for
  function warn() {
    const beyond = sliders().filter((s) => !within(s, at(s))).map((s) => `${s.name} = ${amount(at(s), s)}: outside `
      + `${range(s)}, for which this page was made; \`desat run\` says what else it warns of`);
    const lines = [...address, ...beyond, ...warned];
    $id("warnings").replaceChildren(...lines.map((text) => make("li", { textContent: text })));
  }
  function ask() {
    asked += 1;
    $id("state").textContent = "flying …";
    $id("fault").textContent = "";
    answer();
    worker.postMessage({ id: asked, law, moved });
  }

  // --- charts --------------------------------------------------------------------------------------

  const NONE = "without management (estimated)";
  const REQUIRED = "required";
  const MODEL = "with management, by the model";
  const plotsOf = (l) => {
    const { managed, plots } = told.laws[l];
    const thresholds = told.laws[l].dumps?.of_wheels ? ["a dump begins", "a dump ends"] : [];
    const first = managed?.drawn && { title: "Momentum of the fullest wheel, with management and without",
      label: managed.label, names: ["with management", NONE], log: false,
      limits: ["capacity", ...thresholds, ...managed.shares.map((share) => `${REQUIRED}: ${number(100 * share)} %`)] };
    return [...(first ? [first] : []), ...plots.map((p) => ({ ...p,
      names: p.norm ? p.signals : p.lines.flat().filter(Boolean), limits: p.limits.map((x) => x.name) }))];
  };
  const known = (values) => Array.from(values, (v) => (Number.isFinite(v) ? v : null));
  const most = (lines) => lines.flat().reduce((m, v) => Math.max(m, Math.abs(v ?? 0)), 0);

  // the lines of a chart: those of kept flights in pale, its own, those of a table, and the limits
  function content(i, flight = shown, kept = references) {
    const of = plotsOf(flight.law)[i];
    const { times } = flight;
    const lines = flight.plots[i].lines.map(known);
    const hue = (k) => told.colours[k % told.colours.length];
    const dashes = (k) => told.dashes[k % told.dashes.length];
    const series = kept.flatMap((other, j) => {
      if (!other) return [];
      const plots = plotsOf(other.law);
      const at = plots.findIndex((p) => p.title === of.title);
      return at < 0 ? [] : other.plots[at].lines.map((y, k) => ({ label: `${plots[at].names[k]}, kept ${j + 1}`,
        times: other.times, y: known(y), pale: true, width: 1.4, stroke: hue(k), dash: told.dashes[j] }));
    });
    lines.forEach((y, k) => series.push({ label: of.names[k], times, y, stroke: hue(k), dash: lines.length > 1 ? dashes(k) : [], width: 1.4 }));
    if (i === 0 && model?.id === asked && model.line.length === times.length) {
      series.push({ label: MODEL, times, y: known(model.line), stroke: hue(2), dash: [2, 2], width: 1.4 });
    }
    (own?.columns ?? []).filter(({ title }) => title === of.title).forEach(({ name, y }, k) => series.push({ label: `${name}, ${own.name}`,
      times: own.times, y, stroke: hue(lines.length + 1 + k), dash: dashes(lines.length + 1 + k), width: 1.4 }));
    const signed = lines.some((y) => y.some((v) => v < 0));
    const top = most(lines);
    const far = [];
    const levels = [];
    const beyond = [];
    flight.plots[i].limits.forEach((limit, k) => {
      const value = pulled?.i === i && pulled.k === k ? pulled.value : limit;
      const label = of.limits[k];
      const named = `${signed ? "±" : ""}${number(value)} ${label}`;
      // of a flight under way nothing is said yet
      const isFar = flight.numbers ? value > 10 * top : charts[i]?.isFar?.[k];
      beyond.push(isFar);
      if (isFar) return far.push(`${named}: far beyond`);
      for (const v of signed ? [value, -value] : [value]) {
        levels.push({ value: v, k, label: v === value ? named : "" });
        series.push({ label: v === value ? label : "", times, y: lines[0].map(() => v), stroke: told.limit, width: 1.1,
          dash: label.startsWith(REQUIRED) ? [7, 4] : [2, 3] });
      }
    });
    return { of, series, levels, far, isFar: beyond };
  }
  const joined = (series) => uPlot.join(series.map((s) => [s.times, s.y]));
  const keyOf = (i, series) => [...series.map((s) => s.label + s.pale), dark.matches, ...shown.handles[i].map((h) => h?.name)].join("\n");

  // Another value of a slider whose limit stands at a level of a chart.
  function pull(i, k, level) {
    const { name, slope } = shown.handles[i][k];
    const slider = sliders().find((s) => s.name === name);
    if (!slider || shown.law !== law) return; // another law, which has not flown yet
    const [from, limit] = [shown.moved[name] ?? slider.start, shown.plots[i].limits[k]];
    const value = grid(slider, from + (level - limit) / slope);
    pulled = { i, k, value: limit + (value - from) * slope };
    moved[name] = value;
    changed();
    draw();
  }

  // What a limit is dragged by, where a slider moves it: by pointer, or by arrows.
  function grips(i) {
    const { plot } = charts[i];
    const { limits } = plotsOf(shown.law)[i];
    charts[i].grips = shown.handles[i].map((handle, k) => {
      const isOwn = shown.law === law && !limits[k].startsWith(REQUIRED); // that follows what it is a share of
      const slider = handle && isOwn && sliders().find((s) => s.name === handle.name);
      if (!slider) return null;
      const grip = make("span", { className: "grip", tabIndex: 0, textContent: "↕", title: `${slider.title}: drag it, or arrow keys` });
      for (const [key, value] of Object.entries({ role: "slider", "aria-label": slider.title, "aria-orientation": "vertical",
        "aria-valuemin": slider.low, "aria-valuemax": slider.high })) grip.setAttribute(key, value);
      grip.onpointerdown = (e) => {
        e.preventDefault();
        grip.focus({ preventScroll: true });
        // of where it began: a sentence of more lines may push the chart down meanwhile
        dragged = { i, k, range: [plot.scales.y.min, plot.scales.y.max], top: plot.over.getBoundingClientRect().top };
      };
      grip.onkeydown = (e) => {
        const way = { ArrowUp: 1, ArrowDown: -1 }[e.key];
        if (!way) return;
        e.preventDefault();
        const now = pulled?.i === i && pulled.k === k ? pulled.value : shown.plots[i].limits[k];
        const [low, high] = [plot.scales.y.min, plot.scales.y.max];
        pull(i, k, now + way * Math.max((high - low) / 100, 0.006 * Math.abs(handle.slope) * (slider.high - slider.low)));
      };
      plot.over.append(grip);
      return grip;
    });
  }
  document.addEventListener("pointermove", (e) => { // of the page: a chart that is made anew has other grips
    if (!dragged) return;
    const { plot } = charts[dragged.i];
    pull(dragged.i, dragged.k, plot.posToVal(e.clientY - dragged.top, "y"));
  });
  for (const end of ["pointerup", "pointercancel"]) document.addEventListener(end, () => {
    if (!dragged) return;
    dragged = null;
    draw();
  });
  function placeGrips(i) {
    const { plot, levels } = charts[i];
    charts[i].grips?.forEach((grip, k) => {
      if (!grip) return;
      const level = levels.find((l) => l.k === k);
      const slider = shown.law === law && sliders().find((s) => s.name === shown.handles[i][k].name);
      grip.hidden = !level || !slider;
      if (grip.hidden) return;
      grip.style.top = `${plot.valToPos(level.value, "y")}px`;
      grip.setAttribute("aria-valuenow", at(slider));
    });
  }

  const tall = (i) => (i === 0 && innerWidth <= 800 ? 190 : 270); // px; the first stays in sight there
  function chart(i) {
    const { of, series, levels, far, isFar } = content(i);
    const place = charts[i].place;
    const focused = charts[i].grips?.indexOf(document.activeElement);
    Object.assign(charts[i], { key: keyOf(i, series), levels, isFar, grips: null });
    charts[i].plot?.destroy();
    const ink = css("--ink");
    const axis = { stroke: ink, grid: { stroke: css("--grid"), width: 1 }, ticks: { stroke: ink, width: 1, size: 5 },
      font: "12px system-ui", labelFont: "12px system-ui", labelSize: 18 };
    const shade = (s) => (s.pale ? `${colour(s.stroke)}55` : colour(s.stroke));
    const width = (u, labels) => 16 + 7.5 * Math.max(3, ...(labels || []).map((s) => (s || "").length));
    charts[i].plot = new uPlot({
      width: place.clientWidth, height: tall(i),
      scales: { x: { time: false, range: () => [told.start, shown.end] }, y: { distr: of.log ? 3 : 1,
        range: (u, low, high) => {
          if (dragged?.i === i) return dragged.range;
          if (low === null) return [0, 1];
          if (of.log) return uPlot.rangeLog(low, high, 10, false);
          const size = Math.max(Math.abs(low), Math.abs(high));  // a constant differs by its rounding
          const rim = high - low > 1e-12 * size ? 0.05 * (high - low) : 0.05 * size || 1;
          return [low >= 0 ? Math.min(0, low) : low - rim, high + rim];
        } } },
      axes: [
        { ...axis, label: `time [${told.time_unit}]`,
          splits: (u, a, low, high) => multiples(low / told.seconds, high / told.seconds, (u.width - 80) / 75).map((t) => t * told.seconds),
          values: (u, all) => all.map((t) => text(t / told.seconds, finer(apart(all, told.seconds)))) },
        { ...axis, label: of.label, size: width,
          splits: of.log ? (u, a, low, high) => decades(low, high) : (u, a, low, high) => multiples(low, high, 7), filter: (u, all) => all,
          values: (u, all) => all.map((v) => text(v, of.log ? v : finer(apart(all, 1)))) },
      ],
      series: [{ label: "time", value: (u, t) => (t === null ? "–" : `${text(t / told.seconds, (shown.end - told.start) / told.seconds / 1e4)} ${told.time_unit}`) },
        ...series.map((s) => ({ label: s.label, stroke: shade(s), width: s.width, dash: s.dash, points: { show: false },
          value: (u, v) => reading(v, (u.scales.y.max - u.scales.y.min) / 1e4, of.label) }))],
      cursor: { y: false, drag: { x: false, y: false }, sync: { key: "time", setSeries: false, scales: ["x", null] } },
      hooks: { draw: [(u) => {
        const named = [];
        for (const { label, value } of charts[i].levels) {
          nameLevel(u.ctx, label, colour(told.limit), u.bbox.left + u.bbox.width, u.valToPos(value, "y", true), u.bbox.top, named);
        }
        placeGrips(i);
      }], setCursor: [(u) => !seeking && u.cursor.left >= 0 && scene.at(u.posToVal(u.cursor.left, "x"))] },
      legend: { markers: { width: 2, dash: border } },
    }, joined(series), place);
    grips(i);
    placeGrips(i);
    charts[i].grips[focused]?.focus({ preventScroll: true });
    operable(place);
    // the other side of a limit needs no name
    [...place.querySelectorAll(".u-legend tr")].forEach((row, k) => { if (k && !series[k - 1].label) row.style.display = "none"; });
    charts[i].note.textContent = far.join("; ");
  }

  function draw() {
    const plots = plotsOf(shown.law);
    if (charts.map((c) => c.title).join("\n") !== plots.map((p) => p.title).join("\n")) {
      for (const c of charts) c.plot?.destroy();
      charts = plots.map((p) => ({ title: p.title, place: make("div"), note: make("p", { className: "note" }),
        bar: make("p", { className: "note save" }) }));
      charts.forEach((c, i) => saveBar(c.bar, c.title, () => chartSvg(charts[i].plot, c.title), () => chartCsv(i)));
      const figures = charts.map((c) => make("figure", {}, make("figcaption", { textContent: c.title }), c.place, c.note, c.bar));
      $id("first").replaceChildren(...figures.slice(0, 1));
      $id("plots").replaceChildren(...figures.slice(1));
    }
    plots.forEach((p, i) => {
      const { series, levels, far, isFar } = content(i);
      if (!charts[i].plot || charts[i].key !== keyOf(i, series)) return chart(i);
      charts[i].note.textContent = far.join("; ");
      Object.assign(charts[i], { levels, isFar });
      charts[i].plot.setData(joined(series));
    });
    numbers();
    answer();
    if (shown.view) scene.show(shown.view);
  }

  // A flight with all its samples, of which charts show minima and maxima; null where another flight
  // has taken its place in the worker.
  const waiting = [];
  function samplesOf(flight) {
    flight.whole ??= flight.id === asked ? new Promise((give) => {
      waiting.push((samples) => give({ ...flight, ...samples }));
      worker.postMessage({ samples: true });
    }) : Promise.resolve(null);
    return flight.whole;
  }

  // The values of a chart: all samples, or what the first line says.
  async function chartCsv(i) {
    const [drawn, kept] = [shown, [...references]];
    const [whole, ...others] = await Promise.all([drawn, ...kept].map(samplesOf));
    const pale = whole ? others : [];
    const { of, series } = content(i, whole ?? drawn, pale);
    const unit = unitOf(of.label) && ` [${unitOf(of.label)}]`;
    const notes = (whole ? "" : binsLine(drawn.times.length, Math.round((drawn.end - told.start) / told.step) + 1))
      + (pale.filter(Boolean).length < kept.length ? "# without kept flights whose samples are gone\n" : "");
    return notes + csvText(["time [s]", ...series.map((s) => (s.label || "limit") + unit)], joined(series));
  }

  // A chart as an SVG on white.
  function chartSvg(u, title) {
    const safe = (s) => String(s).replace(/[&<>]/g, (c) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;" })[c]);
    const ratio = devicePixelRatio || 1;
    const [x0, y0, wide, high] = ["left", "top", "width", "height"].map((k) => u.bbox[k] / ratio);
    const parts = [`<text x="${x0}" y="14" font-weight="600">${safe(title)}</text>`];
    const top = 22; // of the title
    const place = (v, scale) => (scale === "x" ? x0 : y0 + top) + u.valToPos(v, scale);
    u.axes.forEach((axis, k) => axis._splits.forEach((v, i) => {
      const p = place(v, axis.scale);
      const label = safe(axis._values[i] ?? "");
      parts.push(k === 0 ? `<path d="M${p} ${y0 + top}v${high}" stroke="#ddd"/><text x="${p}" y="${y0 + top + high + 18}" text-anchor="middle">${label}</text>`
        : `<path d="M${x0} ${p}h${wide}" stroke="#ddd"/><text x="${x0 - 8}" y="${p + 4}" text-anchor="end">${label}</text>`);
    }));
    parts.push(`<path d="M${x0} ${y0 + top}v${high}h${wide}" fill="none" stroke="#222"/>`);
    parts.push(`<text x="${x0 + wide / 2}" y="${y0 + top + high + 36}" text-anchor="middle">${safe(u.axes[0].label)}</text>`);
    parts.push(`<text transform="translate(14 ${y0 + top + high / 2})rotate(-90)" text-anchor="middle">${safe(u.axes[1].label)}</text>`);
    let key = x0;
    u.series.slice(1).forEach((s, i) => {
      const path = [];
      let open = false;
      u.data[i + 1].forEach((v, k) => {
        if (v === undefined) return; // of another line
        if (v === null) { open = false; return; }
        path.push(`${open ? "L" : "M"}${place(u.data[0][k], "x").toFixed(1)} ${place(v, "y").toFixed(1)}`);
        open = true;
      });
      const look = `stroke="${s.stroke()}" stroke-width="${s.width}"${s.dash ? ` stroke-dasharray="${s.dash}"` : ""}`;
      parts.push(`<path d="${path.join("")}" fill="none" ${look}/>`);
      if (!s.label) return;
      const y = y0 + top + high + 56;
      parts.push(`<path d="M${key} ${y - 4}h16" fill="none" ${look}/><text x="${key + 20}" y="${y}">${safe(s.label)}</text>`);
      key += 36 + 6.5 * s.label.length;
    });
    return `<svg xmlns="http://www.w3.org/2000/svg" width="${Math.max(u.width, key)}" height="${y0 + top + high + 66}" `
      + `font-family="system-ui, sans-serif" font-size="12" fill="#222">${parts.join("")}</svg>`;
  }

  // The sentence that answers: how full the wheels get, with and without management; until the flight has
  // come what the model says, in the same place, so that nothing below moves.
  function answer() {
    const place = $id("answer");
    if ($id("fault").textContent) return place.replaceChildren();
    if (shown?.id !== asked || !shown.numbers) {
      place.className = "note";
      place.style.minHeight = `${place.offsetHeight}px`;
      const text = model?.id === asked ? `By the model: ${model.text}; flying …` : "Flying …";
      return place.replaceChildren(make("b", { textContent: text }));
    }
    const { managed, ends } = told.laws[shown.law];
    const titles = titlesOf(shown.law);
    const judged = Object.entries(titles).filter(([name]) => name in shown.numbers)
      .map(([name, t]) => ({ title: t.title, ...t.required, value: shown.numbers[name] }));
    const missed = judged.filter((v) => failed(v, v.value)).map((v) => v.title);
    // as Verdict.margin of a run: (allowed - used) / allowed
    const margins = judged.flatMap((v) => [[1, v.max], [-1, v.min]].filter(([, limit]) => limit && v.value !== null)
      .map(([sign, limit]) => [sign * (limit - v.value) / Math.abs(limit), v.title])).sort((a, b) => a[0] - b[0]);
    const holds = !missed.length && !shown.unmet.length;
    const hours = (t) => (t - told.start >= 2 * 86400 ? `${number((t - told.start) / 86400)} d`
      : `${number((t - told.start) / told.seconds)} ${told.time_unit}`);
    const when = (line, limit) => {
      const k = line.findIndex((v) => v >= limit);
      return k < 0 ? null : shown.times[k];
    };
    const parts = [];
    if (ends) {
      const asks = Object.keys(titles).find((name) => name in shown.numbers && titles[name].required.max !== undefined);
      const { title, unit } = titles[asks] || { title: ends.text };
      parts.push(shown.ended && asks ? `${title}: ${number(shown.numbers[asks])} ${unit}`
        : `${shown.ended ? "Reached" : "Not reached"} ${shown.ended ? "after" : "within"} ${hours(shown.end)}: ${title}`);
    }
    if (managed?.drawn && !ends) {
      const [capacity] = shown.plots[0].limits;
      const [own, none] = shown.plots[0].lines;
      const full = when(own, 0.999 * capacity);
      if (full !== null) parts.push(`Does not hold: a wheel is full after ${hours(full)}`);
      else if (!holds) parts.push("Does not hold");
      else parts.push(margins.length ? `Holds with a margin of ${number(100 * margins[0][0])} % (${margins[0][1]})` : "Holds");
      if (none) {
        const without = when(none, capacity);
        parts.push(without === null ? `without management it would be ${number(100 * most([known(none)]) / capacity)} % full`
          : `without management full after ${hours(without)}`);
      }
    }
    if (missed.length) parts.push(`NOT MET: ${missed.join(", ")}`);
    const checks = shown.unmet.length;
    if (checks) parts.push(`Not met: ${checks} check${checks > 1 ? "s" : ""} of the flight, among the warnings`);
    const bad = checks || missed.length || /^(Not|Does)/.test(parts[0] || "");
    place.className = bad ? "bad" : "ok";
    place.replaceChildren(...(parts.length ? [make("b", { textContent: `${parts.join("; ")}.` })] : []));
  }

  // --- numbers -------------------------------------------------------------------------------------

  const titlesOf = (l) => {
    const { numbers: own, managed } = told.laws[l];
    const found = Object.fromEntries(own.map((n) => [n.name, { title: n.title, unit: n.unit, required: n.required }]));
    for (const [name, [title, unit]] of Object.entries(managed ? managed.titles : {})) {
      found[name] ??= { title, unit, required: managed.required[name] || {} };
    }
    return found;
  };
  const failed = ({ min, max }, value) => (min !== undefined || max !== undefined)
    && (value === null || value < min || value > max);
  // Of units the one in which a table with these rows shows them, and the factor to it: one a quantity,
  // as report/table.py chooses it.
  function scalesOf(rows) {
    return Object.assign({}, ...told.scales.map((units) => {
      const own = rows.filter(({ unit }) => unit in units);
      if (new Set(own.map(({ unit }) => unit)).size < 2) return {};
      const most = Math.max(0, ...own.flatMap(({ unit, values }) => values.map((v) => Math.abs(v ?? 0) * units[unit])));
      const all = Object.entries(units);
      const [shownUnit, whole] = most === 0 ? all[0] : all.find(([, factor]) => most >= factor) ?? all.at(-1);
      return Object.fromEntries(all.map(([unit, factor]) => [unit, { unit: shownUnit, by: factor / whole }]));
    }));
  }
  function requirement({ min, max }, value, by) {
    const limits = [...(min === undefined ? [] : [`at least ${number(min * by)}`]), ...(max === undefined ? [] : [`at most ${number(max * by)}`])];
    if (!limits.length) return make("td");
    const met = !failed({ min, max }, value);
    return make("td", { className: met ? "ok" : "bad", textContent: `${limits.join(", ")}: ${met ? "met" : "NOT MET"}` });
  }
  function numbers() {
    const titles = titlesOf(shown.law);
    const head = make("tr", {}, make("td"), make("th", { className: "n", textContent: "now" }),
      ...references.map((_, j) => make("th", { className: "n pale", textContent: `kept ${j + 1}` })), make("th", { textContent: "unit" }), make("th", { textContent: "required" }));
    const entries = Object.entries(titles).filter(([name]) => name in (shown.numbers || {}));
    const scales = scalesOf(entries.map(([name, { unit, required: { min, max } }]) => ({ unit,
      values: [shown.numbers[name], min, max, ...references.map((r) => r.numbers?.[name])] })));
    const rows = entries.map(([name, t]) => {
      const value = shown.numbers[name];
      const { unit, by } = scales[t.unit] ?? { unit: t.unit, by: 1 };
      const inUnit = (v) => number(v && v * by);
      const row = make("tr", {}, make("td", { textContent: t.title }), make("td", { className: "n", textContent: inUnit(value) }),
        ...references.map((r) => make("td", { className: "n pale", textContent: inUnit(r.numbers?.[name]) })),
        make("td", { textContent: unit }), requirement(t.required, value, by));
      [row.dataset.number, row.dataset.unit] = [name, unit];
      return row;
    });
    if (shown.numbers) $id("numbers").replaceChildren(head, ...rows);
    $id("numbers").classList.toggle("pale", !shown.numbers);
  }

  // What the model says at once, until the flight has come: its line, and its dumps.
  function byModel({ id, model: { line, times } }) {
    model = { id, line };
    const since = (t) => `${number((t - told.start) / told.seconds)} ${told.time_unit}`;
    const each = times.length > 1 ? `, then one each ${number((times.at(-1) - times[0]) / (times.length - 1) / told.seconds)} ${told.time_unit}` : "";
    model.text = times.length ? `${times.length} ${times.length > 1 ? "dumps" : "dump"}, the first after ${since(times[0])}${each}` : "no dump";
    if (shown) draw();
  }

  // --- a table of the reader's ---------------------------------------------------------------------

  const SECONDS = { s: 1, min: 60, h: 3600, d: 86400 };
  const PREFIXES = Object.entries({ "": 1, n: 1e-9, u: 1e-6, "µ": 1e-6, m: 1e-3, k: 1e3 });
  const unitIn = (label) => unitOf(label).replace(/[\s.·*]/g, "");
  function between(from, to) { // the factor from one unit to another that differs by its prefix; else null
    for (const [prefix, factor] of PREFIXES) {
      if (!from.startsWith(prefix)) continue;
      const other = PREFIXES.find(([p]) => to === p + from.slice(prefix.length));
      if (other) return factor / other[1];
    }
    return null;
  }
  // A CSV: time, then columns that are drawn in the chart with a line of that name, else in the first
  // one of their unit. An Error says what cannot be read.
  function tableOfCsv(name, content) {
    const lines = content.replace(/^\uFEFF/, "").split(/\r?\n/).filter((line) => line.trim() && !line.startsWith("#"));
    const separator = ["\t", ";", ","].find((s) => lines[0]?.includes(s));
    if (!separator || lines.length < 2) throw new Error(`${name}: a line of names and lines of numbers are needed, as a chart's CSV has them`);
    const cells = (line) => (line.match(new RegExp(`(^|${separator})("([^"]|"")*"|[^${separator}]*)`, "g")) ?? [])
      .map((cell, k) => (k ? cell.slice(1) : cell).trim().replace(/^"(.*)"$/, "$1").replace(/""/g, '"'));
    const [head, ...rows] = lines.map(cells);
    const seconds = /^(time|t)\s*\[/i.test(head[0]) ? SECONDS[unitIn(head[0])] : undefined;
    if (!seconds) throw new Error(`${name}: the first column is "${head[0]}"; it has to be time [s], [min], [h] or [d]`);
    const value = (text, k, column) => {
      if (!text || /^nan$/i.test(text)) return null;
      if (!Number.isFinite(Number(text))) throw new Error(`${name}: row ${k + 1}, ${head[column]}: "${text}" is not a number`);
      return Number(text);
    };
    const times = rows.map((row, k) => (value(row[0], k, 0) ?? NaN) * seconds);
    const late = times.findIndex((t, k) => !(k ? t > times[k - 1] : t === t));
    if (late >= 0) throw new Error(`${name}: row ${late + 1}: time "${rows[late][0]}" does not come after the one before`);
    const plots = plotsOf(shown.law);
    const [columns, left] = [[], []];
    head.slice(1).forEach((label, column) => {
      const title = label.replace(/\s*\[[^\]]*\]\s*$/, "");
      const fitting = plots.filter((p) => between(unitIn(label), unitIn(p.label)) !== null);
      const plot = fitting.find((p) => p.names.includes(title)) ?? fitting[0];
      if (!plot) return left.push(label);
      const scale = between(unitIn(label), unitIn(plot.label));
      const y = rows.map((row, k) => { const v = value(row[column + 1], k, column + 1); return v === null ? v : v * scale; });
      columns.push({ name: title, title: plot.title, y });
    });
    const units = [...new Set(plots.map((p) => unitIn(p.label)))].map((u) => `[${u}]`).join(", ");
    if (!columns.length) throw new Error(`${name}: no chart has the unit of ${left.join(", ")}; there is ${units}`);
    if (!times.some((t) => told.start <= t && t <= shown.end)) throw new Error(`${name}: no row lies within the flight`);
    const text = [name, ...columns.map((c) => `${c.name} in "${c.title}"`), ...left.map((l) => `${l} in none, whose units are ${units}`)].join("; ");
    return { name, times, columns, text };
  }
  async function read(file) {
    $id("refused").textContent = "";
    try {
      if (!shown) throw new Error(`${file.name}: wait for the first flight`);
      own = tableOfCsv(file.name, await file.text());
      beside();
    } catch (error) {
      $id("refused").textContent = error.message;
    }
  }
  document.addEventListener("dragover", (event) => event.preventDefault());
  document.addEventListener("drop", (event) => {
    event.preventDefault();
    if (event.dataTransfer.files[0]) read(event.dataTransfer.files[0]);
  });

  // --- the worker ----------------------------------------------------------------------------------

  const worker = new Worker(URL.createObjectURL(new Blob([$id("worker").textContent], { type: "text/javascript" })));
  worker.onmessage = ({ data }) => {
    if (data.ready) return ask();
    if (data.samples) return waiting.shift()(data.samples);
    if (data.id !== asked) return;
    if (data.model) return byModel(data);
    warned = data.warnings;
    warn();
    $id("fault").textContent = data.fault ? `${data.done ? `After ${data.done} steps: ` : "It cannot start: "}${data.fault}` : "";
    if (data.last) {
      const span = data.done * told.step;
      const flown = `${span < 3600 ? `${number(span)} s` : `${number(span / told.seconds)} ${told.time_unit}`} in ${data.seconds?.toFixed(2)} s`;
      $id("state").textContent = data.fault ? "" : `flown: ${flown}`;
      document.documentElement.dataset.flown = data.id; // for who waits
    } else $id("state").textContent = `flying … ${Math.round((100 * data.done) / told.steps)} %`;
    if (!data.plots.length) return answer();
    pulled = null;
    shown = { id: data.id, law, moved: { ...moved }, numbers: data.numbers, unmet: data.unmet ?? [], plots: data.plots, handles: data.handles, times: data.times,
      end: data.end, ended: data.ended, view: data.view };
    draw();
  };
  worker.onerror = (error) => { $id("fault").textContent = error.message; };

  fromAddress();
  controls();
  changed();
  clearTimeout(timer);
  dark.addEventListener("change", () => shown && draw());
  addEventListener("hashchange", () => { fromAddress(); controls(); changed(); });
  new ResizeObserver(() => charts.forEach(({ plot, place }, i) => {
    if (plot && place.clientWidth && place.clientWidth !== plot.width) plot.setSize({ width: place.clientWidth, height: tall(i) });
  })).observe(document.querySelector("#panes"));
  worker.postMessage({ told: { ...told, wasm: null }, wasm: bytes(told.wasm) });
  window.desat = { get shown() { return shown; }, get asked() { return asked; }, get charts() { return charts.map((c) => c.plot); }, command, scene };
})();
