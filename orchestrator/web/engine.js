"use strict";
// A loop in WebAssembly that flies with other values, and what its rows come to: plots and numbers.
// `told` is what the page says of the loops (page.py); `measures` and `$` stand above.
const ROWS = 1024; // a call, as shim.c has room for

// A product of numbers and parameters, as `desat run` evaluates it (system/expression.py).
function scalar(table, [name, element]) {
  let value = table[name];
  if (element) value = value[element - 1];
  if (!Array.isArray(value)) return value;
  const different = [...new Set(value.filter((v) => v !== 0))];
  if (different.length > 1) throw new Error(`${name} has elements that differ`);
  return different[0] ?? 0;
}
function evaluated(of, table) {
  if (typeof of === "number") return of;
  let result = 1;
  for (const [operator, factor] of of.factors) {
    const number = typeof factor === "number" ? factor : scalar(table, factor);
    if (operator === "/" && number === 0) throw new Error(`${of.text}: ${factor[0]} is 0`);
    result = operator === "/" ? result / number : result * number;
  }
  return result * of.scale;
}

const size = (values, form) => (form === "length" ? Math.sqrt(values.reduce((sum, x) => sum + x * x, 0))
  : Math.max(...values.map(Math.abs)));

// The parameter of a slider at a value in its own unit: a number, or a list of an array's elements.
function given(slider, value, before) {
  if (slider.form === "one") return value;
  if (slider.form === "element") return before.map((v, i) => (i === slider.element - 1 ? value : v));
  if (slider.form === "each") return slider.there.map((there) => (there ? value : 0));
  const whole = size(before, slider.form);
  return before.map((v) => v * (value / whole));
}
const own = (slider, shown) => shown * slider.factor + slider.offset;

// All parameters of a law that sliders move, and what follows from them. `moved`: of sliders by their
// names the value in the shown unit.
function tableOf(law, moved) {
  const table = { ...law.values };
  for (const slider of law.sliders) {
    if (!(slider.name in moved)) continue;
    for (const target of slider.targets) {
      if (target in table) table[target] = given(slider, own(slider, moved[slider.name]), table[target]);
    }
  }
  for (const follows of law.follows) {
    const { name, of, count, whole } = follows;
    if (whole) {
      const [from, element] = of.factors[0][1];
      const value = element ? table[from][element - 1] : table[from];
      table[name] = Array.isArray(value) ? value.map((v) => of.scale * v)
        : count ? Array(count).fill(of.scale * value) : of.scale * value;
    } else {
      const value = evaluated(of, table);
      table[name] = count ? Array(count).fill(value) : value;
    }
  }
  return table;
}

// What `desat run` warns of: parameters that were moved to where they usually are not, a line each, of
// an array one (system/check.py).
function unusual(law, table) {
  const lines = [];
  for (const { name, elements, low, high, unit } of law.usual) {
    if (String(table[name]) === String(law.values[name])) continue;
    const values = [table[name]].flat();
    const i = values.findIndex((value) => !(low <= value && value <= high));
    if (i < 0) continue;
    const shown = unit ? ` ${unit}` : "";
    lines.push(`${elements[i]} = ${general(values[i])}${shown}: usual is ${general(low)} to ${general(high)}${shown}`);
  }
  return lines;
}

// What `desat run` warns of before it flies the scenario as it is, less what was moved.
function stated(law, moved) {
  const targets = law.sliders.filter((s) => s.name in moved).flatMap((s) => s.targets);
  const lines = law.warnings.filter((line) => !targets.some((t) => line.includes(`${t} = `) || line.includes(`${t}[`)));
  return targets.length ? lines.map((line) => `as the scenario has it: ${line}`) : lines;
}

// The capacity of the smallest wheel (N m s).
const capacityOf = ({ of }, table) => Math.min(...table[of.rotors].filter((x) => x > 0)) * table[of.limit];

// The limits of the fullest wheel, and of a plot.
function limitsOfFullest({ managed, dumps }, table) {
  const capacity = capacityOf(managed, table);
  const thresholds = dumps?.of_wheels ? [table[dumps.begin], table[dumps.end]] : [];
  return [capacity, ...thresholds, ...managed.shares.map((share) => share * capacity)].map((x) => x * managed.scale);
}
const limitsOf = (plot, table) => plot.limits.map((l) => evaluated(l.value, table));

