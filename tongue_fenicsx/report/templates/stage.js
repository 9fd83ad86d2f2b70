// SPDX-License-Identifier: MIT
// Surfaces on a canvas in WebGL 1, and a camera that the user turns. Lengths in mm, z up.
"use strict";
const VIRIDIS = [[68, 1, 84], [72, 40, 120], [62, 74, 137], [49, 104, 142], [38, 130, 142], [31, 158, 137], [53, 183, 121], [110, 206, 88], [181, 222, 43], [253, 231, 37]];
const STILL = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];

// ---- data
const buffer = (text) => {
  const raw = atob(text), bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
  return bytes.buffer;
};
const edges = (triangles) => {
  const seen = new Set(), n = 2 ** 26;
  for (let i = 0; i < triangles.length; i += 3)
    for (let j = 0; j < 3; j++) {
      const a = triangles[i + j], b = triangles[i + (j + 1) % 3];
      seen.add(Math.min(a, b) * n + Math.max(a, b));
    }
  return Uint32Array.from([...seen].flatMap((key) => [Math.floor(key / n), key % n]));
};
const normals = (p, triangles, out) => {
  out.fill(0);
  for (let i = 0; i < triangles.length; i += 3) {
    const a = 3 * triangles[i], b = 3 * triangles[i + 1], c = 3 * triangles[i + 2];
    const ux = p[b] - p[a], uy = p[b + 1] - p[a + 1], uz = p[b + 2] - p[a + 2];
    const vx = p[c] - p[a], vy = p[c + 1] - p[a + 1], vz = p[c + 2] - p[a + 2];
    const x = uy * vz - uz * vy, y = uz * vx - ux * vz, z = ux * vy - uy * vx;
    for (const k of [a, b, c]) { out[k] += x; out[k + 1] += y; out[k + 2] += z; }
  }
  return out;
};

