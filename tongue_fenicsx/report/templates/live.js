// SPDX-License-Identifier: MIT
// The reduced tongue in the browser: its fading memories (network.py says what they are), its surface, and what moves it. Lengths in mm.
"use strict";
(() => {
  const page = JSON.parse(document.getElementById("data").textContent);
  const by = (id) => document.getElementById(id);
  const floats = (text) => new Float32Array(buffer(text));
  const TICK = 0.05, LENGTH = 1.0; // s between the knots of the timeline, and its length
  const LEFT = 64; // pixels of the names in the timeline
  const BONE = [0.7, 0.57, 0.42, 0.18];
  const COLOURS = [0, 1, 2, 3, 4, 5, 6, 7].map((i) => `var(--c${i})`);

  // ---- the model: as network.py and tongue.py
  const W = Object.fromEntries(Object.entries(page.weights).map(([name, { shape, values }]) => [name, { shape, values: Float64Array.from(floats(values)) }]));
  const nets = W.V.shape[0], modes = page.scales.length, even = modes - page.odd, muscles = page.muscles.map((muscle) => muscle.name);
  const apart = muscles.flatMap((_, i) => (page.muscles[i].apart ? [i] : [])); // whose sides it knows
  const times = (w, net, x, out) => { // out = x W of one network
    const [, rows, columns] = w.shape, at = net * rows * columns;
    out.fill(0);
    for (let i = 0; i < rows; i++) {
      const value = x[i];
      if (value === 0) continue;
      for (let j = 0, k = at + i * columns; j < columns; j++, k++) out[j] += value * w.values[k];
    }
    return out;
  };
  const layers = [1, 2, 3].map((number) => ({ w: W[`W${number}`], b: W[`b${number}`], width: W[`W${number}`].shape[2], log: W[`log_tau${number}`] }));
  const model = { time: 0, q: new Float64Array(modes), doubt: 0, inputs: new Float64Array(muscles.length + apart.length), memories: [] };
  const reset = () => {
    model.time = model.doubt = 0;
    model.q.fill(0);
    model.inputs.fill(0);
    model.memories = [Array.from({ length: nets }, () => layers.slice(0, 2).map(({ width }) => ({ x: new Float64Array(width), z: new Float64Array(width) })))];
  };
  const features = (layer, net, seen) => {
    const { w, b, width } = layers[layer], out = times(w, net, seen, new Float64Array(width));
    for (let j = 0; j < width; j++) {
      const at = b.values[net * width + j];
      out[j] = Math.tanh(out[j] + at) - Math.tanh(at);
    }
    return out;
  };
  const follow = (net, memories, inputs, h) => { // the answer of one network
    let everything = inputs;
    for (let layer = 0; layer < 2; layer++) {
      const z = features(layer, net, everything), memory = memories[layer], { width, log } = layers[layer];
      for (let j = 0; j < width; j++) { // the solution of τ ẋ = z − x where z goes linearly
        const tau = Math.exp(log.values[net * width + j]), slope = (z[j] - memory.z[j]) / h;
        memory.x[j] = z[j] - tau * slope + (memory.x[j] - memory.z[j] + tau * slope) * Math.exp(-h / tau);
      }
      memory.z = z;
      const joined = new Float64Array(everything.length + width);
      joined.set(everything);
      joined.set(memory.x, everything.length);
      everything = joined;
    }
    const q = times(W.V, net, everything, new Float64Array(modes)), more = times(W.U, net, features(2, net, everything), new Float64Array(modes));
    return q.map((value, k) => value + more[k]);
  };
  const advance = (inputs, h) => {
    if (model.memories.length === 1 && inputs.some((value, i) => i >= muscles.length && value)) model.memories.push(structuredClone(model.memories[0]));
    const mirrored = inputs.map((value, i) => (i < muscles.length ? value : -value)), answers = [];
    for (let net = 0; net < nets; net++) { // and its mirror image, from when the sides part
      const [there, image] = model.memories.map((memories, i) => follow(net, memories[net], i ? mirrored : inputs, h));
      answers.push(there.map((value, k) => (k < even ? (image ? (value + image[k]) / 2 : value) : image ? (value - image[k]) / 2 : 0)));
    }
    let squares = 0;
    for (let k = 0; k < modes; k++) {
      model.q[k] = answers.reduce((sum, q) => sum + q[k], 0) / nets;
      for (const q of answers) squares += (q[k] - model.q[k]) ** 2;
    }
    model.doubt = page.doubt * Math.sqrt(squares / nets);
    model.inputs.set(inputs);
    model.time += h;
  };
  const levelOf = (i, side) => {
    const half = apart.indexOf(i);
    return model.inputs[i] + (half < 0 ? 0 : (side ? -1 : 1) * model.inputs[muscles.length + half]);
  };
  const step = (left, right, dt) => { // as ReducedTongue.step
    const inputs = Float64Array.from([...muscles.map((_, i) => (left[i] + right[i]) / 2), ...apart.map((i) => (left[i] - right[i]) / 2)]);
    const n = Math.ceil(dt / page.step - 1e-9), from = Float64Array.from(model.inputs);
    for (let k = 1; k <= n; k++) advance(from.map((value, i) => value + (inputs[i] - value) * k / n), dt / n);
  };

  // ---- its surface
  const rest = floats(page.rest), triangles = new Uint32Array(buffer(page.triangles)), size = rest.length, n = size / 3;
  const shapes = new Int16Array(buffer(page.modes));
  const exact = new Float64Array(size), now = rest.slice(), normal = new Float32Array(size), amount = new Float32Array(n);
  const place = () => {
    exact.set(rest);
    for (let k = 0; k < modes; k++) {
      const factor = model.q[k] * page.scales[k];
      if (factor === 0) continue;
      for (let i = 0, at = k * size; i < size; i++, at++) exact[i] += factor * shapes[at];
    }
    if (room) clear();
    now.set(exact);
  };
  const room = page.room && { ...page.room, units: new Int8Array(buffer(page.room.units)) }; // as room.py
  const clear = () => { // what got into a wall comes out, along the slope of the distance
    const { origin, shape: [nx, ny, nz], spacing, unit, steps, units } = room, limits = [nx, ny, nz];
    const cell = [0, 0, 0], share = [0, 0, 0], nearest = [0, 0, 0];
    for (let i = 0; i < size; i += 3) {
      for (let j = 0; j < 3; j++) nearest[j] = Math.round((exact[i + j] - origin[j]) / spacing);
      if (nearest.some((node, j) => node < 0 || node >= limits[j])) continue;
      if (unit * units[(nearest[0] * ny + nearest[1]) * nz + nearest[2]] >= 2 * spacing) continue;
      for (let k = 0; k < steps; k++) {
        for (let j = 0; j < 3; j++) {
          const place = (exact[i + j] - origin[j]) / spacing;
          cell[j] = Math.min(Math.max(Math.floor(place), 0), limits[j] - 2);
          share[j] = Math.min(Math.max(place - cell[j], 0), 1);
        }
        const [x, y, z] = share, c = (a, b, d) => unit * units[((cell[0] + a) * ny + cell[1] + b) * nz + cell[2] + d];
        const alongZ = (a, b) => c(a, b, 0) + z * (c(a, b, 1) - c(a, b, 0)), alongY = (a) => alongZ(a, 0) + y * (alongZ(a, 1) - alongZ(a, 0));
        const up = (a, b) => c(a, b, 1) - c(a, b, 0), near = alongY(0), far = alongY(1), distance = near + x * (far - near);
        if (distance >= 0) break;
        const slope = [
          far - near, (1 - x) * (alongZ(0, 1) - alongZ(0, 0)) + x * (alongZ(1, 1) - alongZ(1, 0)),
          (1 - x) * ((1 - y) * up(0, 0) + y * up(0, 1)) + x * ((1 - y) * up(1, 0) + y * up(1, 1)),
        ].map((value) => value / spacing);
        const factor = distance / Math.max(slope[0] ** 2 + slope[1] ** 2 + slope[2] ** 2, 0.25);
        for (let j = 0; j < 3; j++) exact[i + j] -= factor * slope[j];
      }
    }
  };
  const weight = new Float32Array(n), inverse = new Float64Array(4 * triangles.length / 3);
  const frame = (p, t, out) => { // edges of a triangle in its plane: length of the first, the second along and across
    const a = 3 * triangles[t], b = 3 * triangles[t + 1], c = 3 * triangles[t + 2];
    const ux = p[b] - p[a], uy = p[b + 1] - p[a + 1], uz = p[b + 2] - p[a + 2], vx = p[c] - p[a], vy = p[c + 1] - p[a + 1], vz = p[c + 2] - p[a + 2];
    const u = Math.hypot(ux, uy, uz), along = (ux * vx + uy * vy + uz * vz) / u;
    out[0] = u; out[1] = along; out[2] = Math.sqrt(Math.max(vx * vx + vy * vy + vz * vz - along * along, 1e-12));
  };
  const edge = [0, 0, 0];
  for (let t = 0; t < triangles.length; t += 3) {
    frame(rest, t, edge);
    inverse.set([1 / edge[0], -edge[1] / (edge[0] * edge[2]), 1 / edge[2]], 4 * t / 3);
    for (let j = 0; j < 3; j++) weight[triangles[t + j]] += 1;
  }
  const strain = () => { // largest Hencky strain in the surface, mean of the triangles around a node
    amount.fill(0);
    for (let t = 0; t < triangles.length; t += 3) {
      frame(now, t, edge);
      const k = 4 * t / 3, f11 = edge[0] * inverse[k], f12 = edge[0] * inverse[k + 1] + edge[1] * inverse[k + 2], f22 = edge[2] * inverse[k + 2];
      const c11 = f11 * f11, c12 = f11 * f12, c22 = f12 * f12 + f22 * f22, mean = (c11 + c22) / 2, apart = Math.hypot((c11 - c22) / 2, c12);
      const most = Math.max(Math.log(mean + apart), -Math.log(Math.max(mean - apart, 1e-9))) / 2;
      for (let j = 0; j < 3; j++) amount[triangles[t + j]] += most / weight[triangles[t + j]];
    }
  };
  const length = () => {
    for (let i = 0; i < n; i++) amount[i] = Math.hypot(now[3 * i] - rest[3 * i], now[3 * i + 1] - rest[3 * i + 1], now[3 * i + 2] - rest[3 * i + 2]);
  };
  const QUANTITIES = { displacement: { of: length, largest: 15, says: "displacement in mm" }, strain: { of: strain, largest: 0.8, says: "largest strain in the surface" } };

  // ---- what moves it: a timeline of knots for each muscle, or the sliders
  const knots = Math.round(LENGTH / TICK) + 1;
  const course = [0, 1].map(() => muscles.map(() => new Float64Array(knots))); // of the left sides and of the right ones
  const wanted = [0, 1].map(() => new Float64Array(muscles.length));
  let channels = []; // what a slider and a row of the timeline move: both sides of a muscle, or one
  const ofSides = () => {
    channels = muscles.flatMap((name, i) => (by("sides").checked && apart.includes(i)
      ? [{ name: `${name}_L`, i, sides: [0] }, { name: `${name}_R`, i, sides: [1] }] : [{ name, i, sides: [0, 1] }]));
  };
  const at = (t) => course.map((side) => side.map((of) => {
    const x = Math.min(Math.max(t / TICK, 0), knots - 1), k = Math.min(Math.floor(x), knots - 2);
    return of[k] + (x - k) * (of[k + 1] - of[k]);
  }));
  const hold = (levels, rise, fall) => Object.fromEntries(Object.entries(levels).map(([name, level]) => [name, (t) => (t < rise ? level * t / rise : t < fall ? level : Math.max(0, level * (1 - (t - fall) / rise)))]));
  const PRESETS = { // postures as demos/postures/ has them
    "GGP: root forward, body up": hold({ GGP: 0.5 }, 0.1, 0.6),
    "/i/": hold({ GGP: 0.304, SG: 0.118, TRANS: 0.128, GH: 0.074 }, 0.1, 0.6),
    "/a/": hold({ GGM: 0.025, GGA: 0.083, SG: 0.017, HG: 0.072, IL: 0.006, VERT: 0.006, MH: 0.005 }, 0.1, 0.6),
    "/u/": hold({ GGP: 0.044, GGA: 0.012, SG: 0.119, IL: 0.014, VERT: 0.043, TRANS: 0.048, GH: 0.012, MH: 0.031 }, 0.1, 0.6),
    "/t/": hold({ GGP: 0.593, GGM: 0.397, IL: 0.018, SL: 0.031, VERT: 0.055, TRANS: 0.165, GH: 0.136 }, 0.1, 0.6),
    "/k/": hold({ GGP: 0.055, SG: 0.208, TRANS: 0.192, MH: 0.009 }, 0.1, 0.6),
    "to the palate: MH, GGP, SL": hold({ MH: 0.5, GGP: 0.6, SL: 0.2 }, 0.1, 0.6),
    "back: SG, HG": hold({ SG: 0.4, HG: 0.3 }, 0.1, 0.6),
    "GGP, then HG": { ...hold({ GGP: 0.5 }, 0.1, 0.35), HG: (t) => (t < 0.5 ? 0 : hold({ HG: 0.5 }, 0.1, 0.35).HG(t - 0.5)) },
    "tip up and down: SL, IL": { SL: (t) => 0.4 * Math.max(0, Math.sin(2 * Math.PI * t / 0.5)), IL: (t) => 0.4 * Math.max(0, -Math.sin(2 * Math.PI * t / 0.5)) },
  };
  const usePreset = (name) => {
    for (const side of course) side.forEach((of, i) => { for (let k = 0; k < knots; k++) of[k] = PRESETS[name][muscles[i]]?.(k * TICK) ?? 0; });
    drawTimeline();
  };

  // ---- pictures
  let playing = false, last = 0, asked = false;
  const ask = () => { if (!asked) { asked = true; requestAnimationFrame(draw); } };
  const stage = makeStage(by("canvas"), ask);
  by("missing").hidden = stage !== null;
  by("solid").hidden = stage === null;
  const ends = (pick) => [0, 1, 2].map((j) => { let found = rest[j]; for (let i = j; i < size; i += 3) found = pick(found, rest[i]); return found; });
  const low = ends(Math.min), high = ends(Math.max), centre = low.map((v, j) => (v + high[j]) / 2), radius = Math.hypot(...low.map((v, j) => high[j] - v)) / 2;
  const solid = stage && (({ gl, filled, indexed }) => ({
    skin: indexed(triangles), arrays: [now, normal, amount].map((values) => filled(gl.ARRAY_BUFFER, values, gl.DYNAMIC_DRAW)),
    bones: page.bones.map((bone) => {
      const points = floats(page.shared[bone.points]), sides = new Uint32Array(buffer(page.shared[bone.triangles]));
      return { ...indexed(sides), arrays: [points, normals(points, sides, new Float32Array(points.length))].map((values) => filled(gl.ARRAY_BUFFER, values)) };
    }),
  }))(stage);
  const drawSolid = () => {
    const { gl, paint, refill, begin } = stage, kind = QUANTITIES[by("colour").value];
    kind.of();
    normals(now, triangles, normal);
    [now, normal, amount].forEach((values, i) => refill(solid.arrays[i], values));
    begin(centre, 1.15 * radius);
    paint(solid.skin, solid.arrays, gl.TRIANGLES, STILL, [1, 1, 1, 1], kind.largest, 0);
    if (!by("bones").checked) return;
    gl.depthMask(false); // what is translucent hides nothing
    for (const bone of solid.bones) paint(bone, bone.arrays, gl.TRIANGLES, STILL, BONE, 0, 0);
    gl.depthMask(true);
  };
  const sized = (canvas) => { // its context, in CSS pixels
    const ratio = window.devicePixelRatio || 1, { clientWidth: width, clientHeight: height } = canvas, context = canvas.getContext("2d");
    if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
    if (canvas.height !== Math.round(height * ratio)) canvas.height = Math.round(height * ratio);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    return { context, width, height };
  };
  const ink = (name) => getComputedStyle(document.body).getPropertyValue(name).trim();
  const trails = Object.entries(page.trails).map(([name, node]) => ({ name, node, path: [] }));
  const sections = page.bones.map((bone) => floats(bone.section));
  const window2 = { x: [low[0] - 16, high[0] + 12], z: [low[2] - 8, high[2] + 18] };
  const drawSection = () => {
    const { context, width, height } = sized(by("section")), { x, z } = window2;
    const scale = Math.min(width / (x[1] - x[0]), height / (z[1] - z[0]));
    const X = (v) => width / 2 + scale * (v - (x[0] + x[1]) / 2), Z = (v) => height / 2 - scale * (v - (z[0] + z[1]) / 2);
    const path = (p, chain) => { // smooth through the nodes (Catmull and Rom)
      const place = (i) => { const node = 3 * chain[Math.min(Math.max(i, 0), chain.length - 1)]; return [X(p[node]), Z(p[node + 2])]; };
      context.beginPath();
      context.moveTo(...place(0));
      for (let i = 0; i + 1 < chain.length; i++) {
        const [a, b, c, d] = [i - 1, i, i + 1, i + 2].map(place);
        context.bezierCurveTo(b[0] + (c[0] - a[0]) / 6, b[1] + (c[1] - a[1]) / 6, c[0] - (d[0] - b[0]) / 6, c[1] - (d[1] - b[1]) / 6, c[0], c[1]);
      }
    };
    if (by("bones").checked) {
      context.beginPath();
      for (const lines of sections) for (let i = 0; i < lines.length; i += 4) { context.moveTo(X(lines[i]), Z(lines[i + 1])); context.lineTo(X(lines[i + 2]), Z(lines[i + 3])); }
      Object.assign(context, { lineWidth: 2, strokeStyle: "rgb(179, 145, 107)", lineCap: "round" });
      context.stroke();
    }
    for (const chain of page.outline) {
      path(rest, chain);
      Object.assign(context, { lineWidth: 1, strokeStyle: ink("--soft") });
      context.setLineDash([3, 4]);
      context.stroke();
      context.setLineDash([]);
      path(now, chain);
      Object.assign(context, { lineWidth: 2.5, strokeStyle: ink("--accent"), fillStyle: `${ink("--accent")}22`, lineJoin: "round" });
      context.fill();
      context.stroke();
    }
    context.font = "12px system-ui, sans-serif";
    trails.forEach(({ name, node, path: trail, full }, i) => {
      context.beginPath();
      trail.forEach(([a, b], k) => context[k ? "lineTo" : "moveTo"](X(a), Z(b)));
      Object.assign(context, { lineWidth: 1.5, strokeStyle: ink(`--c${i + 1}`), fillStyle: ink(`--c${i + 1}`) });
      context.stroke();
      if (full) {
        context.beginPath();
        full.forEach(([a, b], k) => context[k ? "lineTo" : "moveTo"](X(a), Z(b)));
        context.setLineDash([1, 3]);
        context.stroke();
        context.setLineDash([]);
      }
      const [a, b] = [X(now[3 * node]), Z(now[3 * node + 2])];
      context.beginPath();
      context.arc(a, b, 3.5, 0, 7);
      context.fill();
      context.fillText(name, a + 7, b + (name === "dorsum" ? -7 : 14));
    });
    context.fillStyle = ink("--soft");
    context.fillText("← front", 12, 20);
    const bar = 10 * scale;
    context.fillRect(width - bar - 14, 20, bar, 2);
    context.fillText("10 mm", width - bar - 14, 15);
  };
  const spots = page.electrodes.map(([x, y]) => Object.assign(document.createElementNS("http://www.w3.org/2000/svg", "circle"), { place: [x, y] }));
  const drawElectrodes = () => {
    let on = 0;
    const reach = page.reach * page.reach;
    page.electrodes.forEach(([x, y, z], k) => {
      let touched = false;
      for (let t = 0; t < triangles.length && !touched; t += 3) { // near a corner first, then the middle of the triangle
        const a = 3 * triangles[t], dx = now[a] - x, dy = now[a + 1] - y, dz = now[a + 2] - z;
        if (dx * dx + dy * dy + dz * dz < 16) touched = distance2(t, x, y, z) <= reach || below(t, x, y, z);
      }
      spots[k].classList.toggle("on", touched);
      on += touched;
    });
    by("touched").textContent = on;
  };
  const distance2 = (t, x, y, z) => { // squared, of a point from a triangle, by its barycentric foot kept inside
    const a = 3 * triangles[t], b = 3 * triangles[t + 1], c = 3 * triangles[t + 2];
    const u = [0, 1, 2].map((j) => now[b + j] - now[a + j]), v = [0, 1, 2].map((j) => now[c + j] - now[a + j]), p = [x - now[a], y - now[a + 1], z - now[a + 2]];
    const dot = (f, g) => f[0] * g[0] + f[1] * g[1] + f[2] * g[2];
    const uu = dot(u, u), uv = dot(u, v), vv = dot(v, v), pu = dot(p, u), pv = dot(p, v), det = uu * vv - uv * uv;
    let s = Math.max(0, (vv * pu - uv * pv) / det), r = Math.max(0, (uu * pv - uv * pu) / det);
    if (s + r > 1) { const sum = s + r; s /= sum; r /= sum; }
    return [0, 1, 2].reduce((sum, j) => sum + (p[j] - s * u[j] - r * v[j]) ** 2, 0);
  };
  const below = (t, x, y, z) => { // whether the triangle has gone through the palate there: it lies above the electrode
    const a = 3 * triangles[t], b = 3 * triangles[t + 1], c = 3 * triangles[t + 2];
    const d = (now[b] - now[a]) * (now[c + 1] - now[a + 1]) - (now[c] - now[a]) * (now[b + 1] - now[a + 1]);
    const s = ((x - now[a]) * (now[c + 1] - now[a + 1]) - (now[c] - now[a]) * (y - now[a + 1])) / d;
    const r = ((now[b] - now[a]) * (y - now[a + 1]) - (x - now[a]) * (now[b + 1] - now[a + 1])) / d;
    return d > 0 && s >= 0 && r >= 0 && s + r <= 1 && now[a + 2] + s * (now[b + 2] - now[a + 2]) + r * (now[c + 2] - now[a + 2]) >= z;
  };
  const drawTimeline = () => {
    const { context, width, height } = sized(by("timeline")), row = height / channels.length;
    const T = (t) => LEFT + (width - LEFT - 8) * t / LENGTH;
    context.font = "12px system-ui, sans-serif";
    channels.forEach(({ name, i, sides: [side] }, at) => {
      const base = (at + 1) * row - 3, tall = row - 6, colour = ink(`--c${i % 8}`);
      context.fillStyle = ink("--rule");
      context.fillRect(LEFT, base, width - LEFT - 8, 1);
      context.fillStyle = ink("--soft");
      context.fillText(name, 6, base - 3);
      context.beginPath();
      context.moveTo(T(0), base);
      course[side][i].forEach((level, k) => context.lineTo(T(k * TICK), base - level * tall));
      context.lineTo(T(LENGTH), base);
      Object.assign(context, { strokeStyle: colour, lineWidth: 1.5, fillStyle: colour });
      context.globalAlpha = 0.25;
      context.fill();
      context.globalAlpha = 1;
      context.stroke();
    });
    if (playing) { context.fillStyle = ink("--accent"); context.fillRect(T(Math.min(model.time, LENGTH)), 0, 1.5, height); }
  };
  let sliders = [];
  const makeSliders = () => {
    ofSides();
    by("timeline").style.height = channels.length > muscles.length ? `${1.55 * channels.length}rem` : "";
    sliders = channels.map(({ name, i, sides }) => {
      const slider = Object.assign(document.createElement("input"), { type: "range", min: 0, max: 1, step: 0.01, value: wanted[sides[0]][i], autocomplete: "off" });
      const label = document.createElement("label"), title = Object.assign(document.createElement("b"), { textContent: name }), output = document.createElement("output");
      title.style.color = COLOURS[i % 8];
      label.title = page.muscles[i].says;
      label.append(title, slider, output);
      slider.addEventListener("input", () => {
        if (playing) play(false);
        for (const side of sides) wanted[side][i] = +slider.value;
        run();
      });
      return { label, slider, output };
    });
    by("muscles").replaceChildren(...sliders.map(({ label }) => label));
    tell();
  };
  const tell = () => {
    channels.forEach(({ i, sides: [side] }, k) => {
      const level = levelOf(i, side);
      sliders[k].output.textContent = level.toFixed(2);
      if (playing) sliders[k].slider.value = level;
    });
    by("clock").textContent = `${Math.round(1000 * model.time)} ms`;
    by("doubt").textContent = `± ${model.doubt.toFixed(2)} mm`;
    by("doubt").classList.toggle("far", model.doubt > 1);
  };
  const shares = { model: 0, pictures: 0, frames: 0 };
  const draw = (instant) => {
    asked = false;
    const dt = Math.min(Math.max((instant - last) / 1000, 0.001), 0.1), begin = performance.now();
    last = instant;
    if (playing) {
      if (model.time >= LENGTH - 1e-9) { if (by("loop").checked) start(); else play(false); }
      else step(...at(model.time + dt), Math.min(dt, LENGTH - model.time));
    } else if (moving > 0) {
      step(...wanted, dt);
      moving -= dt;
    }
    place();
    const middle = performance.now();
    for (const { node, path } of trails) {
      path.push([now[3 * node], now[3 * node + 2]]);
      if (path.length > 400) path.shift();
    }
    if (stage) drawSolid();
    drawSection();
    if (spots.length) drawElectrodes();
    if (playing) drawTimeline();
    tell();
    shares.model += middle - begin;
    shares.pictures += performance.now() - middle;
    shares.frames += 1;
    if (playing || moving > 0) ask();
  };
  let moving = 0; // s for which memories have not faded since a slider moved
  const run = () => {
    if (moving <= 0) last = performance.now();
    moving = 2;
    ask();
  };
  const start = () => {
    reset();
    for (const { path } of trails) path.length = 0;
  };
  const play = (on) => {
    playing = on;
    by("play").textContent = on ? "Pause" : "Play";
    last = performance.now();
    if (on && (model.time >= LENGTH - 1e-9 || moving > 0 || wanted.flatMap((side) => [...side]).some((level) => level))) start();
    if (on) for (const side of wanted) side.fill(0);
    else wanted.forEach((levels, side) => muscles.forEach((_, i) => { levels[i] = levelOf(i, side); }));
    moving = 0;
    drawTimeline();
    ask();
  };

  // ---- what goes out
  const pieces = (of) => { // as few as draw the same course
    const found = [];
    for (let k = 0; k + 1 < knots; k++) {
      const slope = of[k + 1] - of[k], before = found.at(-1);
      if (before && Math.abs(before.slope - slope) < 1e-9) { before.duration += TICK; before.target = of[k + 1]; }
      else found.push({ duration: TICK, start: of[k], target: of[k + 1], slope });
    }
    return `[${found.map(({ duration, start, target }) => `[${+duration.toFixed(4)}, ${+start.toFixed(4)}, ${+target.toFixed(4)}]`).join(", ")}]`;
  };
  const toml = () => [
    page.scenario, "[time]", `end = ${LENGTH.toFixed(1)}`, "",
    ...channels.flatMap(({ name, i, sides: [side] }) => (course[side][i].some((level) => level > 0) ? [`[activation.${name}]`, `pieces = ${pieces(course[side][i])}`, ""] : [])),
  ].join("\n");
  const csv = () => [["time_s", ...channels.map(({ name }) => name)].join(","), ...Array.from({ length: knots }, (_, k) => [+(k * TICK).toFixed(4), ...channels.map(({ i, sides: [side] }) => +course[side][i][k].toFixed(4))].join(","))].join("\n");
  const save = (name, text) => {
    const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(new Blob([`${text}\n`], { type: "text/plain" })), download: name });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  };

  const check = async () => { // the full model's paths beside ours, and how far they part
    by("check").disabled = true;
    by("checked").textContent = "The full model runs; that takes a minute.";
    const found = await fetch("check", { method: "POST", body: toml() }).then((answer) => answer.json()).catch((error) => ({ error: String(error) }));
    by("check").disabled = false;
    if (found.error) { by("checked").textContent = found.error; return; }
    play(false);
    start();
    const apart = trails.map(() => 0);
    found.time.forEach((t, i) => {
      if (i) step(...at(t), t - found.time[i - 1]);
      place();
      trails.forEach(({ name, node }, k) => { apart[k] += Math.hypot(...[0, 1, 2].map((j) => now[3 * node + j] - found.paths[name][i][j])) / found.time.length; });
    });
    trails.forEach((trail) => { trail.full = found.paths[trail.name].map(([x, , z]) => [x, z]); });
    by("checked").textContent = `The full model took ${found.seconds.toFixed(0)} s (${found.folder}, dotted). Mean distance: ${trails.map(({ name }, k) => `${name} ${apart[k].toFixed(2)} mm`).join(", ")}.`;
    ask();
  };

  // ---- controls
  by("check").hidden = location.protocol === "file:";
  if (!by("check").hidden) by("checked").textContent = "";
  by("check").addEventListener("click", check);
  for (const name of Object.keys(PRESETS)) by("preset").append(new Option(name, name));
  by("preset").addEventListener("change", () => { usePreset(by("preset").value); play(true); });
  by("play").addEventListener("click", () => play(!playing));
  by("rest").addEventListener("click", () => { play(false); start(); for (const side of wanted) side.fill(0); sliders.forEach(({ slider }) => { slider.value = 0; }); ask(); });
  by("clear").addEventListener("click", () => { for (const side of course) side.forEach((of) => of.fill(0)); drawTimeline(); });
  by("toml").addEventListener("click", () => save("live.toml", toml()));
  by("csv").addEventListener("click", () => save("live.csv", csv()));
  by("bones").addEventListener("change", ask);
  by("sides").parentElement.hidden = !apart.length;
  by("sides").addEventListener("change", () => { // together again, both do what the left ones did
    if (!by("sides").checked) [course, wanted].forEach(([left, right]) => left.forEach((of, i) => { if (of.set) right[i].set(of); else right[i] = of; }));
    makeSliders();
    drawTimeline();
    if (!playing) run();
  });
  const scale = () => {
    const { largest, says } = QUANTITIES[by("colour").value];
    by("quantity").textContent = says;
    by("numbers").replaceChildren(...[0, 0.5, 1].map((share) => Object.assign(document.createElement("span"), { textContent: `${+(share * largest).toPrecision(3)}` })));
    ask();
  };
  by("colours").style.background = `linear-gradient(to right, ${VIRIDIS.map((c) => `rgb(${c})`).join(", ")})`;
  by("colour").addEventListener("change", scale);
  for (const button of document.querySelectorAll("[data-view]")) button.addEventListener("click", () => stage?.face(button.dataset.view));
  let drawn = null; // the knot and row that the pointer drew last
  const paintCourse = (e) => {
    const box = by("timeline").getBoundingClientRect(), row = box.height / channels.length;
    const k = Math.min(Math.max(Math.round((e.clientX - box.left - LEFT) / (box.width - LEFT - 8) * LENGTH / TICK), 0), knots - 1);
    const at = drawn?.at ?? Math.min(Math.max(Math.floor((e.clientY - box.top) / row), 0), channels.length - 1), { i, sides } = channels[at];
    const level = Math.round(100 * Math.min(Math.max(((at + 1) * row - 3 - (e.clientY - box.top)) / (row - 6), 0), 1)) / 100;
    const from = drawn ?? { k, level };
    for (const of of sides.map((side) => course[side][i])) {
      for (let j = Math.min(k, from.k); j <= Math.max(k, from.k); j++) of[j] = k === from.k ? level : from.level + (level - from.level) * (j - from.k) / (k - from.k);
      of[0] = 0;
    }
    drawn = { at, k, level };
    drawTimeline();
  };
  by("timeline").addEventListener("pointerdown", (e) => { by("timeline").setPointerCapture(e.pointerId); drawn = null; paintCourse(e); });
  by("timeline").addEventListener("pointermove", (e) => { if (drawn) paintCourse(e); });
  for (const end of ["pointerup", "pointercancel"]) by("timeline").addEventListener(end, () => { drawn = null; });
  document.addEventListener("keydown", (e) => {
    if (e.key !== " " || e.target.closest("button, select, input[type=checkbox]")) return;
    e.preventDefault();
    play(!playing);
  });
  if (spots.length) {
    const xs = page.electrodes.map(([x]) => x), ys = page.electrodes.map(([, y]) => y);
    by("electrodes").setAttribute("viewBox", `${Math.min(...ys) - 3} ${Math.min(...xs) - 3} ${Math.max(...ys) - Math.min(...ys) + 6} ${Math.max(...xs) - Math.min(...xs) + 6}`);
    spots.forEach((spot) => { spot.setAttribute("cx", spot.place[1]); spot.setAttribute("cy", spot.place[0]); spot.setAttribute("r", 1.2); });
    by("electrodes").append(...spots);
  } else by("palate").hidden = true;
  new ResizeObserver(() => { drawTimeline(); ask(); }).observe(by("timeline"));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { drawTimeline(); ask(); });
  window.live = { reset, step, model, toml, csv, shares, place, surface: () => { place(); return Array.from(now); } }; // for whoever wants to ask it
  reset();
  makeSliders();
  usePreset(Object.keys(PRESETS)[0]);
  scale();
})();
