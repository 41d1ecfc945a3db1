"use strict";
// The labelling page: keys and mouse to actions, the server's state to pixels. The server saves.

const token = new URLSearchParams(location.search).get("token");
const COLOURS = ["#64a6ff", "#ffb13d", "#58cf7d", "#ef6fae", "#b48cff", "#ffe066", "#4fd1d9", "#ff7b6b", "#b6c2d1"];
const OUT = "repeating-linear-gradient(45deg, #4a505c 0 5px, #2b2f37 5px 10px)";
const SPEEDS = [0.25, 0.5, 1, 2, 4, 8];
const AHEAD = 12;

let state = null;
let clip = 0;
let index = 0;
let playing = false;
let speed = 1;
let toldSeen = 0;
const pictures = new Map();
const $ = (id) => document.getElementById(id);
const current = () => state.clips[clip];
const last = () => current().frames - 1;
const timeOf = (i) => current().times ? current().times[i] : i * current().duration_s / current().frames;
const colour = (label) => label ? COLOURS[state.classes.indexOf(label) % COLOURS.length] : OUT;
const clock = (s) => `${Math.floor(s / 60)}:${(s % 60).toFixed(2).padStart(5, "0")}`;

function address(path, query = {}) {
  return `${path}?${new URLSearchParams({ token, ...query })}`;
}

function toast(text, bad = false) {
  const box = $("toast");
  box.textContent = text;
  box.className = bad ? "on bad" : "on";
  clearTimeout(box.timer);
  box.timer = setTimeout(() => { box.className = bad ? "bad" : ""; }, bad ? 6000 : 900);
}

// One action after the other, in the order of the keys.
let queue = Promise.resolve();
function act(action) {
  queue = queue.then(() => send(action));
  return queue;
}

async function send(action) {
  try {
    const answer = await fetch(address("/action"), { method: "POST", body: JSON.stringify(action) });
    if (!answer.ok) throw new Error(await answer.text());
    take(await answer.json());
    return true;
  } catch (error) {
    playing = false;
    toast(`NOT saved: ${error.message}. Is \`juncnet dataset label\` still running?`, true);
    draw();
    return false;
  }
}

function take(fresh) {
  fresh.clips.forEach((c, i) => {
    const before = state?.clips[i];
    if (before) Object.assign(c, { times: before.times, seen_s: Math.max(c.seen_s, before.seen_s) });
  });
  state = fresh;
  draw();
}

async function loadTimes(which) {
  const name = state.clips[which].name;
  const answer = await fetch(address("/times", { clip: name }));
  state.clips[which].times = await answer.json();
}

function picture(i) {
  const key = `${clip}/${i}`;
  if (!pictures.has(key)) {
    const image = new Image();
    image.src = address("/frame", { clip: current().name, index: i });
    pictures.set(key, image);
    if (pictures.size > 400) pictures.delete(pictures.keys().next().value);
  }
  return pictures.get(key);
}

function show() {
  const image = picture(index);
  const source = image.src;
  image.decode().then(
    () => { if (picture(index).src === source) $("picture").src = source; },
    () => { if (picture(index).src === source) toast("this frame cannot be decoded", true); },
  );
  for (let i = index + 1; playing && i <= Math.min(index + AHEAD * Math.max(1, speed), last()); i++) picture(i);
}

function go(to, seen = false) {
  index = Math.max(0, Math.min(Math.round(to), last()));
  if (seen) tellSeen(false);
  show();
  draw();
}

function tellSeen(now) {
  const at = index === last() ? current().duration_s : timeOf(index);
  if (at <= current().seen_s) return;
  current().seen_s = at;
  if (now || index === last() || performance.now() - toldSeen > 700) {
    toldSeen = performance.now();
    act({ kind: "seen", clip: current().name, to_s: at });
  }
}

