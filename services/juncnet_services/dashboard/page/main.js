// Asks for the state and for pictures, as often as they can be shown, and shows them.
import { drawChart } from "./chart.js";
import { armed, command, listenForKeys, open, say, stop, stopWord } from "./controls.js";
import { connectDialogs, editMission, openSwap, showMayEdit, showServed } from "./editor.js";
import { state, still } from "./link.js";
import { drawMap } from "./map.js";
import { fill, make, showEvents, showMission, showProcesses, showStatus, summaryRows } from "./panels.js";
import { ageOf, ageText, drawPicture, drawPlane, roadText, stampVerdict, verdict } from "./picture.js";
import { showTiles, tileCanvas } from "./tiles.js";

const $ = (id) => document.getElementById(id);
const STATE_MS = 150;
const HIDDEN_MS = 1000;
const TILE_MS = 400;
const LOST_MS = 1500;
const ROWS = { scores: 1500, smoothed: 1500, path: 20000, events: 400 };

let serial = 0;
let about = null;
let robots = {};
let chosen = null;
let heard = performance.now();
const histories = new Map();
const stills = new Map();
const summarised = new Set();

const pause = (ms) => new Promise((done) => setTimeout(done, ms));
const everyone = () => Object.keys(robots);
const all = () => chosen === "*";
const aimed = () => (all() ? everyone() : robots[chosen] ? [chosen] : []);

function history(name, flight) {
  const known = histories.get(name);
  if (!known || (known.flight && known.flight !== flight)) {
    histories.set(name, { flight, scores: [], smoothed: [], path: [], events: [] });
  } else {
    known.flight = flight;
  }
  return histories.get(name);
}

/** Takes what the dashboard says: rows are added to those that came before. */
function take(answer) {
  if (about && about.epoch !== answer.epoch) {
    histories.clear();
    serial = 0;
    about = answer;
    return;
  }
  const { serial: newest, robots: told, ...rest } = answer;
  [serial, robots, about, heard] = [newest, told, rest, performance.now()];
  for (const [name, robot] of Object.entries(told)) {
    const rows = history(name, robot.flight);
    for (const [kind, most] of Object.entries(ROWS)) {
      const fresh = kind === "events" ? robot.events.map((e) => ({ ...e, came: Date.now() })) : robot[kind];
      rows[kind] = [...rows[kind], ...fresh].slice(-most);
    }
  }
  if (chosen !== "*" && !(chosen in robots)) chosen = everyone()[0] ?? null;
}

async function watchState() {
  for (;;) {
    try {
      take(await state(serial));
      alarm("");
    } catch (error) {
      if (performance.now() - heard > LOST_MS) alarm(`No answer from the dashboard: ${error.message}`);
    }
    show();
    await pause(document.hidden ? HIDDEN_MS : STATE_MS);
  }
}

async function watchPictures() {
  for (;;) {
    const began = performance.now();
    const names = document.hidden ? [] : aimed();
    for (const name of names) await lookAt(name).catch(() => null);
    const least = all() ? TILE_MS : 1000 / (about?.picture_rate_hz ?? 10);
    await pause(Math.max(10, (names.length ? least : 200) - (performance.now() - began)));
  }
}

async function lookAt(name) {
  const fresh = await still(name, stills.get(name));
  if (!fresh) return;
  stills.get(name)?.bitmap.close();
  stills.set(name, fresh);
  const tile = all() ? tileCanvas(name) : null;
  if (tile) {
    drawPicture(tile, fresh);
    stampVerdict(tile, fresh);
  } else if (name === chosen) {
    showPicture();
  }
}

function showPicture() {
  const shown = stills.get(chosen);
  $("nopicture").hidden = Boolean(shown);
  if (!shown) return;
  drawPicture($("camera"), shown);
  drawPlane($("gray"), shown, 0);
  drawPlane($("radon"), shown, 1);
  fill($("road"), roadText(shown.road));
  showAge();
}

function showAge() {
  const shown = stills.get(chosen);
  if (!shown) return;
  const { text, junction } = verdict(shown);
  const age = ageOf(shown);
  // Between two pictures the one shown grows older by as long as the page waits for the next.
  const limit = about.picture_age_s + 2 / about.picture_rate_hz;
  const old = age === null || age > limit;
  fill($("verdict"), text);
  $("verdict").classList.toggle("junction", junction);
  $("picture").classList.toggle("junction", junction && !old);
  $("picture").classList.toggle("old", old);
  fill($("age"), ageText(old ? age : shown.age_s));
  $("age").classList.toggle("old", old);
}

