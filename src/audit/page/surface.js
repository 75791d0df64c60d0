// A mesh coloured by the error at its vertices: drag to turn, wheel to come nearer. WebGL, by hand.

/** From dark blue over teal to yellow: the lightness rises evenly, so it reads without colours as well. */
const SCALE = [[0.16, 0.16, 0.42], [0.13, 0.38, 0.56], [0.12, 0.56, 0.55], [0.37, 0.77, 0.38], [0.99, 0.9, 0.15]];

function colourAt(share) {
  const place = Math.min(Math.max(share, 0), 1) * (SCALE.length - 1);
  const k = Math.min(Math.floor(place), SCALE.length - 2);
  return SCALE[k].map((from, channel) => from + (SCALE[k + 1][channel] - from) * (place - k));
}

function surfaceView(surfaces) {
  const canvas = element("canvas", { tabindex: "0", role: "img", "aria-label": "The surface coloured by its error; arrow keys turn it, + and − zoom" });
  const frame = element("div", { class: "frame view" }, canvas, element("div", { class: "hint" }, "drag: turn · wheel: zoom · arrow keys, + and −"));
  const choice = element("select", { id: "surface", onchange: () => load(surfaces[choice.selectedIndex]) }, surfaces.map(each => element("option", {}, each.title)));
  const top = element("input", { id: "scale-top", type: "range", min: "1", max: "100", value: "100", oninput: () => recolour() });
  const bar = element("canvas", { width: "256", height: "1" });
  const [least, most, about] = [element("span", {}, "0 mm"), element("span", {}), element("span", { class: "soft" })];
  frame.append(element("div", { class: "tools" }, element("button", { type: "button", onclick: () => { view.over = !view.over; draw(); } }, "upside down")));
  const legend = element("div", { class: "legend" }, element("label", {}, "Surface ", choice), least, bar, most,
    element("label", {}, element("span", { class: "soft" }, "Top of the scale "), top), about);
  const ink = bar.getContext("2d");
  for (let x = 0; x < 256; x++) {
    ink.fillStyle = `rgb(${colourAt(x / 255).map(value => Math.round(255 * value)).join(",")})`;
    ink.fillRect(x, 0, 1, 1);
  }
  const gl = canvas.getContext("webgl", { antialias: true, preserveDrawingBuffer: true });
  if (!gl || !gl.getExtension("OES_element_index_uint")) {
    frame.replaceChildren(element("p", { class: "soft" }, "This browser has no WebGL: the mesh cannot be drawn."));
    return [frame, legend];
  }

  const program = gl.createProgram();
  const stage = (kind, text) => {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(program, shader);
  };
  stage(gl.VERTEX_SHADER, `attribute vec3 place; attribute vec3 normal; attribute vec3 colour; uniform mat3 turn; uniform vec3 view;
    varying vec3 facing; varying vec3 tint;
    void main() { vec3 p = turn * place; facing = turn * normal; tint = colour;
      gl_Position = vec4(p.x * view.x, p.y * view.y, -p.z * view.z, 1.0); }`);
  stage(gl.FRAGMENT_SHADER, `precision mediump float; varying vec3 facing; varying vec3 tint;
    void main() { float light = 0.45 + 0.55 * abs(normalize(facing).z); gl_FragColor = vec4(tint * light, 1.0); }`);
  gl.linkProgram(program);
  gl.useProgram(program);
  gl.enable(gl.DEPTH_TEST);
  const buffers = Object.fromEntries(["place", "normal", "colour", "faces"].map(name => [name, gl.createBuffer()]));
  const view = { yaw: 0.5, pitch: 0.15, zoom: 1, over: false };
  let [now, triangles] = [surfaces[0], 0];

  function attribute(name, values) {
    gl.bindBuffer(gl.ARRAY_BUFFER, buffers[name]);
    gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
    const at = gl.getAttribLocation(program, name);
    gl.enableVertexAttribArray(at);
    gl.vertexAttribPointer(at, 3, gl.FLOAT, false, 0, 0);
  }
  function load(surface) {
    now = surface;
    const vertices = surface.vertices;
    const [low, high] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
    for (const vertex of vertices) for (let a = 0; a < 3; a++) { low[a] = Math.min(low[a], vertex[a]); high[a] = Math.max(high[a], vertex[a]); }
    const reach = Math.hypot(...low.map((value, a) => high[a] - value)) / 2 || 1;
    view.over = Boolean(surface.y_down);
    const place = new Float32Array(vertices.flatMap(vertex => vertex.map((value, a) => (value - (low[a] + high[a]) / 2) / reach)));
    const normal = new Float32Array(place.length);
    for (const face of surface.faces) {
      const [p, q, r] = face.map(k => place.subarray(3 * k, 3 * k + 3));
      const [u, v] = [q, r].map(to => [0, 1, 2].map(a => to[a] - p[a]));
      const across = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
      for (const k of face) for (let a = 0; a < 3; a++) normal[3 * k + a] += across[a];
    }
    attribute("place", place);
    attribute("normal", normal);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffers.faces);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, new Uint32Array(surface.faces.flat()), gl.STATIC_DRAW);
    triangles = surface.faces.length;
    recolour();
  }
  function recolour() {
    const errors = now.millimetres;
    const largest = errors.reduce((a, b) => Math.max(a, b ?? 0), 0);
    const end = largest * top.value / 100 || 1;
    attribute("colour", new Float32Array(errors.flatMap(error => (error === null ? [1, 0, 1] : colourAt(error / end)))));
    most.textContent = `${figure(end)} mm${end < largest ? " and more" : ""}`;
    const mean = errors.reduce((sum, error) => sum + (error ?? 0), 0) / (errors.length || 1);
    about.textContent = `mean ${figure(mean)} mm, largest ${figure(largest)} mm, ${count(errors.length)} vertices`;
    draw();
  }
  function draw() {
    const [w, h] = [canvas.clientWidth, canvas.clientHeight].map(size => Math.max(1, Math.round(size * (window.devicePixelRatio || 1))));
    if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
    const [cy, sy, cp, sp] = [Math.cos(view.yaw), Math.sin(view.yaw), Math.cos(view.pitch), Math.sin(view.pitch)];
    // Half a turn about x first, for what hangs with its head down.
    const up = view.over ? -1 : 1;
    const size = 0.92 * view.zoom * Math.min(w, h);
    gl.viewport(0, 0, w, h);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    // Columns of a turn about y, then about x.
    gl.uniformMatrix3fv(gl.getUniformLocation(program, "turn"), false, [cy, sp * sy, -cp * sy, 0, up * cp, up * sp, up * sy, -up * sp * cy, up * cp * cy]);
    gl.uniform3f(gl.getUniformLocation(program, "view"), size / w, size / h, 0.5);
    gl.drawElements(gl.TRIANGLES, 3 * triangles, gl.UNSIGNED_INT, 0);
    canvas.dataset.view = `${view.yaw.toFixed(3)} ${view.pitch.toFixed(3)} ${view.zoom.toFixed(3)}`;
  }
  function turn(dx, dy) {
    view.yaw += dx;
    view.pitch = Math.min(Math.max(view.pitch + dy, -1.57), 1.57);
    draw();
  }
  function zoom(factor) {
    view.zoom = Math.min(Math.max(view.zoom * factor, 0.2), 20);
    draw();
  }
  let held = null;
  canvas.addEventListener("pointerdown", event => { held = [event.clientX, event.clientY]; canvas.setPointerCapture(event.pointerId); });
  canvas.addEventListener("pointermove", event => {
    if (!held) return;
    turn((event.clientX - held[0]) / 120, (event.clientY - held[1]) / 120);
    held = [event.clientX, event.clientY];
  });
  canvas.addEventListener("pointerup", () => { held = null; });
  canvas.addEventListener("wheel", event => { event.preventDefault(); zoom(Math.exp(-event.deltaY / 400)); }, { passive: false });
  canvas.addEventListener("keydown", event => {
    const act = { ArrowLeft: () => turn(-0.15, 0), ArrowRight: () => turn(0.15, 0), ArrowUp: () => turn(0, -0.15), ArrowDown: () => turn(0, 0.15), "+": () => zoom(1.2), "-": () => zoom(1 / 1.2) }[event.key];
    if (act) { event.preventDefault(); act(); }
  });
  new ResizeObserver(draw).observe(frame);
  load(now);
  return [frame, legend];
}
