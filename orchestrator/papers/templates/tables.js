// Rows of long tables that have a text, or that are outside their band; a table without any is hidden.
(() => {
  "use strict";
  const form = document.getElementById("filter");
  const rows = [...document.querySelectorAll("tr.row")];

  function show() {
    const words = form.elements.text.value.toLowerCase().split(/\s+/).filter(Boolean);
    const bad = form.elements.bad.checked;
    let count = 0;
    for (const section of document.querySelectorAll("section")) {
      const heading = section.querySelector("h2").textContent.toLowerCase();
      let some = false;
      for (const row of section.querySelectorAll("tr.row")) {
        const text = `${heading} ${row.textContent.toLowerCase()}`;
        row.hidden = (bad && !row.classList.contains("out")) || !words.every((w) => text.includes(w));
        some ||= !row.hidden;
        count += !row.hidden;
      }
      section.hidden = !some;
    }
    document.getElementById("shown").textContent =
      count === rows.length ? `${count} rows` : `${count} of ${rows.length} rows`;
  }

  form.addEventListener("input", show);
  form.addEventListener("submit", (event) => event.preventDefault());
  document.documentElement.classList.add("lively");
  show();
})();