// The canvas, or null where there is no WebGL; `ask` is called when the camera has moved.
const makeStage = (canvas, ask) => {
  const gl = canvas.getContext("webgl", { antialias: true });
  if (gl === null || gl.getExtension("OES_element_index_uint") === null) return null;
  const program = () => {
    const made = gl.createProgram();
    const add = (kind, source) => {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(made, shader);
    };
    add(gl.VERTEX_SHADER, `
      attribute vec3 position; attribute vec3 normal; attribute float size;
      uniform mat4 view; uniform mat4 pose;
      varying vec3 place; varying vec3 facing; varying float amount;
      void main() {
        vec4 moved = pose * vec4(position, 1.0);
        place = moved.xyz; facing = (pose * vec4(normal, 0.0)).xyz; amount = size;
        gl_Position = view * moved;
      }`);
    add(gl.FRAGMENT_SHADER, `
      precision highp float;
      uniform vec3 eye; uniform vec4 colour; uniform float largest; uniform float plain; uniform float cut; uniform sampler2D table;
      varying vec3 place; varying vec3 facing; varying float amount;
      void main() {
        if (place.y < cut) discard;
        float light = 1.0;
        vec3 base = colour.rgb;
        if (plain < 0.5) {
          vec3 n = normalize(facing), to = normalize(eye - place);
          if (dot(n, to) < 0.0) n = -n;
          light = 0.46 + 0.6 * max(dot(n, normalize(to + vec3(0.0, 0.0, 0.7))), 0.0);
        }
        if (largest > 0.0) base = texture2D(table, vec2(clamp(amount / largest, 0.0, 1.0) * 0.996 + 0.002, 0.5)).rgb;
        gl_FragColor = vec4(base * light, colour.a);
      }`);
    ["position", "normal", "size"].forEach((name, place) => gl.bindAttribLocation(made, place, name));
    gl.linkProgram(made);
    if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
    gl.useProgram(made);
    return Object.fromEntries(["view", "pose", "eye", "colour", "largest", "plain", "cut"].map((name) => [name, gl.getUniformLocation(made, name)]));
  };
  const colours = () => {
    const pixels = new Uint8Array(4 * 256);
    for (let i = 0; i < 256; i++) {
      const at = i / 255 * (VIRIDIS.length - 1), k = Math.min(Math.floor(at), VIRIDIS.length - 2);
      for (let j = 0; j < 3; j++) pixels[4 * i + j] = VIRIDIS[k][j] + (at - k) * (VIRIDIS[k + 1][j] - VIRIDIS[k][j]);
      pixels[4 * i + 3] = 255;
    }
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 256, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    for (const [name, value] of [[gl.TEXTURE_MIN_FILTER, gl.LINEAR], [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE], [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE]])
      gl.texParameteri(gl.TEXTURE_2D, name, value);
  };
  const filled = (kind, values, use) => {
    const made = gl.createBuffer();
    gl.bindBuffer(kind, made);
    gl.bufferData(kind, values, use ?? gl.STATIC_DRAW);
    return made;
  };
  const refill = (target, values) => {
    gl.bindBuffer(gl.ARRAY_BUFFER, target);
    gl.bufferSubData(gl.ARRAY_BUFFER, 0, values);
  };
  const indexed = (values) => ({ index: filled(gl.ELEMENT_ARRAY_BUFFER, values), count: values.length });

  const camera = { yaw: 230, pitch: 20, zoom: 1 };
  const look = (centre, radius) => {
    const yaw = camera.yaw * Math.PI / 180, pitch = camera.pitch * Math.PI / 180, aspect = canvas.width / canvas.height;
    const back = [Math.cos(pitch) * Math.cos(yaw), Math.cos(pitch) * Math.sin(yaw), Math.sin(pitch)];
    const right = [-Math.sin(yaw), Math.cos(yaw), 0];
    const up = [back[1] * right[2] - back[2] * right[1], back[2] * right[0] - back[0] * right[2], back[0] * right[1] - back[1] * right[0]];
    const lens = 3.2 * Math.min(1, aspect); // the cotangent of half the angle that is seen
    const far = radius * 3 / camera.zoom, near = Math.max(far - 4 * radius, far / 50);
    const eye = centre.map((v, j) => v + far * back[j]);
    const dot = (v) => -(v[0] * eye[0] + v[1] * eye[1] + v[2] * eye[2]);
    const end = far + 6 * radius, s = (end + near) / (end - near), o = 2 * end * near / (end - near);
    const rows = [right.map((v) => v * lens / aspect), up.map((v) => v * lens), back.map((v) => -v * s), back.map((v) => -v)];
    const last = [dot(right) * lens / aspect, dot(up) * lens, -dot(back) * s - o, -dot(back)];
    gl.uniformMatrix4fv(uniforms.view, false, [0, 1, 2].flatMap((j) => rows.map((row) => row[j])).concat(last));
    gl.uniform3fv(uniforms.eye, eye);
  };
  const paint = (part, buffers, kind, placed, colour, largest, plain) => {
    [3, 3, 1].forEach((width, place) => {
      if (!buffers[place]) return gl.disableVertexAttribArray(place);
      gl.bindBuffer(gl.ARRAY_BUFFER, buffers[place]);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, width, gl.FLOAT, false, 0, 0);
    });
    gl.uniformMatrix4fv(uniforms.pose, false, placed);
    gl.uniform4fv(uniforms.colour, colour);
    gl.uniform1f(uniforms.largest, largest);
    gl.uniform1f(uniforms.plain, plain);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, part.index);
    gl.drawElements(kind, part.count, gl.UNSIGNED_INT, 0);
  };
  const begin = (centre, radius, cut = -1e6) => { // a picture of what lies around a centre; what has a smaller y than `cut` is left out
    const ratio = window.devicePixelRatio || 1;
    const width = Math.max(Math.round(canvas.clientWidth * ratio), 1), height = Math.max(Math.round(canvas.clientHeight * ratio), 1);
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.uniform1f(uniforms.cut, cut);
    look(centre, radius);
  };
  const turn = (yaw, pitch) => {
    camera.yaw += yaw;
    camera.pitch = Math.min(Math.max(camera.pitch + pitch, -89), 89);
    ask();
  };
  const zoom = (factor) => {
    camera.zoom = Math.min(Math.max(camera.zoom * factor, 0.3), 6);
    ask();
  };
  const face = (view) => {
    [camera.yaw, camera.pitch] = view.split(",").map(Number);
    camera.zoom = 1;
    ask();
  };
  const held = new Map(); // pointers on the canvas: one turns, two zoom
  const apart = () => { const [a, b] = [...held.values()]; return Math.hypot(a.x - b.x, a.y - b.y); };
  canvas.addEventListener("pointerdown", (e) => { canvas.setPointerCapture(e.pointerId); held.set(e.pointerId, { x: e.clientX, y: e.clientY }); });
  canvas.addEventListener("pointermove", (e) => {
    const last = held.get(e.pointerId);
    if (!last) return;
    const gap = held.size === 2 ? apart() : 0;
    if (held.size === 1) turn((last.x - e.clientX) * 0.4, (e.clientY - last.y) * 0.4);
    held.set(e.pointerId, { x: e.clientX, y: e.clientY });
    if (gap > 0) zoom(apart() / gap);
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (e) => held.delete(e.pointerId));
  canvas.addEventListener("wheel", (e) => { e.preventDefault(); zoom(Math.exp(-e.deltaY / 600)); }, { passive: false });
  canvas.addEventListener("keydown", (e) => {
    const act = {
      ArrowLeft: () => turn(-6, 0), ArrowRight: () => turn(6, 0), ArrowUp: () => turn(0, 6), ArrowDown: () => turn(0, -6),
      "+": () => zoom(1.15), "-": () => zoom(1 / 1.15), 0: () => face("230,20"),
    }[e.key];
    if (act) { e.preventDefault(); act(); }
  });
  new ResizeObserver(ask).observe(canvas);

  const uniforms = program();
  colours();
  gl.enable(gl.DEPTH_TEST);
  gl.enable(gl.BLEND);
  gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  return { gl, filled, refill, indexed, begin, paint, face };
};