// Of each limit of the charts the slider that moves it, and how far by one of its shown unit; null
// where none does so in proportion.
function handlesOf(law, moved) {
  const levels = (more) => {
    const table = tableOf(law, { ...moved, ...more });
    return [...(law.managed?.drawn ? [limitsOfFullest(law, table)] : []), ...law.plots.map((of) => limitsOf(of, table))];
  };
  const now = levels({});
  const found = now.map((limits) => limits.map(() => null));
  for (const { name, start, low, high } of law.sliders) {
    const [first, step] = [moved[name] ?? start, (high - low) / 100];
    const [one, two] = [1, 2].map((n) => levels({ [name]: first + n * step }));
    now.forEach((limits, i) => limits.forEach((level, k) => {
      const [by, further] = [one[i][k] - level, two[i][k] - one[i][k]];
      if (by && Math.abs(further - by) < 1e-9 * Math.abs(by)) found[i][k] ??= { name, slope: by / step };
    }));
  }
  return found;
}

class Flight {
  constructor(told, module) {
    this.told = told;
    this.calls = new WebAssembly.Instance(module, {}).exports;
    this.calls._initialize();
  }

  said() {
    const bytes = new Uint8Array(this.calls.memory.buffer, this.calls.web_text());
    return new TextDecoder().decode(bytes.slice(0, bytes.indexOf(0)));
  }

  // A law as new, with other values; what it said where it cannot start, else nothing.
  begin(law, moved) {
    const { told, calls } = this;
    this.law = told.laws[law];
    this.made = 0;
    this.balanced = null;
    this.fault = "";
    this.warnings = [];
    this.ended = null; // {time} where the condition of `stop_when` has held for long enough
    this.since = null;
    this.columns = {};
    for (const [name, s] of Object.entries(this.law.series)) {
      this.columns[name] = new Float64Array((told.steps + (s.interval ? 0 : 1)) * s.size);
    }
    try {
      this.table = tableOf(this.law, moved);
      this.handles = handlesOf(this.law, moved);
    } catch (error) {
      return (this.fault = error.message);
    }
    this.warnings = [...stated(this.law, moved), ...unusual(this.law, this.table)];
    calls.web_open(law);
    for (const [name, first] of this.law.slots) {
      [this.table[name]].flat().forEach((value, i) => calls.web_set(first + i, value));
    }
    if (!calls.web_start(told.start)) return (this.fault = this.said());
    this.keep(0, 1, false);
    if (this.law.ends && !this.law.series[this.law.ends.series].interval) this.watch(0);
    return "";
  }

  // Rows of the module into columns: states are of the end of their step, all else is of it.
  keep(from, count, stepped) {
    const { calls, law, columns } = this;
    const rows = new Float64Array(calls.memory.buffer, calls.web_out(), count * law.width);
    for (const [name, s] of Object.entries(law.series)) {
      if (s.interval && !stepped) continue;
      const into = columns[name];
      let to = (from + (stepped && !s.interval ? 1 : 0)) * s.size;
      for (let k = 0; k < count; k++) {
        for (let i = 0; i < s.size; i++) into[to++] = rows[k * law.width + s.at + i];
      }
    }
  }

  // Some more steps; whether it goes on.
  some() {
    const { told, calls } = this;
    const wanted = Math.min(ROWS, told.steps - this.made);
    const count = calls.web_fly(wanted, told.start, this.made, told.step);
    this.keep(this.made, count, true);
    const before = this.made;
    this.made += count;
    if (count < wanted) this.fault = this.said();
    for (let k = before + 1; this.law.ends && k <= this.made && !this.ended; k++) this.watch(k);
    if (this.ended) [this.made, this.fault] = [this.ended.steps, ""];
    return !this.fault && !this.ended && this.made < told.steps;
  }

