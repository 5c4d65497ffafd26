"use strict";
// What the measures, which are translated from their Python, use of numpy: arrays of doubles, row by
// row. A truth is a 1 of an array whose `truth` is set.
class Rows {
  constructor(data, shape, truth = false) {
    this.data = data;
    this.shape = shape;
    this.truth = truth;
  }
  * [Symbol.iterator]() {
    for (let i = 0; i < this.shape[0]; i++) yield $.get(this, [i]);
  }
}

const count = (shape) => shape.reduce((n, k) => n * k, 1);
const strides = (shape) => shape.map((_, i) => count(shape.slice(i + 1)));
const asRows = (x) => (x instanceof Rows ? x : Array.isArray(x) ? $.array(x)
  : new Rows(Float64Array.of(Number(x)), [], typeof x === "boolean"));
const plain = (x) => (x instanceof Rows && !x.shape.length ? (x.truth ? !!x.data[0] : x.data[0]) : x);
const pick = (x, axes) => { // a view of other axes, copied: [length, stride] each
  const shape = axes.map((a) => a[0]);
  const data = new Float64Array(count(shape));
  const at = axes.map(() => 0);
  let from = axes.start || 0;
  if (axes.length === 1 || axes.length === 2) { // the same, quickly
    const [[n, step], [m, by]] = axes.length === 2 ? axes : [axes[0], [1, 0]];
    let to = 0;
    for (let i = 0; i < n; i++) for (let j = 0; j < m; j++) data[to++] = x.data[from + i * step + j * by];
    return new Rows(data, shape, x.truth);
  }
  for (let k = 0; k < data.length; k++) {
    data[k] = x.data[from];
    for (let i = axes.length - 1; i >= 0; i--) {
      from += axes[i][1];
      if (++at[i] < shape[i]) break;
      from -= axes[i][1] * shape[i];
      at[i] = 0;
    }
  }
  return new Rows(data, shape, x.truth);
};
// An operation of two numbers. Its loop is a function of its own, so that each is compiled alone: the
// calls of `both` and `each` below with a text in a and b get functions in its place when a page is
// written (script.py), for the policy of a page forbids to make code of text.
const both = (f, loop, truth = false) => (a, b) => apply(f, loop, truth, a, b);
const apply = (f, loop, truth, a, b) => {
  if (typeof a === "number" && typeof b === "number") return truth ? !!f(a, b) : f(a, b);
  if (typeof a === "string" || typeof b === "string") return f(a, b);
  let x = asRows(a);
  let y = asRows(b);
  if (x.shape.join() !== y.shape.join() && x.shape.length && y.shape.length) {
    const n = Math.max(x.shape.length, y.shape.length);
    const [p, q] = [x, y].map((r) => [...Array(n - r.shape.length).fill(1), ...r.shape]);
    const shape = p.map((k, i) => (k === 1 ? q[i] : k));
    if (p.some((k, i) => k !== q[i] && k !== 1 && q[i] !== 1)) throw new Error("shapes differ");
    const wide = (r, own) => {
      const step = strides(own);
      return pick(r, shape.map((k, i) => [k, own[i] === 1 ? 0 : step[i]]));
    };
    x = wide(x, p);
    y = wide(y, q);
  }
  const shape = x.shape.length ? x.shape : y.shape;
  const data = new Float64Array(count(shape));
  const [i, j] = [x.shape.length ? 1 : 0, y.shape.length ? 1 : 0];
  loop(x.data, y.data, i, j, data);
  return plain(new Rows(data, shape, truth));
};
const each = (f, loop, truth = false) => { // of one, in a
  return (a) => {
    if (typeof a === "number") return truth ? !!f(a) : f(a);
    const x = asRows(a);
    const data = new Float64Array(x.data.length);
    loop(x.data, data);
    return plain(new Rows(data, x.shape, truth));
  };
};
const total = (data, from, step, n) => { // pairwise, as numpy adds
  if (n > 128) {
    const half = n >> 1;
    return total(data, from, step, half) + total(data, from + half * step, step, n - half);
  }
  let sum = 0;
  for (let k = 0; k < n; k++) sum += data[from + k * step];
  return sum;
};
// over an axis, or all: f(data, from, step, n)
const over = (f, truth = false) => (a, { axis = null, keepdims = false } = {}) => {
  const x = asRows(a);
  if (axis === null) return plain(new Rows(Float64Array.of(f(x.data, 0, 1, x.data.length)), [], truth));
  const along = axis < 0 ? axis + x.shape.length : axis;
  const n = x.shape[along];
  const inner = count(x.shape.slice(along + 1));
  const shape = x.shape.flatMap((k, i) => (i !== along ? [k] : keepdims ? [1] : []));
  const data = new Float64Array(count(shape));
  for (let k = 0; k < data.length; k++) {
    data[k] = f(x.data, Math.floor(k / inner) * inner * n + (k % inner), inner, n);
  }
  return plain(new Rows(data, shape, truth));
};
const extreme = (better) => (data, from, step, n) => {
  if (!n) throw new Error("nothing there");
  let best = data[from];
  for (let k = 1; k < n; k++) {
    const v = data[from + k * step];
    if (better(v, best) || v !== v) best = v;
  }
  return best;
};
const even = (x) => { // to the nearest whole number, halves to the even one
  const low = Math.floor(x);
  return x - low === 0.5 ? low + (low % 2) : Math.round(x);
};
// a number to so many digits, as Python's %g has it
const general = (value, digits = 6) => {
  const [head, power] = value.toExponential(digits - 1).split("e").map(Number);
  if (power >= -4 && power < digits) return String(Number(value.toPrecision(digits)));
  return `${head}e${power < 0 ? "-" : "+"}${String(Math.abs(power)).padStart(2, "0")}`;
};

