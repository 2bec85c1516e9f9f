"use strict";
// The page of a training as it runs, or of a finished one: asks now and then how far it is, and
// shows new Gaussians, curves and views as they come. A page that nobody sees asks for nothing.
(() => {
  const INTERVAL = 2000;
  const element = (id) => document.getElementById(id);
  const holder = element("data");
  const data = holder ? JSON.parse(holder.textContent) : null;
  const PHASES = {
    loading: "The scene is being made ready.",
    training: "Training.",
    measuring: "Training has ended; the test views are being measured.",
    finished: "Finished.",
  };
  // What the page shows by now: the number of the Gaussians and of the curves.
  let shown = 0;
  let plotted = 0;

  async function get(name) {
    const answer = await fetch(name);
    if (!answer.ok) throw new Error(`${name}: ${answer.status}`);
    return answer;
  }

  function shortTime(seconds) {
    if (seconds === null) return "?";
    const s = Math.round(seconds);
    if (s < 60) return `${s}s`;
    const two = (n) => String(n).padStart(2, "0");
    return s < 3600 ? `${Math.floor(s / 60)}m${two(s % 60)}s` : `${Math.floor(s / 3600)}h${two(Math.floor(s / 60) % 60)}m`;
  }

  function tell(state) {
    element("live-phase").textContent = PHASES[state.phase];
    const bar = element("live-progress");
    bar.hidden = state.total === 0;
    bar.max = Math.max(1, state.total);
    bar.value = state.done;
    const number = (value, digits) => (value === null ? "-" : value.toFixed(digits));
    const facts = {
      done: `${state.done}/${state.total}`,
      left: state.phase === "training" ? shortTime(state.seconds_left) : "-",
      loss: number(state.loss, 4),
      "held-out": number(state.held_out, 2),
      test: number(state.test, 2),
      gaussians: String(state.gaussians),
    };
    for (const [name, text] of Object.entries(facts)) element(`live-${name}`).textContent = text;
  }

  // Views beside their photographs: those on the screen are painted, with every change.
  const figures = Array.from(document.querySelectorAll("figure[data-camera]"));
  function isSeen(figure) {
    const { top, bottom } = figure.getBoundingClientRect();
    return bottom > 0 && top < window.innerHeight;
  }
  const paint = (figure) =>
    viewer.paint(data.cameras[Number(figure.dataset.camera)], figure.querySelector("canvas"));
  if (viewer) {
    const watcher = new IntersectionObserver((entries) => {
      entries.filter((entry) => entry.isIntersecting).forEach((entry) => paint(entry.target));
    });
    figures.forEach((figure) => watcher.observe(figure));
  }

  async function showGaussians(state) {
    if (!viewer || state.model === shown) return;
    const bytes = new Uint8Array(await (await get("gaussians")).arrayBuffer());
    viewer.show(bytes);
    shown = state.model;
    figures.filter(isSeen).forEach(paint);
    const n = bytes.length / data.packed_bytes;
    element("live-shown").textContent = `Gaussians after ${state.model_iteration} iterations: `
      + (n < state.model_gaussians ? `${n} of ${state.model_gaussians}, those of most weight.` : `all ${n}.`);
    document.body.dataset.model = String(state.model_iteration);
  }

  async function showCurves(state) {
    if (state.curves === plotted) return;
    const plots = await (await get("curves")).json();
    const parser = new DOMParser();
    element("live-curves").replaceChildren(...plots.map((plot) => {
      const box = document.createElement("div");
      box.append(document.importNode(parser.parseFromString(plot, "image/svg+xml").documentElement, true));
      return box;
    }));
    plotted = state.curves;
  }

  // Returns whether there is more to come.
  async function follow() {
    const state = await (await get("state")).json();
    tell(state);
    if (state.has_scene && !data) {
      location.reload();
      return false;
    }
    await showGaussians(state);
    await showCurves(state);
    return state.phase !== "finished" || state.model !== shown;
  }

  let failures = 0;
  async function turn() {
    let goesOn = true;
    if (!document.hidden) {
      try {
        goesOn = await follow();
        failures = 0;
      } catch (problem) {
        failures += 1;
        // One answer may be lost; a program that has ended gives none.
        if (failures > 2) {
          element("live-phase").textContent =
            `The program does not answer, so it has probably ended; this is the last that it showed (${problem.message}).`;
        }
      }
    }
    if (goesOn) setTimeout(turn, INTERVAL);
  }
  turn();
})();