  // The condition of `stop_when` after step k, as runs/stopping.py has it.
  watch(k) {
    const { series, kind, limit, held } = this.law.ends;
    const { size, interval } = this.law.series[series];
    const row = interval ? k - 1 : k;
    const bound = evaluated(limit, this.table);
    let largest = 0, all = true;
    for (let i = 0; i < size; i++) {
      const value = this.columns[series][row * size + i];
      largest = Math.max(largest, Math.abs(value));
      all &&= value === bound;
    }
    const met = kind === "reaches" ? all : kind === "below" ? largest < bound : largest > bound;
    const time = this.told.start + row * this.told.step;
    if (!met) this.since = null;
    else if (this.since === null) this.since = time;
    if (met && k > 0 && time - this.since >= held - 1e-9) {
      this.ended = { steps: k, time: this.told.start + k * this.told.step };
    }
  }

  // Steps of which plots have room: those of the run, or those until it ended.
  get rows() {
    return (this.ended ? this.made : this.told.steps) + 1;
  }

  // Orbit and attitude, thinned, for scene.js; null where there is no attitude.
  view(most) {
    const { view, series } = this.law;
    if (!view.series.q || this.made < 1) return null;
    const stride = Math.ceil(this.rows / most);
    const count = Math.floor(this.made / stride) + 1;
    const found = {};
    for (const [name, of] of Object.entries(view.series)) {
      const { size } = series[of];
      const scale = name === "r" || name === "v" ? 1e-3 : 1; // km, km/s
      found[name] = Float64Array.from({ length: count * size },
        (_, i) => scale * this.columns[of][Math.floor(i / size) * stride * size + (i % size)]);
    }
    if (found.h) {
      const axes = this.table[view.axes] ?? this.law.values[view.axes];
      const wheels = axes.length / 3;
      const { h } = found;
      if (this.law.managed) {
        const { of, there } = this.law.managed;
        const [spin, limit] = [this.table[of.rotors], this.table[of.limit]];
        found.fill = Float64Array.from({ length: there.length * count }, (_, i) => {
          const w = there[i % there.length];
          return h[Math.floor(i / there.length) * wheels + w] / (spin[w] * limit);
        });
      }
      found.h = Float64Array.from({ length: 3 * count }, (_, i) => {
        let sum = 0;
        for (let w = 0; w < wheels; w++) sum += axes[(i % 3) * wheels + w] * h[Math.floor(i / 3) * wheels + w];
        return sum;
      });
    }
    if (found.fired) { // since the row before
      const nozzles = found.fired.length / count;
      found.fired = found.fired.map((t, i, all) => (i < nozzles ? 0 : t - all[i - nozzles]));
    }
    return { ...view, count, first: this.told.start, step: stride * this.told.step, series: found };
  }

  times(count) {
    return new Rows(Float64Array.from({ length: count },
      (_, k) => this.told.start + k * this.told.step), [count]);
  }

  // A series up to now, (rows, elements).
  series(name) {
    const s = this.law.series[name];
    const rows = this.made + (s.interval ? 0 : 1);
    return new Rows(this.columns[name].subarray(0, rows * s.size), [rows, s.size]);
  }

  // What a number or plot is of: its series, or what is derived of them.
  measured(of) {
    if (!of.derive) return of.signals.map((name) => this.series(name));
    let series = of.signals.map((name) => this.series(name));
    const rows = Math.min(...series.map($.len));
    series = series.map((s) => $.get(s, [{ slice: [0, rows] }]));
    const f = measures[of.derive];
    if (f.order[0] === "times") series.unshift(this.times(rows));
    const options = f.order.slice(series.length).map((k) => (k in of.own
      ? $.array([this.table[of.own[k]]].flat()) : of.how[k]));
    const found = f(...series, ...options);
    return [found.shape.length > 1 ? found : $.reshape(found, -1, 1)];
  }

  // As numbers/numbers.py has it; null: not reached.
  number(of) {
    let columns = this.measured(of);
    if (of.element) columns[0] = $.get(columns[0], [{ slice: [] }, { slice: [of.element - 1, of.element] }]);
    let rows = Math.min(...columns.map($.len));
    let times = this.times(rows);
    columns = columns.map((c) => $.get(c, [{ slice: [0, rows] }]));
    if (of.window) {
      const kept = $.and($.ge(times, of.window[0] - 1e-6), $.le(times, of.window[1] + 1e-6));
      times = $.get(times, [kept]);
      columns = columns.map((c) => $.get(c, [kept]));
      rows = $.len(times);
    }
    if (!rows) return null;
    const f = measures[of.measure];
    const options = f.order.slice(1 + columns.length).map((k) => (k in of.options
      ? (of.options[k].factors ? evaluated(of.options[k], this.table) : of.options[k]) : undefined));
    const value = f(times, ...columns, ...options);
    if (Number.isNaN(value)) return null;
    return of.percent ? (100 * value) / evaluated(of.whole, this.table) : value * of.scale;
  }

