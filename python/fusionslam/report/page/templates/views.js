// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// The scrubbing view: the current scan beside the first scene of the view it was taken for.
"use strict";
for (const root of document.querySelectorAll(".scrub")) {
  const { runs, previews } = JSON.parse(root.querySelector("script").textContent);
  const part = (name) => root.querySelector(`[data-part="${name}"]`);
  const slider = part("slider"), choice = part("run"), map = part("map");
  let run = runs[0], timer = null;

  const isFalse = (frame) => frame.false !== null;
  const interesting = (frame) => isFalse(frame) || frame.l !== "";

  function colorOf(frame) {
    if (isFalse(frame) || frame.right === false) return "bad";
    return frame.right ? "good" : "";
  }

  function picture(side, place) {
    const image = part(side), none = part(side + "-none");
    const data = place && place.k ? previews[place.k] : null;
    image.hidden = !data;
    none.hidden = Boolean(data);
    if (data) image.src = "data:image/jpeg;base64," + data;
    none.textContent = place ? "no picture" : "no view to show";
    part(side + "-text").textContent = place ? `scan ${place.n}, ${place.t.toFixed(1)} s` : "";
  }

  function span(axis) {
    let low = Infinity, high = -Infinity;
    for (const piece of run.path) for (const p of piece) {
      low = Math.min(low, p[axis]);
      high = Math.max(high, p[axis]);
    }
    return [low, high];
  }

  function drawMap(frame) {
    const context = map.getContext("2d"), edge = 12;
    const [left, right] = span(0), [bottom, top] = span(1);
    const wide = right - left || 1, high = top - bottom || 1;
    const scale = Math.min((map.width - 2 * edge) / wide, (map.height - 2 * edge) / high);
    const across = (map.width - wide * scale) / 2, down = (map.height + high * scale) / 2;
    const at = ([x, y]) => [across + (x - left) * scale, down - (y - bottom) * scale];
    context.clearRect(0, 0, map.width, map.height);
    context.strokeStyle = "#b4b8bf";
    context.beginPath();
    for (const piece of run.path) {
      context.moveTo(...at(piece[0]));
      for (const place of piece.slice(1)) context.lineTo(...at(place));
    }
    context.stroke();
    const arrow = (pose, color) => {
      const [x, y] = at(pose), a = -pose[2];
      context.fillStyle = color;
      context.beginPath();
      for (const [r, turn] of [[10, 0], [6, 2.5], [6, -2.5]]) {
        context.lineTo(x + r * Math.cos(a + turn), y + r * Math.sin(a + turn));
      }
      context.fill();
    };
    if (frame.v >= 0) arrow(run.places[frame.v].p, isFalse(frame) ? "#d73027" : "#1a9850");
    arrow(run.places[frame.i].p, "#0b62a8");
  }

  function show() {
    const frame = run.frames[slider.value], verdict = part("verdict");
    picture("now", run.places[frame.i]);
    picture("view", frame.v >= 0 ? run.places[frame.v] : null);
    part("role").textContent = frame.false === "negative" ? "should have matched" : "its view";
    verdict.textContent = frame.w + (frame.l ? ", " + frame.l : "");
    verdict.className = colorOf(frame);
    const words = [frame.id < 0 ? "no view" : `view ${frame.id}`];
    if (frame.s !== null) words.push(`similarity ${frame.s}`);
    if (frame.d) words.push(`${frame.d} from it`);
    part("words").textContent = words.join(", ");
    drawMap(frame);
  }

  function choose(index) {
    run = runs[index];
    slider.max = run.frames.length - 1;
    slider.value = Math.min(slider.value, slider.max);
    show();
  }

  function step(by, test) {
    const count = run.frames.length;
    for (let i = 1; i <= count; i++) {
      const next = (Number(slider.value) + by * i + count * i) % count;
      if (test(run.frames[next])) { slider.value = next; break; }
    }
    show();
  }

  function play() {
    part("play").textContent = timer ? "play" : "pause";
    timer = timer ? clearInterval(timer) : setInterval(() => step(1, () => true), 250);
  }

  slider.addEventListener("input", show);
  choice.addEventListener("change", () => choose(choice.value));
  part("play").addEventListener("click", play);
  part("back").addEventListener("click", () => step(-1, interesting));
  part("next").addEventListener("click", () => step(1, interesting));
  choose(0);
}
