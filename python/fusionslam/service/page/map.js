// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// A site from above: a path of dots for each session, and marks for what was found.

const SVG = "http://www.w3.org/2000/svg";
const COLORS = 7;

function shape(name, attributes) {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  return element;
}

// Dots are lines of no length with round ends: one element, however many there are.
const dots = (points) => points.map(([x, y]) => `M${x} ${-y}h0`).join("");

export class SiteMap {
  constructor(svg, legend) {
    this.svg = svg;
    this.legend = legend;
  }

  // sessions: as /v1/sites has them; those with apart are in frames of their own, and hidden at
  // first. Returns the number of places drawn.
  draw(sessions) {
    this.svg.replaceChildren();
    this.legend.replaceChildren();
    this.paths = sessions.filter((each) => each.positions.length).map((session, row) => {
      const color = `s${row % COLORS}`;
      const path = shape("path", { class: color, d: dots(session.positions) });
      path.dataset.session = session.session;
      path.toggleAttribute("hidden", Boolean(session.apart));
      this.addToLegend(session, color, path);
      return { path, positions: session.positions };
    });
    [this.marks, this.scale] = ["marks", "scale"].map((id) => shape("g", { id }));
    this.svg.append(...this.paths.map(({ path }) => path), this.marks, this.scale);
    return this.fit();
  }

  addToLegend({ session, apart }, color, path) {
    const box = document.createElement("input");
    box.type = "checkbox";
    box.checked = !apart;
    box.addEventListener("change", () => {
      path.toggleAttribute("hidden", !box.checked);
      this.fit();
    });
    const swatch = document.createElement("span");
    swatch.className = `swatch ${color}`;
    const label = document.createElement("label");
    label.append(box, swatch, apart ? `${session} (not joined)` : session);
    const item = document.createElement("li");
    item.append(label);
    this.legend.append(item);
  }

  // Shows all of the sessions that are not hidden; returns the number of their places.
  fit() {
    const points = this.paths
      .filter(({ path }) => !path.hasAttribute("hidden")).flatMap(({ positions }) => positions);
    let [left, right, low, high] = [Infinity, -Infinity, Infinity, -Infinity];
    for (const [x, y] of points) {
      left = Math.min(left, x); right = Math.max(right, x);
      low = Math.min(low, y); high = Math.max(high, y);
    }
    if (!points.length) return 0;
    const margin = 0.06 * Math.max(right - left, high - low, 1);
    const width = right - left + 2 * margin;
    this.svg.setAttribute(
      "viewBox", `${left - margin} ${-high - margin} ${width} ${high - low + 3 * margin}`,
    );
    this.addScale(left, -low + margin, width, high - low + 3 * margin);
    return points.length;
  }

  // A line of 1, 2 or 5 times a power of ten, about a fifth of the width.
  addScale(x, y, width, height) {
    const power = 10 ** Math.floor(Math.log10(width / 5));
    const length = power * [5, 2, 1].find((factor) => factor * power <= width / 5);
    const line = shape("path", { class: "scale", d: `M${x} ${y}h${length}` });
    const { clientWidth, clientHeight } = this.svg;
    const pixel = Math.max(width / (clientWidth || 600), height / (clientHeight || 400));
    const text = shape("text", { x, y: y - 5 * pixel });
    text.style.fontSize = `${13 * pixel}px`;
    text.textContent = length < 1000 ? `${length} m` : `${length / 1000} km`;
    this.scale.replaceChildren(line, text);
  }

  // kind: candidate, best or proven; position: [x, y, z].
  mark(kind, position, title) {
    const path = shape("path", { class: kind, d: dots([position]) });
    const about = shape("title", {});
    about.textContent = title;
    path.append(about);
    this.marks.append(path);
  }

  clearMarks() {
    this.marks?.replaceChildren();
  }
}