const $ = {
  add: both("a + b"), sub: both("a - b"), mul: both("a * b"),
  div: both("a / b"), pow: both("(b === 2 ? a * a : a ** b)"),
  floordiv: both("Math.floor(a / b)"), mod: both("a - b * Math.floor(a / b)"),
  lt: both("a < b", true), gt: both("a > b", true),
  le: both("a <= b", true), ge: both("a >= b", true),
  eq: both("a === b", true), ne: both("a !== b", true),
  and: both("a && b", true), or: both("a || b", true),
  neg: each("-a"), not: each("!a", true),
  abs: each("Math.abs(a)"), sqrt: each("Math.sqrt(a)"), sin: each("Math.sin(a)"), cos: each("Math.cos(a)"),
  arcsin: each("Math.asin(a)"), arccos: each("Math.acos(a)"), log10: each("Math.log10(a)"),
  degrees: each("a * (180 / Math.PI)"), radians: each("a * (Math.PI / 180)"),
  isfinite: each("Number.isFinite(a)", true), isnan: each("Number.isNaN(a)", true),
  signbit: each("a < 0 || Object.is(a, -0)", true),
  arctan2: both("Math.atan2(a, b)"), hypot: both("Math.hypot(a, b)"),
  fmin: both("(a !== a ? b : b !== b ? a : Math.min(a, b))"),
  fmax: both("(a !== a ? b : b !== b ? a : Math.max(a, b))"),
  minimum: both("Math.min(a, b)"), maximum: both("Math.max(a, b)"),
  sum: over(total), mean: over((d, f, s, n) => total(d, f, s, n) / n),
  max: over(extreme((v, best) => v > best)), min: over(extreme((v, best) => v < best)),
  all: over((d, f, s, n) => { for (let k = 0; k < n; k++) if (!d[f + k * s]) return 0; return 1; }, true),
  any: over((d, f, s, n) => { for (let k = 0; k < n; k++) if (d[f + k * s]) return 1; return 0; }, true),
  norm: (x, how) => $.sqrt($.sum($.mul(x, x), how)),
  argmax: (x) => { const d = asRows(x).data; let k = 0; d.forEach((v, i) => { if (v > d[k]) k = i; }); return k; },
  clip: (x, low, high) => $.minimum($.maximum(x, low), high),
  array: (list) => {
    if (list instanceof Rows) return list;
    const parts = list.map(asRows);
    const shape = [parts.length, ...(parts.length ? parts[0].shape : [])];
    const data = new Float64Array(count(shape));
    parts.forEach((p, i) => data.set(p.data, i * p.data.length));
    return new Rows(data, shape, parts.length > 0 && parts.every((p) => p.truth));
  },
  asarray: (x) => asRows(x),
  empty: (shape) => new Rows(new Float64Array(count([shape].flat())), [shape].flat()),
  vstack: (list) => {
    const parts = list.map(asRows).map((r) => (r.shape.length > 1 ? r : $.reshape(r, 1, -1)));
    const data = new Float64Array(parts.reduce((n, r) => n + r.data.length, 0));
    parts.reduce((at, r) => { data.set(r.data, at); return at + r.data.length; }, 0);
    return new Rows(data, [parts.reduce((n, r) => n + r.shape[0], 0), parts[0].shape[1]]);
  },
  zeros: (shape) => $.empty(shape),
  astype: (x) => (x instanceof Rows ? new Rows(x.data, x.shape) : Number(x)),
  T: (x) => { const step = strides(x.shape); return pick(x, x.shape.map((n, i) => [n, step[i]]).reverse()); },
  shape: (x) => x.shape,
  ndim: (x) => asRows(x).shape.length,
  reshape: (x, ...of) => {
    const r = asRows(x);
    const shape = of.flat().map(Number);
    const known = shape.reduce((n, k) => (k < 0 ? n : n * k), 1);
    return new Rows(r.data, shape.map((k) => (k < 0 ? r.data.length / known : k)), r.truth);
  },
  ravel: (x) => $.reshape(x, -1),
  matmul: (a, b) => {
    const [x, y] = [asRows(a), asRows(b)];
    const [m, n] = [x.shape.length > 1 ? x.shape[0] : 1, x.shape[x.shape.length - 1]];
    const p = y.shape.length > 1 ? y.shape[1] : 1;
    const data = new Float64Array(m * p);
    for (let i = 0; i < m; i++) {
      for (let j = 0; j < p; j++) {
        let sum = 0;
        for (let k = 0; k < n; k++) sum += x.data[i * n + k] * y.data[k * p + j];
        data[i * p + j] = sum;
      }
    }
    return plain(new Rows(data, [...(x.shape.length > 1 ? [m] : []), ...(y.shape.length > 1 ? [p] : [])]));
  },
  where: (test, a, b) => {
    const shape = $.add($.add($.mul(test, 0), $.mul(a, 0)), $.mul(b, 0)); // what all three have
    const [t, x, y] = [test, a, b].map((r) => asRows($.second(shape, r)));
    return plain(new Rows(t.data.map((yes, k) => (yes ? x : y).data[k]), t.shape));
  },
  second: both("b"),
  flatnonzero: (x) => $.array([...asRows(x).data.keys()].filter((k) => asRows(x).data[k])),
  diff: (x, { prepend = null, append = null } = {}) => {
    let r = asRows(x);
    if (prepend !== null) r = $.append([prepend], r);
    if (append !== null) r = $.append(r, [append]);
    const rest = count(r.shape.slice(1));
    const data = new Float64Array(Math.max(0, r.data.length - rest));
    for (let k = 0; k < data.length; k++) {
      data[k] = r.truth ? Number(r.data[k + rest] !== r.data[k]) : r.data[k + rest] - r.data[k];
    }
    return new Rows(data, [Math.max(0, r.shape[0] - 1), ...r.shape.slice(1)], r.truth);
  },
  append: (a, b) => {
    const [x, y] = [asRows(a), asRows(b)];
    const data = new Float64Array(x.data.length + y.data.length);
    data.set(x.data);
    data.set(y.data, x.data.length);
    return new Rows(data, [data.length], x.truth && y.truth);
  },
  cumsum: (x) => {
    const r = asRows(x);
    const rest = count(r.shape.slice(1));
    const data = r.data.slice();
    for (let k = rest; k < data.length; k++) data[k] += data[k - rest];
    return new Rows(data, r.shape);
  },
  searchsorted: (x, v) => { const k = asRows(x).data.findIndex((a) => a >= v); return k < 0 ? x.data.length : k; },
  percentile: (x, level) => {
    const sorted = asRows(x).data.slice().sort();
    const at = (level / 100) * (sorted.length - 1);
    const k = Math.min(Math.floor(at), sorted.length - 2);
    return sorted.length < 2 ? sorted[0] : sorted[k] + (at - k) * (sorted[k + 1] - sorted[k]);
  },
  trapezoid: (y, x) => {
    const [v, t] = [asRows(y).data, asRows(x).data];
    return total(v.slice(1).map((b, k) => 0.5 * (t[k + 1] - t[k]) * (b + v[k])), 0, 1, v.length - 1);
  },
  format: (x, form) => (form ? general($.float(x), Number(form.match(/\d+/) ?? 6)) : String(x)), // "g", ".3g", ""
  bincount: (x) => {
    const { data } = asRows(x);
    const found = $.zeros(data.reduce((n, v) => Math.max(n, v + 1), 0));
    data.forEach((v) => { found.data[v] += 1; });
    return found;
  },
  enumerate: (x) => [...x].entries(),
  len: (x) => (x instanceof Rows ? x.shape[0] : x.length),
  float: (x) => (x instanceof Rows ? x.data[0] : Number(x)),
  int: (x) => Math.trunc($.float(x)),
  bool: (x) => !!$.float(x),
  round: (x) => even($.float(x)),
  larger: (...of) => Math.max(...of.map($.float)),
  smaller: (...of) => Math.min(...of.map($.float)),
  // x[a, b, ...]: whole numbers, {slice: [from, to]}, null for a new axis, "..." and masks
  axes: (x, at) => {
    const known = at.filter((i) => i !== null && i !== "...").length;
    const full = at.flatMap((i) => (i === "..." ? Array(x.shape.length - known).fill({ slice: [] }) : [i]));
    const step = strides(x.shape);
    const axes = Object.assign([], { start: 0 });
    let d = 0;
    for (const i of full) {
      if (i === null) { axes.push([1, 0]); continue; }
      const n = x.shape[d];
      if (typeof i === "number") axes.start += (i < 0 ? i + n : i) * step[d];
      else {
        const [from, to] = [i.slice[0] ?? 0, i.slice[1] ?? n].map((k) => Math.min(n, Math.max(0, k < 0 ? k + n : k)));
        axes.start += from * step[d];
        axes.push([Math.max(0, to - from), step[d]]);
      }
      d++;
    }
    for (; d < x.shape.length; d++) axes.push([x.shape[d], step[d]]);
    return axes;
  },
  get: (x, at) => {
    if (!(x instanceof Rows)) {
      const i = at[0];
      return i && typeof i === "object" ? x.slice(...i.slice.map((k) => k ?? undefined)) : x[i < 0 ? x.length + i : i];
    }
    const [first] = at;
    if (first instanceof Rows || Array.isArray(first)) { // of rows
      const by = asRows(first);
      const rows = by.truth ? [...by.data.keys()].filter((k) => by.data[k]) : [...by.data].map((k) => (k < 0 ? k + x.shape[0] : k));
      const wide = count(x.shape.slice(1));
      const data = new Float64Array(rows.length * wide);
      rows.forEach((r, k) => data.set(x.data.subarray(r * wide, (r + 1) * wide), k * wide));
      const found = new Rows(data, [rows.length, ...x.shape.slice(1)], x.truth);
      return at.length > 1 ? $.get(found, [{ slice: [] }, ...at.slice(1)]) : found;
    }
    return plain(pick(x, $.axes(x, at)));
  },
  set: (x, at, value) => {
    const axes = $.axes(x, at);
    const index = pick({ data: Float64Array.from(x.data.keys()), truth: false }, axes);
    const from = asRows(value);
    index.data.forEach((to, k) => { x.data[to] = from.data[from.shape.length ? k : 0]; });
  },
};