function choose(which) {
  if (which < 0 || which >= state.clips.length) return toast("there is no further clip");
  tellSeen(true);
  playing = false;
  clip = which;
  pictures.clear();
  index = 0;
  loadTimes(which).then(() => {
    const seen = current().seen_s;
    const at = current().times.findIndex((t) => t >= seen - 1e-6);
    go(seen >= current().duration_s - 1e-6 ? 0 : Math.max(at, 0));
  });
  document.querySelectorAll(".clip")[which]?.scrollIntoView({ block: "nearest" });
}

function play() {
  if (playing) { playing = false; tellSeen(true); return draw(); }
  if (index >= last()) go(0);
  playing = true;
  let begun = performance.now();
  let from = timeOf(index);
  let rate = speed;
  const step = async () => {
    if (!playing) return;
    if (rate !== speed) { begun = performance.now(); from = timeOf(index); rate = speed; }
    const due = from + (performance.now() - begun) / 1000 * rate;
    let next = index;
    while (next < last() && timeOf(next + 1) <= due) next++;
    if (next !== index) {
      const image = picture(next);
      if (!image.complete) {  // The picture is late: wait for it instead of leaving frames out.
        await image.decode().catch(() => {});
        begun = performance.now();
        from = timeOf(next);
      }
      if (playing) go(next, true);
    }
    if (index >= last()) { playing = false; tellSeen(true); draw(); return; }
    requestAnimationFrame(step);
  };
  requestAnimationFrame(step);
  show();
  draw();
}

async function mark(label) {
  const name = label || "left out";
  tellSeen(false);
  await act({ kind: "mark", clip: current().name, at_s: timeOf(index), label });
  if (!$("toast").classList.contains("bad")) toast(`${name} from ${clock(timeOf(index))}`);
}

async function undo() {
  if (!state.undoable) return toast("nothing to undo");
  await act({ kind: "undo" });
  toast("undone");
}

function nameSite() {
  playing = false;
  const site = prompt("Where was this clip filmed? Clips of one place share a name.", current().site);
  if (site !== null) act({ kind: "site", clip: current().name, site: site.trim() });
}

function labelAt(time) {
  const marks = current().marks;
  let label = null;
  for (const [at, name] of marks) if (at <= time + 1e-6) label = name;
  return label;
}

function toChange(way) {
  const here = timeOf(index);
  const times = current().marks.map(([at]) => at);
  const to = way > 0 ? times.find((t) => t > here + 1e-3) : times.filter((t) => t < here - 1e-3).pop();
  if (to === undefined) return toast("no further change");
  let i = 0;
  while (i < last() && timeOf(i) < to - 1e-3) i++;
  go(i);
}

// What each mark says, up to the next one or to where the clip was watched.
function bars(of) {
  return of.marks.map(([from, label], i) => {
    const to = i + 1 < of.marks.length ? of.marks[i + 1][0] : Math.max(of.seen_s, from);
    const part = document.createElement("i");
    part.style.left = `${100 * from / of.duration_s}%`;
    part.style.width = `${100 * (to - from) / of.duration_s}%`;
    part.style.background = colour(label);
    return part;
  });
}

function draw() {
  if (!state) return;
  const of = current();
  const time = timeOf(index);
  const label = labelAt(time);
  $("time").textContent = `${clock(time)} / ${clock(of.duration_s)}`;
  $("now").textContent = label === null ? "not labelled" : label || "left out";
  $("now").style.background = label === null ? "#8d95a3" : label ? colour(label) : "#c9ced6";
  $("play").textContent = `${playing ? "❚❚" : "▶"}  ${speed}×`;
  $("undo").disabled = !state.undoable;
  $("site").textContent = `site: ${of.site || "?"}`;
  $("saved").textContent = `saved in ${state.out}`;
  drawTimeline(of, time);
  drawKeys(label);
  drawClips();
}

function drawTimeline(of, time) {
  const seen = document.createElement("i");
  seen.id = "seen";
  seen.style.width = `${100 * of.seen_s / of.duration_s}%`;
  const head = document.createElement("i");
  head.id = "head";
  head.style.left = `calc(${100 * time / of.duration_s}% - 1px)`;
  $("timeline").replaceChildren(...bars(of), seen, head);
}

