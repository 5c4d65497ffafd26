// The view of orbit and attitude of a report: its time is that of the pointer over the plots.
(() => {
  "use strict";
  const root = document.getElementById("scene");
  const scene = makeScene(root, (t) => {
    document.dispatchEvent(new CustomEvent("seek", { detail: t }));
  });
  scene.show(JSON.parse(document.getElementById("seen").textContent));
  document.addEventListener("moment", (event) => scene.at(event.detail));
  window.desatScene = scene;
})();
