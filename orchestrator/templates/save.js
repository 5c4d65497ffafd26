// Save a figure of the page: as it is printed (SVG, PNG of twice its size), or its values (CSV).
(() => {
  "use strict";
  const SCALE = 2;

  function save(content, type, name) {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([content], { type }));
    link.download = name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  }

  function picture(figure) { // the figure's SVG as a text of its own
    const svg = figure.querySelector(".still svg").cloneNode(true);
    const [, , width, height] = svg.getAttribute("viewBox").split(/[ ,]+/).map(Number);
    const wide = width > 2000 ? width / 10 : width; // ours are in tenths of a point
    svg.setAttribute("width", wide);
    svg.setAttribute("height", wide * height / width);
    if (!svg.getAttribute("xmlns")) svg.setAttribute("xmlns", "http://www.w3.org/2000/svg");
    return { text: new XMLSerializer().serializeToString(svg), wide, high: wide * height / width };
  }

  function savePng(figure, name) {
    const { text, wide, high } = picture(figure);
    const image = new Image();
    image.onload = () => {
      const canvas = document.createElement("canvas");
      canvas.width = SCALE * wide;
      canvas.height = SCALE * high;
      const ctx = canvas.getContext("2d");
      ctx.fillStyle = "#ffffff";
      ctx.fillRect(0, 0, canvas.width, canvas.height);
      ctx.drawImage(image, 0, 0, canvas.width, canvas.height);
      canvas.toBlob((blob) => save(blob, "image/png", name));
    };
    image.src = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(text)}`;
  }

  for (const bar of document.querySelectorAll(".save")) {
    const figure = bar.closest("figure");
    const caption = figure.querySelector("figcaption").firstChild.textContent.trim();
    const name = caption.toLowerCase().replace(/[^a-z0-9]+/g, "-").replace(/^-|-$/g, "") || "figure";
    const actions = {
      SVG: () => save(picture(figure).text, "image/svg+xml", `${name}.svg`),
      PNG: () => savePng(figure, `${name}.png`),
      CSV: () => save(window.desat.csv(figure), "text/csv", `${name}.csv`),
    };
    for (const button of bar.querySelectorAll("button")) {
      const kind = button.textContent;
      if (kind === "CSV" && !window.desat?.csv(figure)) { button.remove(); continue; }
      button.addEventListener("click", actions[kind]);
    }
    bar.hidden = false;
  }
})();