  // What the wheels hold together and would without management (rows, 3; N m s, body), as
  // analyses/management.py has it, and what that is made of; null with too few rows.
  balance() {
    if (this.balanced?.made !== this.made) this.balanced = { made: this.made, known: this.account() };
    return this.balanced.known;
  }

  account() {
    const { of, series, there } = this.law.managed;
    const rows = (k, more = 0) => (series[k] ? $.len(this.series(series[k])) + more : Infinity);
    const count = Math.min(rows("q"), rows("field"), rows("dipole", 1), rows("fired", 1));
    if (count < 4) return null;
    const cut = (k, n = count) => $.get(this.series(series[k]), [{ slice: [0, n] }]);
    const value = (k, ...shape) => $.reshape($.array(this.table[of[k]]), ...shape);
    const times = this.times(count);
    const wheels = this.table[of.axes].length / 3;
    const axes = value("axes", 3, wheels);
    const body = $.matmul(cut("omega"), $.T(measures.carrier(value("inertia", 3, 3), axes, value("spin", wheels))));
    let managed = $.mul(cut("impulse"), 0);
    if (series.dipole) managed = $.add(managed, measures.coil_impulse(times, cut("field"), cut("q"), cut("dipole", count - 1)));
    if (series.fired) managed = $.add(managed, measures.fired_impulse(times, cut("q"), this.series(series.fired)));
    const stored = $.matmul(cut("copy"), $.T(axes));
    const start = measures.momentum_at_start(cut("q"), cut("impulse"), stored, body);
    const without = measures.unmanaged(cut("q"), cut("impulse"), managed, body, start);
    const first = $.get(without, [{ slice: [0, 1] }]);
    const effect = measures.effect(stored, without, $.array(this.law.managed.target), first);
    const columns = (x) => $.T($.get($.T(x), [there]));
    return { times, without, effect, axes: columns(axes), h: columns(this.series(series.copy)), columns };
  }

  // The numbers of management, by name.
  managed() {
    const { names, series, coils, of, inverse, there } = this.law.managed;
    const found = {};
    const keep = (which, values) => which.forEach((name, i) => { found[name] = values[i]; });
    const known = this.balance();
    if (!known) return found;
    const { times, effect, axes, h, columns } = known;
    const own = $.array(inverse.map((r) => $.array(r)));
    keep(names.momentum, measures.of_momentum(this.times($.len(h)), h, axes, own));
    const dipole = series.dipole && this.series(series.dipole);
    if (coils && dipole && $.len(dipole) >= coils.period) {
      const most = this.table[coils.most[0]] * coils.most[1];
      keep(names.coils, measures.of_coils(dipole, $.array(coils.inverse.map((r) => $.array(r))), most, coils.period));
    }
    const rotors = $.get($.array(this.table[of.rotors]), [there]);
    found.momentum_margin = measures.margin(h, $.mul(rotors, this.table[of.limit]));
    const saturated = this.series(series.saturated);
    keep(names.wheels, measures.of_wheels(this.times(this.made + 1), saturated, columns(this.series(series.speed))));
    if (this.lost() === null) keep(names.balance, measures.off_target(times, effect[0], effect[1]));
    return found;
  }

  // The largest attitude error in the second half that counts as lost (deg), or null.
  lost() {
    const late = this.law.checks.law?.late;
    return late ? measures.largest_late_error(...late.map((name) => this.series(name))) : null;
  }

