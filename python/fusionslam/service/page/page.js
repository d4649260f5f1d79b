// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Shows the sites of the service, the places of one, and where a scan was found among them.

import { SiteMap } from "/page/map.js";

const at = (id) => document.getElementById(id);
const map = new SiteMap(at("map"), at("legend"));
const KEY = "fusionslam-key";
const PAGE = "/sites/";
const LISTED = 100; // sites with a link of their own
const site = location.pathname.startsWith(PAGE)
  ? decodeURIComponent(location.pathname.slice(PAGE.length)) : null;
let shown = site;
let proves = false; // whether the clouds of places are stored
let joint = null; // names of the sessions of the joint map of the site that is shown

class Problem extends Error {
  constructor(status, { code, message }) {
    super(message);
    Object.assign(this, { status, code });
  }
}

async function ask(path, options = {}) {
  const key = sessionStorage.getItem(KEY);
  const headers = key ? { Authorization: `Bearer ${key}` } : {};
  const answer = await fetch(path, { ...options, headers });
  const content = await answer.json();
  if (answer.ok) return content;
  if (answer.status === 401) {
    sessionStorage.removeItem(KEY);
    at("key-form").hidden = false;
  }
  throw new Problem(answer.status, content);
}

const counted = (number, noun) => `${number.toLocaleString("en")} ${noun}${number === 1 ? "" : "s"}`;
const nameOf = (name) => name || "(no site)";

async function start() {
  const counts = await ask("/v1/places");
  at("key-form").hidden = true;
  const sites = Object.keys(counts.sites).sort();
  shown = site ?? sites[0] ?? null;
  proves = counts.proves;
  at("sites").replaceChildren(...sites.slice(0, LISTED).map(link));
  at("only").hidden = sites.length < 2;
  at("lead").textContent = [
    counted(counts.places, "place"), counted(sites.length, "site"),
    counted(Object.keys(counts.sessions).length, "session"), counts.descriptor,
  ].join(" · ");
  if (shown !== null) await show(shown);
}

function link(name) {
  const element = document.createElement("a");
  element.href = PAGE + encodeURIComponent(name);
  element.textContent = nameOf(name);
  if (name === shown) element.setAttribute("aria-current", "page");
  return element;
}

async function show(name) {
  at("title").textContent = nameOf(name);
  const paths = await ask(`/v1/sites/${encodeURIComponent(name)}`);
  const joined = paths.map?.sessions ?? [];
  joint = joined.length ? new Set(joined.map((each) => each.session)) : null;
  at("map-card").hidden = false;
  if (joint) showJoint(paths);
  else showApart(paths);
}

function showApart(paths) {
  const drawn = map.draw(paths.sessions);
  at("map-note").textContent = drawn
    ? `${counted(drawn, "place")} drawn of ${paths.places}${oneOf(paths.every)}, from above. Sessions whose frames are not joined lie over each other.`
    : "The positions of these places are not known.";
}

function showJoint({ map: { keyframes, every, sessions }, sessions: all }) {
  const others = all.filter(({ session }) => !joint.has(session));
  const drawn = map.draw([...sessions, ...others.map((each) => ({ ...each, apart: true }))]);
  const count = counted(others.length, "session");
  const apart = [
    "", ` ${count} is not joined: ticked, it is drawn in its own frame.`,
    ` ${count} are not joined: ticked, they are drawn in frames of their own.`,
  ][Math.min(others.length, 2)];
  at("map-note").textContent = `The joint map from above: ${counted(drawn, "keyframe")} drawn of ${keyframes}${oneOf(every)}, by session.${apart}`;
}

const oneOf = (every) => (every > 1 ? `, one of ${every}` : "");

async function find(file) {
  const format = file.name.split(".").pop().toLowerCase();
  const parameters = new URLSearchParams({ format, k: 10 });
  if (at("here").checked && shown !== null) parameters.set("site", shown);
  const route = proves ? "locate" : "query";
  const found = await ask(`/v1/${route}?${parameters}`, { method: "POST", body: file });
  const reason = "the clouds of these places are not stored";
  return proves ? found : { candidates: found.results[0], place: null, reason };
}

function showFound({ candidates, place, site_from_robot: own, map_from_robot: common, probability, reason }) {
  map.clearMarks();
  candidates.filter((each) => each.site === shown).reverse().forEach((each) => {
    const kind = each.key === candidates[0].key ? "best" : "candidate";
    const pose = joint ? each.map_pose : each.pose;
    if (pose) map.mark(kind, position(pose), `${each.session}, frame ${each.frame}`);
  });
  const isHere = place?.site === shown;
  const pose = isHere && joint ? common : own;
  if (isHere && pose) map.mark("proven", position(pose), "the scan");
  at("answer").textContent = place
    ? proof(place, common ?? own, probability, common && "in the joint map")
    : likeness(candidates, reason);
  at("candidates").hidden = !candidates.length;
  at("candidates").tBodies[0].replaceChildren(...candidates.map(row));
}

const position = (matrix) => matrix.slice(0, 3).map((line) => line[3]);

function proof({ site, session, frame }, pose, probability, map) {
  const [x, y] = pose ? position(pose).map((value) => value.toFixed(1)) : [];
  const frameOf = map ?? "in the frame of its session";
  const where = pose ? ` at x ${x} m, y ${y} m ${frameOf}` : "";
  const sure = probability.toFixed(3);
  return `Found on ${nameOf(site)}${where}: session ${session}, near frame ${frame} (probability ${sure}).`;
}

function likeness(candidates, reason) {
  if (!candidates.length) return "No place was found.";
  const [{ site, session, frame }] = candidates;
  return `Looks most like ${nameOf(site)}, session ${session}, frame ${frame}. Not proven: ${reason}.`;
}

function row(candidate) {
  const line = document.createElement("tr");
  const seen = new Date(candidate.stamp_ns / 1e6).toISOString().slice(0, 19).replace("T", " ");
  const { session, site, robot, frame, distance } = candidate;
  for (const text of [session, nameOf(site), robot, frame, seen, distance.toFixed(3)]) {
    line.insertCell().textContent = text;
  }
  return line;
}

function tell(element, error) {
  element.textContent = error instanceof Problem ? error.message : "The service does not answer.";
  element.classList.add("problem");
}

async function guarded(element, work) {
  element.classList.remove("problem");
  try {
    await work();
  } catch (error) {
    tell(element, error);
  }
}

at("key-form").addEventListener("submit", (event) => {
  event.preventDefault();
  sessionStorage.setItem(KEY, at("key").value.trim());
  guarded(at("lead"), start);
});

at("scan-form").addEventListener("submit", async (event) => {
  event.preventDefault();
  at("find").disabled = true;
  at("answer").textContent = "Searching.";
  await guarded(at("answer"), async () => showFound(await find(at("scan").files[0])));
  at("find").disabled = false;
});

guarded(at("lead"), start);
