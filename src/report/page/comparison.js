"use strict";
// Which picture stands left and which right of every slider of a scene.
for (const section of document.querySelectorAll(".comparison")) {
  const source = section.querySelector("script");
  if (!source) continue;
  const { names, views } = JSON.parse(source.textContent);
  const choosers = [section.querySelector(".left"), section.querySelector(".right")];
  const show = () => section.querySelectorAll(".compare").forEach((compare, i) => {
    compare.querySelectorAll("img").forEach((img, side) => {
      img.src = views[i][Number(choosers[side].value)];
      img.alt = names[Number(choosers[side].value)];
    });
  });
  for (const [side, chooser] of choosers.entries()) {
    names.forEach((name, i) => chooser.add(new Option(name, String(i))));
    // The first run, and beside it the second or else the photograph.
    chooser.value = String(side === 0 ? 1 : names.length > 2 ? 2 : 0);
    chooser.addEventListener("change", show);
  }
  show();
}
