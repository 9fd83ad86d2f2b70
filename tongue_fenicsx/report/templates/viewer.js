// SPDX-License-Identifier: MIT
// The motion of the tongue, and the controls of the page; after stage.js. Lengths in mm.
"use strict";
(() => {
  const BONE = [0.7, 0.57, 0.42, 0.32], WIRE = [0.55, 0.55, 0.55, 0.35], NET = [0.8, 0.2, 0.1, 0.6];
  const SECONDS = 4; // one pass through a run

  const page = JSON.parse(document.getElementById("data").textContent);
  const by = (id) => document.getElementById(id);
  const articles = [...document.querySelectorAll("article.run")];
  const canvas = by("canvas");

  const shared = (number) => buffer(page.shared[number]); // what several runs have in common stands once in the page
  let scene = null, other = null, colour = "displacement", time = 0, playing = false, before = 0, asked = false;
  const ask = () => {
    if (!asked && scene) { asked = true; requestAnimationFrame(draw); }
  };
  const stage = makeStage(canvas, ask);
  by("missing").hidden = stage !== null;
  by("viewer").hidden = stage === null;
  const { gl, filled, refill, indexed, paint } = stage ?? {};

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
    scene.section = indexed(new Uint32Array(shared(run.section)));
    scene.colours = Object.fromEntries(Object.entries(run.fields).map(([name, field]) => [name, new Uint8Array(buffer(field.values))]));
    scene.wire = { ...indexed(edges(triangles)), buffers: [filled(gl.ARRAY_BUFFER, rest)] };
    scene.bones = run.obstacles.map((bone) => {
      const points = new Float32Array(shared(bone.points)), sides = new Uint32Array(shared(bone.triangles));
      const arrays = [points, normals(points, sides, new Float32Array(points.length))];
      return { ...indexed(sides), poses: bone.poses, buffers: arrays.map((values) => filled(gl.ARRAY_BUFFER, values)) };
    });
    return scene;
  };
  const drop = (old) => {
    for (const part of [old, old.skin, old.section, old.wire, ...old.bones])
      for (const made of [...(part.buffers ?? []), part.index]) if (made) gl.deleteBuffer(made);
  };

  // ---- state
  const moment = (scene) => { // the frame before `time` and the share of the way to the next
    const t = scene.times;
    let k = 0;
    while (k < t.length - 2 && t[k + 1] <= time) k++;
    return t.length < 2 ? [0, 0] : [k, Math.min(Math.max((time - t[k]) / (t[k + 1] - t[k]), 0), 1)];
  };
  const move = (scene, k, share) => {
    const { rest, moves, now, size, unit } = scene, n = rest.length, a = k * n, b = share > 0 ? a + n : a;
    for (let i = 0; i < n; i += 3) {
      const x = unit * (moves[a + i] + share * (moves[b + i] - moves[a + i]));
      const y = unit * (moves[a + i + 1] + share * (moves[b + i + 1] - moves[a + i + 1]));
      const z = unit * (moves[a + i + 2] + share * (moves[b + i + 2] - moves[a + i + 2]));
      now[i] = rest[i] + x; now[i + 1] = rest[i + 1] + y; now[i + 2] = rest[i + 2] + z;
      size[i / 3] = Math.hypot(x, y, z);
    }
    const values = scene.colours[colour];
    if (values) { // in units of the scale
      const { low, high } = scene.fields[colour], scale = page.scales[colour], span = scale.high - scale.low || 1, nodes = n / 3;
      const from = k * nodes, to = share > 0 ? from + nodes : from;
      for (let i = 0; i < nodes; i++)
        size[i] = (low - scale.low + (high - low) / 255 * (values[from + i] + share * (values[to + i] - values[from + i]))) / span;
    }
    normals(now, scene.triangles, scene.normal);
    [now, scene.normal, size].forEach((values, i) => refill(scene.buffers[i], values));
  };
  const pose = (bone, k, share) => {
    const a = bone.poses[k], b = bone.poses[Math.min(k + 1, bone.poses.length - 1)];
    const p = a.map((v, i) => v + share * (b[i] - v));
    return [p[0], p[3], p[6], 0, p[1], p[4], p[7], 0, p[2], p[5], p[8], 0, p[9], p[10], p[11], 1];
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
    const [k, share] = moment(scene), cut = by("cut").checked, largest = scene.colours[colour] ? 1 : page.scales.displacement.high || 1;
    move(scene, k, share);
    stage.begin(scene.centre, scene.radius, cut ? -0.1 : undefined);
    paint(scene.skin, scene.buffers, gl.TRIANGLES, STILL, [1, 1, 1, 1], largest, 0);
    if (cut) paint(scene.section, scene.buffers, gl.TRIANGLES, STILL, [1, 1, 1, 1], largest, 1);
    if (other) {
      move(other, ...moment(other));
      paint(other.wire, other.buffers, gl.LINES, STILL, NET, 0, 1);
    }
    gl.depthMask(false); // what is translucent hides nothing
    if (by("rest").checked) paint(scene.wire, scene.wire.buffers, gl.LINES, STILL, WIRE, 0, 1);
    if (by("obstacles").checked) for (const bone of scene.bones) paint(bone, bone.buffers, gl.TRIANGLES, pose(bone, k, share), BONE, 0, 0);
    gl.depthMask(true);
    tell(k + Math.round(share));
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
    if (stage === null) return;
    if (scene) drop(scene);
    scene = load(page.runs[number]);
    if (!(colour in page.runs[number].fields)) colour = "displacement";
    describe();
    scene.charts = [...articles[number].querySelectorAll("svg[data-from]")];
    time = scene.times[scene.start];
    by("slider").max = scene.times.length - 1;
    by("table").hidden = scene.table === "";
    by("around").hidden = scene.bones.length === 0;
    const slower = SECONDS / (scene.times.at(-1) - scene.times[0]);
    by("hint").textContent = slower > 1.05 && Number.isFinite(slower) ? `plays ${slower.toPrecision(2)} times slower than real` : "";
    play(false);
  };
  const describe = () => { // the scale of colours
    const { low, high } = page.scales[colour];
    if (by("colour")) by("colour").value = colour;
    by("numbers").replaceChildren(...[0, 0.5, 1].map((share) =>
      Object.assign(document.createElement("span"), { textContent: `${+(low + share * (high - low)).toPrecision(3)}` })));
  };
  const save = (name, content) => {
    const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(content), download: name });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  };
  const named = (ending) => `${scene.label.replace(/[^\w.-]+/g, "_")}${ending}`;
  by("selector").addEventListener("change", () => choose(by("selector").selectedIndex));
  if (stage === null) { choose(0); return; }

  by("colours").style.background = `linear-gradient(to right, ${VIRIDIS.map((c) => `rgb(${c})`).join(", ")})`;

  by("play").addEventListener("click", () => play(!playing));
  by("slider").addEventListener("input", () => { time = scene.times[+by("slider").value]; play(false); });
  by("colour")?.addEventListener("change", () => {
    colour = by("colour").value in scene.fields ? by("colour").value : "displacement";
    describe();
    ask();
  });
  by("other").addEventListener("change", () => {
    if (other) drop(other);
    const number = +by("other").value;
    other = number < 0 ? null : load(page.runs[number]);
    ask();
  });
  by("table").addEventListener("click", () => save(named(".csv"), new Blob([scene.table], { type: "text/csv" })));
  by("picture").addEventListener("click", () => {
    draw(performance.now()); // what is drawn is gone when the browser has shown it
    const sheet = Object.assign(document.createElement("canvas"), { width: canvas.width, height: canvas.height }), pen = sheet.getContext("2d");
    pen.fillStyle = "white";
    pen.fillRect(0, 0, sheet.width, sheet.height);
    pen.drawImage(canvas, 0, 0);
    sheet.toBlob((blob) => save(named(`_${(1000 * time).toFixed(0)}ms.png`), blob));
  });
  for (const id of ["rest", "obstacles", "cut"]) by(id).addEventListener("change", ask);
  for (const button of document.querySelectorAll("[data-view]")) button.addEventListener("click", () => stage.face(button.dataset.view));

  document.addEventListener("keydown", (e) => {
    if (e.key !== " " || e.target.closest("button, select, summary, a, input[type=checkbox]")) return;
    e.preventDefault();
    play(!playing);
  });
  choose(0);
})();
