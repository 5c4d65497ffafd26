// Save a figure as SVG, as PNG of twice its size, or its values as CSV.
"use strict";
const saveFile = (content, type, name) => {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([content], { type }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
};

const savePng = (svg, name, scale = 2) => {
  const root = new DOMParser().parseFromString(svg, "image/svg+xml").documentElement;
  const [wide, high] = ["width", "height"].map((k) => Number.parseFloat(root.getAttribute(k)));
  const image = new Image();
  image.onload = () => {
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [Math.round(scale * wide), Math.round(scale * high)];
    const ctx = canvas.getContext("2d");
    ctx.fillStyle = "#ffffff";
    ctx.fillRect(0, 0, canvas.width, canvas.height);
    ctx.drawImage(image, 0, 0, canvas.width, canvas.height);
    canvas.toBlob((blob) => saveFile(blob, "image/png", name));
  };
  image.src = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(svg)}`;
};

// The buttons of a figure: `svg()` returns a text, `csv()` a promise of one; without csv there is no button for it.
const saveBar = (bar, title, svg, csv) => {
  const name = title.toLowerCase().replace(/[^a-z0-9]+/g, "-").replace(/^-|-$/g, "") || "figure";
  const kinds = {
    PNG: () => savePng(svg(), `${name}.png`),
    SVG: () => saveFile(svg(), "image/svg+xml", `${name}.svg`),
    ...(csv ? { CSV: async () => saveFile(await csv(), "text/csv", `${name}.csv`) } : {}),
  };
  bar.replaceChildren("Save ", ...Object.entries(kinds).flatMap(([kind, act]) => {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = kind;
    button.setAttribute("aria-label", `save ${title} as ${kind}`);
    button.addEventListener("click", act);
    return [button, " "];
  }));
  bar.hidden = false;
};

const csvCell = (v) => (v === null || v === undefined ? "" : /[",\n]/.test(v)
  ? `"${String(v).replace(/"/g, '""')}"` : String(v));
const csvText = (head, columns) => [head.map(csvCell).join(","), ...Array.from(columns[0], (_, k) =>
  columns.map((c) => csvCell(c[k])).join(","))].join("\n") + "\n";
// the first line of a file that holds so many drawn values in place of all rows
const binsLine = (drawn, rows) => (drawn < rows ? `# minima and maxima of ${drawn / 2} bins of ${rows} samples, `
  + "not all samples; `desat export run` writes them\n" : "");
