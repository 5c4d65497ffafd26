// A click on a bar of a histogram names its cases, one on a case the command that makes it again.
(() => {
  "use strict";
  const told = JSON.parse(document.getElementById("told").textContent);
  const named = document.getElementById("named");

  const button = (number) => {
    const made = document.createElement("button");
    made.className = "case";
    made.dataset.case = made.textContent = number;
    return made;
  };

  function command(number) {
    const code = document.createElement("code");
    code.textContent = `${told.command} ${number}`;
    const copy = document.createElement("button");
    copy.textContent = "copy";
    copy.addEventListener("click", async () => {
      try {
        await navigator.clipboard.writeText(code.textContent);
        copy.textContent = "copied";
      } catch { // of a page from a file a browser may allow the selection alone
        getSelection().selectAllChildren(code);
      }
    });
    named.replaceChildren(`case ${number}: `, code, " ", copy);
  }

  function bar(place, event) {
    const { edges, cases, counts } = told.histograms[place.dataset.histogram];
    const box = place.querySelector("svg").getBoundingClientRect();
    const share = (event.clientX - box.left) / box.width;
    const k = edges.findIndex((edge, i) => edge <= share && share < edges[i + 1]);
    const title = place.querySelector("figcaption").firstChild.textContent.trim();
    if (k < 0 || k >= counts.length) return;
    const more = counts[k] - cases[k].length;
    const numbers = cases[k].flatMap((n, i) => [i ? ", " : " ", button(n)]);
    named.replaceChildren(`${title}: ${counts[k]} ${counts[k] === 1 ? "case" : "cases"} in this bar`,
      ...(counts[k] ? [":"] : []), ...numbers, more ? `, and ${more} more` : "");
  }

  document.addEventListener("click", (event) => {
    const one = event.target.closest(".case");
    const place = event.target.closest("svg") && event.target.closest("[data-histogram]");
    if (one) command(one.dataset.case);
    else if (place) bar(place, event);
  });
  document.documentElement.classList.add("lively");
})();