function alarm(text) {
  $("alarm").hidden = !text;
  fill($("alarm"), text);
}

function show() {
  showFrame();
  if (all()) {
    showTiles($("all"), robots, about?.may_command, choose, (name) => stop([name]));
    return;
  }
  const robot = robots[chosen];
  if (!robot) return;
  const rows = history(chosen, robot.flight);
  showStatus(robot);
  showMission(robot);
  showProcesses(robot.processes);
  showEvents(rows.events);
  drawChart($("probability"), rows, robot.navigation?.thresholds);
  fill($("now"), robot.navigation ? robot.navigation.smoothed.toFixed(2) : "");
  $("now").classList.toggle("junction", robot.navigation?.smoothed > (robot.navigation?.thresholds?.enter ?? 1));
  $("nomap").hidden = drawMap($("map"), rows, robot.vehicle);
  showAge();
  if ($("editor").open) showMayEdit(robot);
  if ($("swapper").open) showServed(robot);
  showSummary(robot);
}

/** What is around the robot: which there are, and what may be commanded. */
function showFrame() {
  const names = everyone();
  const may = Boolean(about?.may_command);
  $("one").hidden = !names.length || all();
  $("all").hidden = !all();
  $("nobody").hidden = names.length > 0;
  $("commands").hidden = !may;
  $("rights").hidden = may || !about;
  for (const id of ["resume", "land", "edit", "swap"]) $(id).disabled = !aimed().length || all();
  const stopped = ["stopped", "landing", "emergency"].includes(robots[chosen]?.vehicle?.output);
  $("resume").classList.toggle("offer", stopped);
  if (!$("stop").classList.contains("sent")) fill($("stopword"), stopWord(aimed().length));
  if (all()) fill($("status"), make("span", "pill calm", `${names.length} robots`));
  showChoices(names);
}

function showChoices(names) {
  const choices = names.length > 1 ? [...names, "*"] : [];
  const shown = [...$("robots").children].map((button) => button.dataset.robot);
  if (shown.join() !== choices.join()) {
    $("robots").replaceChildren(...choices.map((name) => {
      const button = make("button", "", name === "*" ? "All" : name);
      button.dataset.robot = name;
      button.addEventListener("click", () => choose(name));
      return button;
    }));
  }
  for (const button of $("robots").children) {
    button.setAttribute("aria-pressed", String(button.dataset.robot === chosen));
  }
}

function choose(name) {
  chosen = name;
  show();
  if (!all()) showPicture();
}

function showSummary(robot) {
  const flight = `${chosen} ${robot.flight}`;
  if (!robot.tally.finished) {
    summarised.delete(flight);
  } else if (!summarised.has(flight)) {
    summarised.add(flight);
    fill($("sums"), ...summaryRows(robot));
    open($("summary"));
  }
}

function setTheme(theme) {
  document.documentElement.dataset.theme = theme;
  localStorage.setItem("theme", theme);
  if (about) show();
}

function act(what) {
  if (!about?.may_command) return say("This page can only watch.", true);
  return what();
}

const sun = window.matchMedia("(prefers-color-scheme: dark)");
const ownTheme = () => localStorage.getItem("theme") ?? (sun.matches ? "dark" : "light");
document.documentElement.dataset.theme = ownTheme();
const otherTheme = () => setTheme(ownTheme() === "dark" ? "light" : "dark");
const stopNow = () => act(() => stop(aimed()));

$("theme").addEventListener("click", otherTheme);
$("keys").addEventListener("click", () => open($("help")));
$("stop").addEventListener("click", stopNow);
armed($("resume"), "Sure?", () => command(aimed(), { do: "resume" }, "Resume"));
armed($("land"), "Sure?", () => command(aimed(), { do: "land" }, "Land"));
$("edit").addEventListener("click", () => editMission(robots[chosen]));
$("swap").addEventListener("click", () => openSwap(robots[chosen], about.followers));
connectDialogs(() => chosen);
const press = (id) => () => act(() => $(id).click());
listenForKeys({
  stop: stopNow,
  choose: (n) => {
    const names = everyone();
    if (n === 0 && names.length > 1) choose("*");
    else if (names[n - 1]) choose(names[n - 1]);
  },
  r: press("resume"),
  l: press("land"),
  m: press("edit"),
  s: press("swap"),
  t: otherTheme,
  "?": () => open($("help")),
});
window.addEventListener("resize", () => about && show());
watchState();
watchPictures();
