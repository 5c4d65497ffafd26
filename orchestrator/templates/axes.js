// How numbers, ticks and colours of a page look: of its scripts, the first.
"use strict";
const dark = matchMedia("(prefers-color-scheme: dark)");
const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

const PALETTE = @PALETTE@;
// of a colour on a dark page: that of the palette, or halfway to white
const colour = (hex) => !dark.matches ? hex : PALETTE[hex] ?? "#" + [1, 3, 5].map((i) =>
  Math.round((parseInt(hex.slice(i, i + 2), 16) + 255) / 2).toString(16).padStart(2, "0")).join("");

// how the mark of a series in a legend is drawn, as its line
const border = (plot, k) => {
  const [first] = plot.series[k].dash ?? [];
  return first ? (first > 4 ? "dashed" : "dotted") : "solid";
};

// names of a legend by keyboard: Enter or space is a click
const operable = (place) => [...place.querySelectorAll(".u-series")].slice(1).forEach((row) => {
  const name = row.firstChild;
  name.tabIndex = 0;
  name.setAttribute("role", "button");
  name.addEventListener("keydown", (event) => {
    if (event.key !== "Enter" && event.key !== " ") return;
    event.preventDefault();
    name.click();
  });
});

// a number to the last digit that tells values `step` apart
const text = (value, step) => {
  if (value === null || value === undefined) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  const digits = step > 0 ? Math.max(0, Math.ceil(-Math.log10(step) - 1e-9)) : 0;
  if (size >= 1e6 || (size < 1e-3 && step < 1e-4)) {
    const kept = step > 0 ? Math.max(0, Math.min(8, Math.floor(Math.log10(size)) + digits)) : 3;
    return value.toExponential(kept).replace(/\.?0+e/, "e").replace("e+", "e").replace(/-/g, "−");
  }
  return value.toFixed(Math.min(digits, 12)).replace("-", "−");
};

// the unit of a label with brackets, "" without
const unitOf = (label) => /\[([^\]]*)\]/.exec(label)?.[1] ?? "";
// a value under the pointer, with its unit
const reading = (value, step, label) => (value === null || value === undefined ? "–" : `${text(value, step)} ${unitOf(label)}`.trim());

// uPlot's own ticks end at 1e-16, and know no hours
const multiples = (min, max, most) => {
  const least = (max - min) / Math.max(most, 2);
  const power = 10 ** Math.floor(Math.log10(least));
  const step = [1, 2, 2.5, 5, 10].find((n) => n * power >= least * (1 - 1e-9)) * power;
  const found = [];
  for (let k = Math.ceil(min / step - 1e-9); k <= max / step + 1e-9; k++) found.push(k * step);
  return found;
};
const apart = (at, unit) => (at.length > 1 ? (at[1] - at[0]) / unit : Math.abs(at[0]) / unit || 1);
const decades = (min, max) => { // of few of them, twos and fives between
  const found = [];
  const parts = Math.log10(max / min) < 2 ? [1, 2, 5] : [1];
  const every = Math.ceil(Math.log10(max / min) / 7);
  for (let k = Math.floor(Math.log10(min)); k <= Math.log10(max); k++) {
    if (k % every === 0) found.push(...parts.map((n) => Number(`${n}e${k}`)));
  }
  return found.filter((v) => min <= v && v <= max);
};
// 2.5 has one digit more than its power of ten
const finer = (step) => Math.abs(step / 10 ** Math.floor(Math.log10(step) + 1e-9) - 2.5) < 0.01
  ? step / 10 : step;

// The name of a limit at the right end of its line, in pixels of the canvas; left of others (`named`)
// of its height.
function nameLevel(ctx, label, hue, end, y, top, named) {
  if (!label) return;
  const ratio = devicePixelRatio || 1;
  const at = y > top + 14 * ratio ? y - 4 * ratio : y + 12 * ratio;
  const text = label.replace(/\s+/g, " ");
  ctx.font = `${11 * ratio}px system-ui`;
  ctx.textAlign = "right";
  const { width } = ctx.measureText(text);
  const right = Math.min(end, ...named.filter((other) => Math.abs(other.at - at) < 12 * ratio).map((other) => other.left));
  named.push({ at, left: right - width - 12 * ratio });
  ctx.globalAlpha = 0.8; // readable over lines
  ctx.fillStyle = css("--paper");
  ctx.fillRect(right - width - 7 * ratio, at - 10 * ratio, width + 6 * ratio, 13 * ratio);
  ctx.globalAlpha = 1;
  ctx.fillStyle = hue;
  ctx.fillText(text, right - 4 * ratio, at);
}
