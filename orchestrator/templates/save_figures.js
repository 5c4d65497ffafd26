// The save buttons of the figures of a report and of its drawings.
(() => {
  "use strict";
  const TENTHS = 2000; // figures of ours are in tenths of a point, so wider than this

  function picture(place) { // the SVG of a figure as a text of its own
    const svg = place.querySelector("svg").cloneNode(true);
    const [, , width, height] = svg.getAttribute("viewBox").split(/[ ,]+/).map(Number);
    const unit = width > TENTHS ? 10 : 1;
    svg.setAttribute("width", width / unit);
    svg.setAttribute("height", height / unit);
    svg.setAttribute("xmlns", "http://www.w3.org/2000/svg");
    return new XMLSerializer().serializeToString(svg);
  }

  for (const bar of document.querySelectorAll(".save")) {
    const figure = bar.closest("figure, .picture");
    const title = figure.querySelector("figcaption")?.firstChild.textContent.trim() || figure.dataset.name;
    const place = figure.querySelector(".still") || figure;
    const csv = figure.id ? window.desat?.csv(figure) : null;
    saveBar(bar, title, () => picture(place), csv);
  }
})();

// what is folded is open on paper
(() => {
  "use strict";
  const each = (which, change) => document.querySelectorAll(`details${which}`).forEach(change);
  addEventListener("beforeprint", () => each(":not([open])", (d) => {
    d.open = true;
    d.dataset.folded = "";
  }));
  addEventListener("afterprint", () => each("[data-folded]", (d) => {
    d.open = false;
    delete d.dataset.folded;
  }));
})();