function drawKeys(label) {
  const names = [...state.classes, ""];
  $("keys").replaceChildren(...names.map((name, i) => {
    const button = document.createElement("button");
    const key = document.createElement("kbd");
    key.textContent = name ? i + 1 : "0";
    const dot = document.createElement("span");
    dot.className = "dot";
    dot.style.background = colour(name);
    button.append(key, dot, name || "leave out");
    button.className = name === label ? "on" : "";
    button.onclick = () => mark(name);
    return button;
  }));
}

function drawClips() {
  const title = document.createElement("h1");
  const done = state.clips.filter((c) => c.marks.length && c.seen_s >= c.duration_s - 0.05).length;
  title.textContent = `${done} of ${state.clips.length} clips done`;
  $("clips").replaceChildren(title, ...state.clips.map((of, i) => {
    const row = document.createElement("div");
    row.className = i === clip ? "clip current" : "clip";
    const name = document.createElement("div");
    name.className = "name";
    name.textContent = of.name;
    const said = document.createElement("div");
    said.className = "said";
    said.textContent = `${clock(of.duration_s)}  ${of.site}`;
    const bar = document.createElement("div");
    bar.className = "bar";
    bar.append(...bars(of));
    row.append(name, said, bar);
    row.onclick = () => choose(i);
    return row;
  }));
}

const KEYS = {
  " ": play,
  ArrowLeft: (e) => step(-1, e.shiftKey),
  ArrowRight: (e) => step(1, e.shiftKey),
  ArrowUp: () => faster(1),
  ArrowDown: () => faster(-1),
  Home: () => { playing = false; go(0); },
  End: () => { playing = false; go(last()); },
  ",": () => toChange(-1),
  ".": () => toChange(1),
  n: () => choose(clip + 1),
  p: () => choose(clip - 1),
  u: undo,
  Backspace: undo,
  s: nameSite,
};

function step(way, second) {
  playing = false;
  if (!second) return go(index + way, way > 0);
  const to = timeOf(index) + way;
  let i = index;
  while (way > 0 ? i < last() && timeOf(i) < to : i > 0 && timeOf(i) > to) i += way;
  go(i, way > 0);
}

function faster(way) {
  const place = SPEEDS.indexOf(speed) + way;
  speed = SPEEDS[Math.max(0, Math.min(place, SPEEDS.length - 1))];
  draw();
}

document.addEventListener("keydown", (event) => {
  if (!state || event.altKey) return;
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  if ((event.ctrlKey || event.metaKey) && key !== "z") return;
  const number = /^[0-9]$/.test(key) ? Number(key) : null;
  if (number !== null && number <= state.classes.length) mark(number ? state.classes[number - 1] : "");
  else if (key === "z") undo();
  else if (KEYS[key]) KEYS[key](event);
  else return;
  event.preventDefault();
  document.activeElement?.blur();
});

function scrub(event) {
  const box = $("timeline").getBoundingClientRect();
  const time = (event.clientX - box.left) / box.width * current().duration_s;
  let i = 0;
  while (i < last() && timeOf(i + 1) <= time) i++;
  go(i);
}

$("timeline").addEventListener("pointerdown", (event) => {
  playing = false;
  $("timeline").setPointerCapture(event.pointerId);
  scrub(event);
});
$("timeline").addEventListener("pointermove", (event) => { if (event.buttons) scrub(event); });
$("play").onclick = play;
$("undo").onclick = undo;
$("site").onclick = nameSite;
window.addEventListener("pagehide", () => {
  const body = JSON.stringify({ kind: "seen", clip: current().name, to_s: current().seen_s });
  navigator.sendBeacon(address("/action"), body);
});

fetch(address("/state"))
  .then((answer) => answer.json())
  .then((fresh) => {
    take(fresh);
    const unfinished = state.clips.findIndex((c) => c.seen_s < c.duration_s - 0.05);
    choose(Math.max(unfinished, 0));
  });