  // What `desat run` says is not met after a flight, whatever its scenario requires (analyses/health.py,
  // management.py, firings.py), a line each.
  unmet() {
    const { attitude, law, firings } = this.law.checks;
    const lines = this.sensors(measures.describe_dead_sensor);
    if (firings) lines.push(...measures.describe_silence(firings.name, this.times(this.made + 1), ...this.fired()));
    if (attitude) lines.push(...measures.describe_lost_attitude(...this.pair(attitude)));
    if (law?.rate) lines.push(...measures.describe_braking(law.name, this.series(law.rate)));
    const { managed } = this.law;
    const known = law?.holds && managed && this.lost() === null && this.balance();
    if (known) {
      const deadband = this.table[`${law.name}.h_deadband`] ?? law.deadband;
      lines.push(...measures.describe_effect(law.name, known.times, ...known.effect, deadband, capacityOf(managed, this.table)));
    }
    return lines;
  }

  // What it warns of after a flight, a line each.
  remarks() {
    const { wheels, attitude, firings } = this.law.checks;
    const lines = this.sensors(measures.describe_rare_sensor);
    if (wheels) lines.unshift(...measures.describe_full_wheels(wheels, this.series(`${wheels}.saturated_wheel`)));
    if (attitude) lines.push(...measures.describe_missed_attitude(...this.pair(attitude)));
    if (firings && !firings.scheduled) {
      const used = firings.spent ? this.series(firings.spent) : $.zeros(1);
      lines.push(...measures.describe_firings(firings.name, this.table[`${firings.name}.tank`] ?? firings.tank, used,
        this.times(this.made + 1), ...this.fired()));
    }
    const error = this.lost();
    if (error !== null && this.law.managed) {
      lines.push(`not checked: ${this.law.managed.names.balance.join(", ")}: ${measures.describe_lost(error)}`);
    }
    return lines;
  }

  // The lines of each sensor by a function of it.
  sensors(describe) {
    return this.law.checks.sensors.flatMap(({ name, valid, lost_to: codes, meaning }) =>
      describe(name, this.series(valid), codes ? this.series(codes) : $.array([]), meaning));
  }

  // Command, torque and on-time of the thrusters, and the momentum of the wheels.
  fired() {
    return this.law.checks.firings.series.map((name) => this.series(name));
  }

  // Times, an attitude and its reference, rows alike.
  pair(names) {
    const both = names.map((name) => this.series(name));
    const rows = Math.min(...both.map($.len));
    return [this.times(this.made + 1), ...both.map((s) => $.get(s, [{ slice: [0, rows] }]))];
  }

  // The fullest wheel with management and without, and its limits.
  fullest() {
    const { inverse, scale, series } = this.law.managed;
    const known = this.balance();
    const full = (h) => $.mul($.max($.abs(h), { axis: 1 }), scale).data;
    const lines = [full(this.series(series.h))];
    if (known) lines.push(full($.matmul(known.without, $.T($.array(inverse.map((r) => $.array(r)))))));
    return { lines, limits: limitsOfFullest(this.law, this.table) };
  }

  // What this flight leaves for a model of others (`modelled`): the attitude, and the
  // momentum that the wheels would hold without dumps, eci; null where there is no such model.
  free() {
    const { dumps, managed } = this.law;
    const known = dumps && !this.fault && !this.ended && this.lost() === null && this.balance();
    if (!known || $.len(known.without) <= this.made) return null;
    const q = this.columns[managed.series.q];
    const momentum = new Float64Array(known.without.data);
    for (let k = 0; k <= this.made; k++) turn(q, k, momentum, momentum, 1);
    return { law: this.law, table: this.table, q, momentum, errors: this.errors() };
  }

  // What sensors add to the momentum of each wheel (rows, wheels): noise by its seed, whatever is moved.
  errors() {
    const measured = this.columns[this.law.dumps.measured], wheels = this.columns[this.law.managed.series.copy];
    const errors = new Float64Array(wheels.length);
    if (measured) for (let i = 0; i < measured.length; i++) errors[i] = measured[i] - wheels[i];
    return errors;
  }

  // The numbers of the law, by name.
  numbers() {
    const found = {};
    for (const of of this.law.numbers) found[of.name] = this.number(of);
    return this.law.managed ? { ...found, ...this.managed() } : found;
  }

  // The lines of all charts: that of the fullest wheel where there is one, and the plots.
  charts() {
    const { managed, plots } = this.law;
    return [...(managed?.drawn ? [this.fullest()] : []), ...plots.map((of) => this.plot(of))];
  }

