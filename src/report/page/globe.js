"use strict";
// The potential field as a globe, dragged with the pointer, and as a flat map. Both draw one grid
// of values; a direction is [front, right, up].
(() => {
  const globe = document.getElementById("globe");
  if (!globe) return;
  const map = document.getElementById("map");
  const readout = document.getElementById("field-readout");
  const chooser = document.getElementById("field-quantity");
  const data = JSON.parse(document.getElementById("data").textContent);
  const rows = data.n_rows;
  const palette = decodeBase64(data.palette);
  const quantities = data.quantities.map((q) => ({ ...q, values: decodeBase64(q.values) }));
  const DEGREES = 180 / Math.PI;
  const MARKS = {
    virtual: { color: "#ffffff", radius: 2.5 },
    test: { color: "#56b4e9", radius: 4 },
    training: { color: "#e03c31", radius: 6 },
  };
  let quantity = quantities[0];

  const angles = ([x, y, z]) => [Math.atan2(y, x) * DEGREES, Math.asin(Math.max(-1, Math.min(1, z))) * DEGREES];
  function cell([azimuth, elevation]) {
    const row = Math.min(rows - 1, Math.floor((90 - elevation) / 180 * rows));
    const column = Math.floor((azimuth + 180) / 360 * 2 * rows) % (2 * rows);
    return 2 * rows * row + column;
  }
  function paint(pixels, at, value) {
    for (let k = 0; k < 3; k++) pixels[at + k] = palette[3 * value + k];
    pixels[at + 3] = 255;
  }
  function drawMark(context, x, y, kind) {
    context.beginPath();
    context.arc(x, y, MARKS[kind].radius, 0, 2 * Math.PI);
    context.fillStyle = MARKS[kind].color;
    context.fill();
    context.stroke();
  }
  // Those of most interest on top.
  const marks = Object.keys(MARKS).flatMap((kind) => data.cameras.filter((c) => c.kind === kind));

  // The globe as seen from a direction.
  const size = globe.width;
  const radius = 0.48 * size;
  const from = { azimuth: 0, elevation: 25 };
  function basis() {
    const [a, e] = [from.azimuth / DEGREES, from.elevation / DEGREES];
    const toViewer = [Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), Math.sin(e)];
    const right = [-Math.sin(a), Math.cos(a), 0];
    const up = [-Math.sin(e) * Math.cos(a), -Math.sin(e) * Math.sin(a), Math.cos(e)];
    return [right, up, toViewer];
  }
  function onGlobe(x, y, axes) {
    const [u, v] = [(x - size / 2) / radius, (size / 2 - y) / radius];
    const depth = 1 - u * u - v * v;
    if (depth < 0) return null;
    const w = Math.sqrt(depth);
    return [0, 1, 2].map((i) => u * axes[0][i] + v * axes[1][i] + w * axes[2][i]);
  }
  function drawGlobe() {
    const context = globe.getContext("2d");
    const picture = context.createImageData(size, size);
    const axes = basis();
    for (let y = 0; y < size; y++) {
      for (let x = 0; x < size; x++) {
        const direction = onGlobe(x + 0.5, y + 0.5, axes);
        if (direction) paint(picture.data, 4 * (size * y + x), quantity.values[cell(angles(direction))]);
      }
    }
    context.putImageData(picture, 0, 0);
    for (const { direction: d, kind } of marks) {
      const [u, v, w] = axes.map((axis) => axis[0] * d[0] + axis[1] * d[1] + axis[2] * d[2]);
      if (w > 0) drawMark(context, size / 2 + radius * u, size / 2 - radius * v, kind);
    }
  }

  function drawMap() {
    const context = map.getContext("2d");
    const picture = context.createImageData(map.width, map.height);
    for (let y = 0; y < map.height; y++) {
      for (let x = 0; x < map.width; x++) {
        paint(picture.data, 4 * (map.width * y + x), quantity.values[cell(onMap(x + 0.5, y + 0.5))]);
      }
    }
    context.putImageData(picture, 0, 0);
    for (const { direction, kind } of marks) {
      const [azimuth, elevation] = angles(direction);
      drawMark(context, (azimuth + 180) / 360 * map.width, (90 - elevation) / 180 * map.height, kind);
    }
  }
  const onMap = (x, y) => [x / map.width * 360 - 180, 90 - y / map.height * 180];

  function drawScale() {
    const scale = document.getElementById("field-scale");
    const context = scale.getContext("2d");
    const picture = context.createImageData(256, 1);
    for (let i = 0; i < 256; i++) paint(picture.data, 4 * i, i);
    context.putImageData(picture, 0, 0);
    document.getElementById("field-min").textContent = `${quantity.min.toFixed(2)} ${quantity.unit}`;
    document.getElementById("field-max").textContent = `${quantity.max.toFixed(2)} ${quantity.unit}`;
  }
  function drawAll() {
    drawGlobe();
    drawMap();
    drawScale();
  }

  // What lies under the pointer.
  function read([azimuth, elevation]) {
    const share = quantity.values[cell([azimuth, elevation])] / 255;
    const value = quantity.min + share * (quantity.max - quantity.min);
    readout.textContent = `azimuth ${azimuth.toFixed(0)}, elevation ${elevation.toFixed(0)} degrees: `
      + `${quantity.name} ${value.toFixed(2)} ${quantity.unit}`;
  }
  const within = (canvas, event) => [event.offsetX / canvas.clientWidth * canvas.width,
                                     event.offsetY / canvas.clientHeight * canvas.height];
  map.addEventListener("pointermove", (event) => read(onMap(...within(map, event))));
  globe.addEventListener("pointerdown", (event) => globe.setPointerCapture(event.pointerId));
  function turn(azimuth, elevation) {
    from.azimuth += azimuth;
    from.elevation = Math.max(-90, Math.min(90, from.elevation + elevation));
    drawGlobe();
  }
  globe.addEventListener("pointermove", (event) => {
    if (event.buttons) turn(-0.5 * event.movementX, 0.5 * event.movementY);
    const direction = onGlobe(...within(globe, event), basis());
    if (direction) read(angles(direction));
  });
  const KEYS = { ArrowLeft: [-5, 0], ArrowRight: [5, 0], ArrowUp: [0, 5], ArrowDown: [0, -5] };
  globe.addEventListener("keydown", (event) => {
    if (!KEYS[event.key]) return;
    event.preventDefault();
    turn(...KEYS[event.key]);
  });

  for (const [i, { name }] of quantities.entries()) chooser.add(new Option(name, String(i)));
  chooser.addEventListener("change", () => {
    quantity = quantities[Number(chooser.value)];
    drawAll();
  });
  drawAll();
})();
