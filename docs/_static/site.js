// What furo leaves out for keyboards and screen readers: levels of headings, names of landmarks,
// and boxes that scroll.
"use strict";
addEventListener("DOMContentLoaded", () => {
  for (const caption of document.querySelectorAll(".caption[role=heading]")) caption.ariaLevel = "2";
  document.querySelector(".sidebar-drawer")?.setAttribute("aria-label", "pages");
  document.querySelector(".toc-drawer")?.setAttribute("aria-label", "on this page");
  const reach = () => document.querySelectorAll("pre, .table-wrapper, .highlight").forEach((box) => {
    if (box.scrollWidth > box.clientWidth) box.tabIndex = 0;
  });
  addEventListener("resize", reach);
  reach();
});