  // The lines of a plot, each an array of a value a row; and its limits.
  plot(of) {
    const lines = [];
    this.measured(of).forEach((values, k) => {
      const rows = $.mul(values, of.scales[k]);
      if (of.norm) lines.push($.norm(rows, { axis: 1 }).data);
      else {
        of.lines[k].forEach((name, i) => {
          if (name) lines.push($.get(rows, [{ slice: [] }, i]).data);
        });
      }
    });
    return { lines, limits: limitsOf(of, this.table) };
  }
}

// Turn vector k of `from` (or `at`) into that of `to` by attitude k: body to eci (sign 1) or back (-1),
// C(q)' v = v + w t + u x t with t = 2 u x v.
function turn(q, k, from, to, sign, at = k) {
  const a = sign * q[4 * k], b = sign * q[4 * k + 1], c = sign * q[4 * k + 2], w = q[4 * k + 3];
  const i = 3 * at, x = from[i], y = from[i + 1], z = from[i + 2];
  const p = 2 * (b * z - c * y), r = 2 * (c * x - a * z), s = 2 * (a * y - b * x);
  to[i] = x + w * p + b * s - c * r;
  to[i + 1] = y + w * r + c * p - a * s;
  to[i + 2] = z + w * s + a * r - b * p;
}

// The momentum without dumps (rows, 3; N m s, eci) with the parameters of `table` in place of those of a
// flight that was (`Flight.free`): dumps change nothing of it, wheels at the start add a constant, and a
// parameter of `disturbances` adds what it does to the craft of the scenario. null where another one differs.
function withMoved(told, law, table, { table: before, q, momentum }) {
  const { dumps, managed } = law;
  const { parameters, spacing } = dumps.disturbances;
  const ofDumps = (name) => [dumps.begin, dumps.end, dumps.torque, dumps.pulse].includes(name) || name.startsWith(`${dumps.thrusters}.`);
  const changed = (one, other) =>
    Object.keys(one).filter((name) => !ofDumps(name) && name !== dumps.start && String(one[name]) !== String(other[name]));
  const names = changed(table, before);
  const isKnown = (name) => name in parameters;
  if (!names.every(isKnown) || (names.length && !changed(before, law.values).every(isKnown))) return null;
  const starts = dumps.start in table && String(table[dumps.start]) !== String(before[dumps.start]);
  if (!starts && !names.length) return momentum;
  const sum = new Float64Array(momentum), change = (name, i) => table[name][i] - before[name][i];
  if (starts) {
    const axes = table[managed.of.axes], wheels = axes.length / 3, added = [0, 0, 0];
    axes.forEach((x, i) => { added[Math.floor(i / wheels)] += x * change(dumps.start, i % wheels); });
    turn(q, 0, added, added, 1);
    for (let i = 0; i < sum.length; i++) sum[i] += added[i % 3];
  }
  for (const name of names) {
    const each = decoded(parameters[name]), size = each.length / table[name].length;
    const nodes = new Float64Array(size);
    table[name].forEach((_, e) => { for (let i = 0; i < size; i++) nodes[i] += change(name, e) * each[e * size + i]; });
    for (let k = 0; 3 * k < sum.length; k++) {
      const at = Math.min((k * told.step) / spacing, size / 3 - 1), n = Math.min(Math.floor(at), size / 3 - 2);
      for (let j = 0; j < 3; j++) sum[3 * k + j] += nodes[3 * n + j] + (at - n) * (nodes[3 * n + 3 + j] - nodes[3 * n + j]);
    }
  }
  return sum;
}

const decodings = new Map();
function decoded(base64) {
  if (!decodings.has(base64)) {
    decodings.set(base64, new Float32Array(Uint8Array.from(atob(base64), (c) => c.charCodeAt(0)).buffer));
  }
  return decodings.get(base64);
}

