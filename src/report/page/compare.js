"use strict";
// Two pictures on one another, cut where the slider stands: left of it the first, right the second.
for (const compare of document.querySelectorAll(".compare")) {
  const slider = compare.querySelector("input");
  const move = () => compare.style.setProperty("--cut", `${slider.value}%`);
  slider.addEventListener("input", move);
  move();
}
