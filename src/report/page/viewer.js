"use strict";
// The trained scene: Gaussians as instanced quads, blended back to front in an order that the
// CPU sorts. Projection, low-pass filter and cut-offs are those of the trainer; colours are of
// degree 0. The layout of a Gaussian is that of page/packed.rs.
//
// The viewer shows what the page holds, if anything: `show` replaces the Gaussians, `paint` draws
// them into another canvas as a camera sees them. It is null where there is nothing to show it in.
const viewer = (() => {
  const canvas = document.getElementById("scene");
  if (!canvas) return null;
  const note = document.getElementById("scene-note");
  const gl = canvas.getContext("webgl2", { antialias: false, preserveDrawingBuffer: true });
  if (!gl) {
    note.textContent = "This browser offers no WebGL 2, which the view of the scene needs.";
    return null;
  }
  const data = JSON.parse(document.getElementById("data").textContent);

  // Vectors.
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const add = (a, b, s) => a.map((v, i) => v + s * b[i]);
  const cross = (a, b) =>
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = (a) => a.map((v) => v / Math.hypot(...a));

  // GPU objects.
  const program = link(document.getElementById("vertex-shader").textContent,
                       document.getElementById("fragment-shader").textContent);
  gl.useProgram(program);
  const uniform = (name) => gl.getUniformLocation(program, name);
  const places = {};
  for (const name of ["rotation", "eye", "focal", "principal", "size", "near", "scale_log"]) {
    places[name] = uniform(name);
  }
  gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
  gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
  gl.enableVertexAttribArray(0);
  gl.vertexAttribIPointer(0, 1, gl.UNSIGNED_INT, 0, 0);
  gl.vertexAttribDivisor(0, 1);
  gl.enable(gl.BLEND);
  gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);

  function link(vertex, fragment) {
    const program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) {
        throw new Error(gl.getShaderInfoLog(shader));
      }
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) {
      throw new Error(gl.getProgramInfoLog(program));
    }
    return program;
  }

  // The Gaussians: means for sorting, all in a texture.
  const TEXELS = 1024;
  let count = 0;
  let means, order, keys;
  function load(bytes) {
    count = bytes.length / data.packed_bytes;
    const view = new DataView(bytes.buffer);
    means = new Float32Array(3 * count);
    for (let i = 0; i < count; i++) {
      for (let k = 0; k < 3; k++) {
        const u = view.getUint16(i * data.packed_bytes + 2 * k, true) / 32767.5 - 1;
        means[3 * i + k] = u / (1 - Math.min(Math.abs(u), 0.9999));
      }
    }
    order = new Uint32Array(count);
    keys = new Uint16Array(count);
    const rows = Math.max(1, Math.ceil(count / TEXELS));
    const texels = new Uint32Array(4 * TEXELS * rows);
    texels.set(new Uint32Array(bytes.buffer));
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32UI, TEXELS, rows, 0,
                  gl.RGBA_INTEGER, gl.UNSIGNED_INT, texels);
    gl.bufferData(gl.ARRAY_BUFFER, 4 * count, gl.DYNAMIC_DRAW);
  }

  // Farthest first: a counting sort over 16 bits of the logarithm of depth.
  const BUCKETS = 65536;
  const starts = new Uint32Array(BUCKETS + 1);
  function sort(pose) {
    const forward = pose.rotation[2];
    const [low, high] = [Math.log(data.near), Math.log(data.near) + 14];
    starts.fill(0);
    for (let i = 0; i < count; i++) {
      const depth = forward[0] * (means[3 * i] - pose.eye[0])
        + forward[1] * (means[3 * i + 1] - pose.eye[1])
        + forward[2] * (means[3 * i + 2] - pose.eye[2]);
      const share = (Math.log(Math.max(depth, data.near)) - low) / (high - low);
      keys[i] = (BUCKETS - 1) * (1 - Math.min(share, 1));
      starts[keys[i] + 1]++;
    }
    for (let b = 0; b < BUCKETS; b++) starts[b + 1] += starts[b];
    for (let i = 0; i < count; i++) order[starts[keys[i]]++] = i;
  }

  // The pose: a camera's own, or an orbit around a target.
  const up = unit(data.up);
  const cameras = data.cameras.filter((camera) => camera.kind !== "virtual");
  let pose;
  let orbit = null;
  let focal;

  function take(camera) {
    pose = { rotation: camera.rotation, eye: camera.eye };
    focal = camera;
    orbit = null;
  }

  // The orbit that the pose lies on: around what the camera looks at, nearest to the focus.
  function startOrbit() {
    const forward = pose.rotation[2];
    const distance = Math.max(-dot(pose.eye, forward), 0.2);
    const target = add(pose.eye, forward, distance);
    const back = forward.map((v) => -v);
    const front = unit(add(back, up, -dot(back, up)));
    orbit = { target, distance, front, right: cross(up, front), turn: 0,
              lift: Math.asin(Math.max(-1, Math.min(1, dot(back, up)))) };
  }

  function followOrbit() {
    const { target, distance, front, right, turn, lift } = orbit;
    const level = front.map((v, i) => Math.cos(turn) * v + Math.sin(turn) * right[i]);
    const back = level.map((v, i) => Math.cos(lift) * v + Math.sin(lift) * up[i]);
    const z = back.map((v) => -v);
    const x = unit(cross(z, up));
    pose = { rotation: [x, cross(z, x), z], eye: add(target, back, distance) };
  }

  function draw() {
    const scale = Math.min(window.devicePixelRatio || 1, 1.5);
    const width = Math.max(1, Math.round(canvas.clientWidth * scale));
    const height = Math.max(1, Math.round(canvas.clientHeight * scale));
    render(pose, focal, width, height);
  }

  function render(pose, focal, width, height) {
    if (canvas.width !== width || canvas.height !== height) {
      canvas.width = width;
      canvas.height = height;
    }
    sort(pose);
    gl.viewport(0, 0, width, height);
    gl.clearColor(...data.background, 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.bufferSubData(gl.ARRAY_BUFFER, 0, order);
    // All that the camera sees fits into the canvas.
    const fit = Math.min(width / focal.size[0], height / focal.size[1]);
    gl.uniformMatrix3fv(places.rotation, true, pose.rotation.flat());
    gl.uniform3fv(places.eye, pose.eye);
    gl.uniform2f(places.focal, fit * focal.focal[0], fit * focal.focal[1]);
    gl.uniform2f(places.principal, fit * focal.principal[0], fit * focal.principal[1]);
    gl.uniform2f(places.size, width, height);
    gl.uniform1f(places.near, data.near);
    gl.uniform2fv(places.scale_log, data.scale_log);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, count);
  }

  // Turning to and fro: nothing was photographed from behind.
  const SWING = 20 * Math.PI / 180;
  const turning = document.getElementById("scene-turn");
  const still = window.matchMedia("(prefers-reduced-motion: reduce)").matches;
  turning.checked = !still;
  let seen = true;
  let phase = 0;
  let last = 0;
  let waiting = false;
  function request() {
    if (!waiting) {
      waiting = true;
      requestAnimationFrame(frame);
    }
  }
  function frame(now) {
    waiting = false;
    if (turning.checked && seen) {
      if (!orbit) startOrbit();
      const before = Math.sin(phase);
      phase += 0.5 * Math.min((now - last) / 1000, 0.1);
      orbit.turn += SWING * (Math.sin(phase) - before);
      followOrbit();
      request();
    }
    last = now;
    draw();
  }
  new IntersectionObserver((entries) => {
    seen = entries[entries.length - 1].isIntersecting;
    if (seen) request();
  }).observe(canvas);
  new ResizeObserver(request).observe(canvas);
  turning.addEventListener("change", request);

  // Dragging turns, the wheel goes nearer, arrow keys do as dragging does.
  function move(turn, lift, nearer) {
    if (!orbit) startOrbit();
    turning.checked = false;
    orbit.turn += turn;
    orbit.lift = Math.max(-1.5, Math.min(1.5, orbit.lift + lift));
    orbit.distance *= nearer;
    followOrbit();
    request();
  }
  canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
  canvas.addEventListener("pointermove", (event) => {
    if (event.buttons) move(-0.006 * event.movementX, 0.006 * event.movementY, 1);
  });
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    move(0, 0, Math.exp(0.001 * event.deltaY));
  }, { passive: false });
  const KEYS = { ArrowLeft: [-0.05, 0], ArrowRight: [0.05, 0], ArrowUp: [0, 0.05], ArrowDown: [0, -0.05] };
  canvas.addEventListener("keydown", (event) => {
    if (!KEYS[event.key]) return;
    event.preventDefault();
    move(...KEYS[event.key], 1);
  });

  const chooser = document.getElementById("scene-camera");
  cameras.forEach((camera, i) => {
    chooser.add(new Option(`${camera.kind}: ${camera.name}`, String(i)));
  });
  chooser.addEventListener("change", () => {
    turning.checked = false;
    take(cameras[Number(chooser.value)]);
    request();
  });

  // The picture goes through the viewer's own canvas, which is drawn again before it is seen.
  function paint(camera, target) {
    render({ rotation: camera.rotation, eye: camera.eye }, camera, target.width, target.height);
    target.getContext("2d").drawImage(canvas, 0, 0);
    request();
  }
  function show(bytes) {
    load(bytes);
    request();
  }

  const held = document.getElementById("gaussians");
  load(held ? decodeBase64(held.textContent) : new Uint8Array());
  take(cameras[0]);
  request();
  return { show, paint };
})();