// The fullest wheel with moved parameters, by the sum of what the disturbances leave in a flight that was
// (`Flight.free`), and the times of its dumps; null where the model does not know what they change.
function modelled(told, law, moved, free) {
  const { dumps, managed } = law, { q, errors } = free;
  const table = tableOf(law, moved);
  const momentum = withMoved(told, law, table, free);
  if (!momentum) return null;
  const [begin, end, torque, pulse, sample] = ["begin", "end", "torque", "pulse", "sample"].map((k) => table[dumps[k]]);
  const rows = momentum.length / 3, times = [], line = new Float64Array(rows), every = Math.round(sample / told.step);
  const inside = [0, 0, 0], gone = [0, 0, 0], inverse = managed.inverse.flat();
  const wheels = errors.length / rows, axes = table[managed.of.axes], seen = [0, 0, 0], carried = [0, 0, 0];
  let isDumping = false, near = 0;
  for (let k = 0; k < rows; k++) { // without arrays of a row: a move is answered while it goes on
    const i = 3 * k;
    let fullest = 0, fill = 0;
    for (let j = 0; j < 3; j++) inside[j] = momentum[i + j] - gone[j];
    turn(q, k, inside, inside, -1, 0);
    const x = inside[0], y = inside[1], z = inside[2];
    for (let w = 0; w < wheels; w++) {
      const h = inverse[3 * w] * x + inverse[3 * w + 1] * y + inverse[3 * w + 2] * z;
      fullest = Math.max(fullest, Math.abs(h));
      fill = Math.max(fill, Math.abs(h + errors[k * wheels + w]));
    }
    line[k] = managed.scale * fullest;
    if (k % every || (dumps.of_wheels && !isDumping && fill < begin)) continue;
    for (let j = 0; j < 3; j++) {
      seen[j] = inside[j];
      for (let w = 0; w < wheels; w++) seen[j] += axes[j * wheels + w] * errors[k * wheels + w];
    }
    const size = Math.hypot(...seen);
    if (!dumps.of_wheels) fill = size;
    // a sample of manager_threshold (components/blocks/manager_threshold.py, `dump`)
    if (isDumping) isDumping = near < dumps.samples && fill > end;
    else if (fill >= begin) {
      isDumping = true;
      near = 0;
      carried.fill(0);
      times.push(told.start + k * told.step);
    }
    if (!isDumping) continue;
    const rest = 1 - end / fill, wanted = (size * rest) / sample;
    near = wanted <= torque ? near + 1 : 0;
    if (seen.every((h, j) => Math.abs(rest * h) < 0.5 * pulse[j])) near = dumps.samples;
    const share = (sample * Math.min(torque, Math.max(wanted, dumps.last * torque))) / size;
    for (let j = 0; j < 3; j++) {
      const impulse = share * seen[j] + carried[j];
      const least = Math.min(Math.abs(impulse), Math.abs(rest * seen[j]) + 0.5 * pulse[j]);
      const fired = pulse[j] ? Math.sign(impulse) * pulse[j] * Math.floor(least / pulse[j]) : impulse;
      carried[j] = impulse - fired;
      seen[j] = fired;
    }
    turn(q, k, seen, seen, 1, 0);
    for (let j = 0; j < 3; j++) gone[j] += seen[j];
  }
  return { line, times };
}

// Least and most of each of so many parts of lines of a run of so many rows, nan where a line has not
// come yet: as figures/interactive.py.
function thinned(lines, rows, parts) {
  return lines.map((y) => {
    if (rows <= 2 * parts) return Float64Array.from({ length: rows }, (_, k) => y[k] ?? NaN);
    const ends = new Float64Array(2 * parts).fill(NaN);
    for (let p = 0; p < parts; p++) {
      const [from, to] = [0, 1].map((d) => Math.min(y.length, Math.floor(((p + d) * rows) / parts)));
      if (from === to) break;
      let [low, high] = [y[from], y[from]];
      for (let k = from + 1; k < to; k++) {
        if (y[k] < low) low = y[k];
        if (y[k] > high) high = y[k];
      }
      const falls = y[from] > y[to - 1];
      ends[2 * p] = falls ? high : low;
      ends[2 * p + 1] = falls ? low : high;
    }
    return ends;
  });
}
function thinnedTimes(told, rows, parts) {
  const { start, step } = told;
  if (rows <= 2 * parts) return Float64Array.from({ length: rows }, (_, k) => start + k * step);
  const wide = ((rows - 1) * step) / parts;
  const times = Float64Array.from({ length: 2 * parts },
    (_, i) => start + ((i >> 1) + (i % 2 ? 0.75 : 0.25)) * wide);
  times[0] = start;
  times[2 * parts - 1] = start + (rows - 1) * step;
  return times;
}
