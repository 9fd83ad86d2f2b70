// SPDX-License-Identifier: MIT
// The motion of the tongue in WebGL 1, and the controls of the page. Lengths in mm, z up.
"use strict";
(() => {
  const VIRIDIS = [[68, 1, 84], [72, 40, 120], [62, 74, 137], [49, 104, 142], [38, 130, 142], [31, 158, 137], [53, 183, 121], [110, 206, 88], [181, 222, 43], [253, 231, 37]];
  const BONE = [0.7, 0.57, 0.42, 0.32], WIRE = [0.55, 0.55, 0.55, 0.35];
  const SECONDS = 4; // one pass through a run
  const STILL = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];

  const page = JSON.parse(document.getElementById("data").textContent);
  const by = (id) => document.getElementById(id);
  const articles = [...document.querySelectorAll("article.run")];
  const canvas = by("canvas");

  // ---- data
  const buffer = (text) => {
    const raw = atob(text), bytes = new Uint8Array(raw.length);
    for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
    return bytes.buffer;
  };
  const shared = (number) => buffer(page.shared[number]); // what several runs have in common stands once in the page
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

  // ---- WebGL
  const gl = canvas.getContext("webgl", { antialias: true });
  const drawable = gl !== null && gl.getExtension("OES_element_index_uint") !== null;
  by("missing").hidden = drawable;
  by("viewer").hidden = !drawable;

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
      uniform vec3 eye; uniform vec4 colour; uniform float largest; uniform float plain; uniform sampler2D table;
      varying vec3 place; varying vec3 facing; varying float amount;
      void main() {
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
    return Object.fromEntries(["view", "pose", "eye", "colour", "largest", "plain"].map((name) => [name, gl.getUniformLocation(made, name)]));
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

  // ---- one run: rest, displacement, what is drawn
  const load = (run) => {
    const rest = new Float32Array(shared(run.rest)), triangles = new Uint32Array(shared(run.triangles));
    const scene = {
      ...run, rest, triangles, moves: new Int16Array(buffer(run.displacement)),
      now: rest.slice(), normal: new Float32Array(rest.length), size: new Float32Array(rest.length / 3),
    };
    const ends = (pick) => [0, 1, 2].map((j) => {
      let found = rest[j];
      for (let i = j; i < rest.length; i += 3) found = pick(found, rest[i]);
      return found;
    });
    const low = ends(Math.min), high = ends(Math.max);
    scene.centre = low.map((v, j) => (v + high[j]) / 2);
    scene.radius = Math.hypot(...low.map((v, j) => high[j] - v)) / 2 || 1;
    scene.buffers = [scene.now, scene.normal, scene.size].map((values) => filled(gl.ARRAY_BUFFER, values, gl.DYNAMIC_DRAW));
    scene.skin = indexed(triangles);
    scene.wire = { ...indexed(edges(triangles)), buffers: [filled(gl.ARRAY_BUFFER, rest)] };
    scene.bones = run.obstacles.map((bone) => {
      const points = new Float32Array(shared(bone.points)), sides = new Uint32Array(shared(bone.triangles));
      const arrays = [points, normals(points, sides, new Float32Array(points.length))];
      return { ...indexed(sides), poses: bone.poses, buffers: arrays.map((values) => filled(gl.ARRAY_BUFFER, values)) };
    });
    return scene;
  };
  const drop = (old) => {
    for (const part of [old, old.skin, old.wire, ...old.bones])
      for (const made of [...(part.buffers ?? []), part.index]) if (made) gl.deleteBuffer(made);
  };

  // ---- state
  let scene = null, uniforms = null, time = 0, playing = false, before = 0, asked = false;
  const camera = { yaw: 230, pitch: 20, zoom: 1 };

  const moment = () => { // the frame before `time` and the share of the way to the next
    const t = scene.times;
    let k = 0;
    while (k < t.length - 2 && t[k + 1] <= time) k++;
    return t.length < 2 ? [0, 0] : [k, Math.min(Math.max((time - t[k]) / (t[k + 1] - t[k]), 0), 1)];
  };
  const move = (k, share) => {
    const { rest, moves, now, size, unit } = scene, n = rest.length, a = k * n, b = share > 0 ? a + n : a;
    for (let i = 0; i < n; i += 3) {
      const x = unit * (moves[a + i] + share * (moves[b + i] - moves[a + i]));
      const y = unit * (moves[a + i + 1] + share * (moves[b + i + 1] - moves[a + i + 1]));
      const z = unit * (moves[a + i + 2] + share * (moves[b + i + 2] - moves[a + i + 2]));
      now[i] = rest[i] + x; now[i + 1] = rest[i + 1] + y; now[i + 2] = rest[i + 2] + z;
      size[i / 3] = Math.hypot(x, y, z);
    }
    normals(now, scene.triangles, scene.normal);
    [now, scene.normal, size].forEach((values, i) => refill(scene.buffers[i], values));
  };
  const pose = (bone, k, share) => {
    const a = bone.poses[k], b = bone.poses[Math.min(k + 1, bone.poses.length - 1)];
    const p = a.map((v, i) => v + share * (b[i] - v));
    return [p[0], p[3], p[6], 0, p[1], p[4], p[7], 0, p[2], p[5], p[8], 0, p[9], p[10], p[11], 1];
  };
  const look = () => {
    const yaw = camera.yaw * Math.PI / 180, pitch = camera.pitch * Math.PI / 180, aspect = canvas.width / canvas.height;
    const back = [Math.cos(pitch) * Math.cos(yaw), Math.cos(pitch) * Math.sin(yaw), Math.sin(pitch)];
    const right = [-Math.sin(yaw), Math.cos(yaw), 0];
    const up = [back[1] * right[2] - back[2] * right[1], back[2] * right[0] - back[0] * right[2], back[0] * right[1] - back[1] * right[0]];
    const lens = 3.2 * Math.min(1, aspect); // the cotangent of half the angle that is seen
    const far = scene.radius * 3 / camera.zoom, near = Math.max(far - 4 * scene.radius, far / 50);
    const eye = scene.centre.map((v, j) => v + far * back[j]);
    const dot = (v) => -(v[0] * eye[0] + v[1] * eye[1] + v[2] * eye[2]);
    const end = far + 6 * scene.radius, s = (end + near) / (end - near), o = 2 * end * near / (end - near);
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
  const draw = (instant) => {
    asked = false;
    if (playing) {
      const [first, last] = [scene.times[0], scene.times.at(-1)];
      time += (instant - before) / 1000 * (last - first) / SECONDS;
      if (time > last) time = first;
      before = instant;
      ask();
    }
    const ratio = window.devicePixelRatio || 1;
    const width = Math.max(Math.round(canvas.clientWidth * ratio), 1), height = Math.max(Math.round(canvas.clientHeight * ratio), 1);
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const [k, share] = moment();
    move(k, share);
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    look();
    paint(scene.skin, scene.buffers, gl.TRIANGLES, STILL, [1, 1, 1, 1], page.largest || 1, 0);
    gl.depthMask(false); // what is translucent hides nothing
    if (by("rest").checked) paint(scene.wire, scene.wire.buffers, gl.LINES, STILL, WIRE, 0, 1);
    if (by("obstacles").checked) for (const bone of scene.bones) paint(bone, bone.buffers, gl.TRIANGLES, pose(bone, k, share), BONE, 0, 0);
    gl.depthMask(true);
    tell(k + Math.round(share));
  };
  const ask = () => {
    if (!asked && scene) { asked = true; requestAnimationFrame(draw); }
  };
  const tell = (frame) => { // the time, in the controls and in the charts
    const ms = 1000 * time;
    by("slider").value = frame;
    by("slider").setAttribute("aria-valuetext", `${ms.toFixed(0)} ms`);
    by("clock").value = `${ms.toFixed(0)} ms`;
    for (const svg of scene.charts) {
      const { from, to, left, width } = svg.dataset, mark = svg.querySelector(".now");
      mark.style.visibility = "visible";
      mark.setAttribute("transform", `translate(${+left + (ms - from) / (to - from) * width} 0)`);
    }
  };

  // ---- controls
  const play = (wanted) => {
    playing = wanted && scene.times.length > 1;
    by("play").textContent = playing ? "Pause" : "Play";
    before = performance.now();
    ask();
  };
  const choose = (number) => {
    articles.forEach((article, i) => { article.hidden = i !== number; });
    if (!drawable) return;
    if (scene) drop(scene);
    scene = load(page.runs[number]);
    scene.charts = [...articles[number].querySelectorAll("svg[data-from]")];
    time = scene.times[scene.start];
    by("slider").max = scene.times.length - 1;
    by("around").hidden = scene.bones.length === 0;
    const slower = SECONDS / (scene.times.at(-1) - scene.times[0]);
    by("hint").textContent = slower > 1.05 && Number.isFinite(slower) ? `plays ${slower.toPrecision(2)} times slower than real` : "";
    play(false);
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

  by("selector").addEventListener("change", () => choose(by("selector").selectedIndex));
  if (!drawable) { choose(0); return; }

  uniforms = program();
  colours();
  gl.enable(gl.DEPTH_TEST);
  gl.enable(gl.BLEND);
  gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  by("colours").style.background = `linear-gradient(to right, ${VIRIDIS.map((c) => `rgb(${c})`).join(", ")})`;
  for (const share of [0, 0.5, 1]) by("numbers").append(Object.assign(document.createElement("span"), { textContent: `${+(share * page.largest).toPrecision(3)}` }));

  by("play").addEventListener("click", () => play(!playing));
  by("slider").addEventListener("input", () => { time = scene.times[+by("slider").value]; play(false); });
  for (const id of ["rest", "obstacles"]) by(id).addEventListener("change", ask);
  for (const button of document.querySelectorAll("[data-view]")) button.addEventListener("click", () => face(button.dataset.view));

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
  document.addEventListener("keydown", (e) => {
    if (e.key !== " " || e.target.closest("button, select, summary, a, input[type=checkbox]")) return;
    e.preventDefault();
    play(!playing);
  });
  new ResizeObserver(ask).observe(canvas);
  choose(0);
})();
