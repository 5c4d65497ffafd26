// What scrolls can be reached by keyboard.
(() => {
  "use strict";
  const seen = new ResizeObserver((boxes) => boxes.forEach(({ target }) => {
    if (target.scrollWidth > target.clientWidth) target.tabIndex = 0;
    else target.removeAttribute("tabindex");
  }));
  document.querySelectorAll(".wide").forEach((box) => seen.observe(box));
})();
