// The panels that are made of text: status, mission, processes, events, summary.
import { eventText, outputText, phaseText, way, wayWord } from "./words.js";

const $ = (id) => document.getElementById(id);
const AT_JUNCTION = ["approaching", "crossing", "turning", "aligning"];
const EVENT_ROWS = 120;

/** Makes an element with a class and children (elements or text). */
export function make(tag, className, ...children) {
  const element = document.createElement(tag);
  if (className) element.className = className;
  element.append(...children);
  return element;
}

/** Replaces what an element holds only if the text of it has changed: nothing flickers or jumps. */
export function fill(element, ...children) {
  const fresh = make("div", "", ...children);
  if (element.innerHTML !== fresh.innerHTML) element.replaceChildren(...fresh.childNodes);
}

export function showStatus(robot) {
  const [word, mood] = outputText(robot.vehicle);
  fill($("status"), make("span", `pill ${mood}`, word), make("dl", "facts", ...vitals(robot.vehicle)));
}

/** A turn as an arrow or an angle, or a tick. */
export function arrow(turn, done = false) {
  const angle = turn?.angle_deg !== undefined;
  return make("span", angle ? "way angle" : "way", done ? "✓" : way(turn));
}

/** The strip of junctions: done, here, next and to come. */
export function strip(navigation) {
  const { mission, count, phase } = navigation;
  const here = AT_JUNCTION.includes(phase) ? count : 0;
  const finished = phase === "finished";
  const named = Math.max(0, ...mission.turns.map((turn) => turn.at));
  const last = mission.finish_after ?? Math.max(named, count + 4);
  const first = mission.finish_after ? 1 : Math.max(1, count - 5);
  const cells = [];
  for (let n = first; n <= last; n++) {
    const turn = mission.turns.find((t) => t.at === n);
    const next = !finished && n === count + 1 && !here;
    const state = n === here ? "here" : n <= count ? "done" : next ? "next" : "";
    const cell = make("li", state, arrow(state === "done" ? null : turn, state === "done"), make("span", "number", n));
    cell.title = `junction ${n}: ${wayWord(turn)}`;
    if (state === "here") cell.setAttribute("aria-current", "step");
    cells.push(cell);
  }
  return cells;
}

function fact(name, value) {
  return make("div", "", make("dt", "", name), make("dd", "", value));
}

/** What the vehicle measures, as facts. */
function vitals(vehicle) {
  if (!vehicle) return [];
  const facts = [fact(vehicle.measured ? "speed" : "speed told", `${vehicle.speed_mps.toFixed(1)} m/s`)];
  if (vehicle.height_m !== null && vehicle.kind === "copter") facts.push(fact("height", `${vehicle.height_m} m`));
  if (vehicle.battery !== null) facts.push(fact("battery", `${Math.round(100 * vehicle.battery)} %`));
  return facts;
}

export function showMission(robot) {
  const { navigation, vehicle } = robot;
  fill($("phase"), phaseText(navigation));
  const reasons = new Set([navigation?.reason, vehicle?.reason].filter(Boolean));
  fill($("reason"), [...reasons].join(" · "));
  $("reason").classList.toggle("calm", navigation?.phase === "finished");
  fill($("strip"), ...(navigation ? strip(navigation) : []));
  const facts = [];
  if (navigation) {
    const { mission, count, next_turn: next } = navigation;
    facts.push(fact("junctions", count + (mission.finish_after ? ` of ${mission.finish_after}` : "")));
    facts.push(fact("next turn", next ? `${wayWord(next)} at ${next.at}` : "none"));
  }
  fill($("facts"), ...facts);
  fill($("vitals"), ...vitals(vehicle));
}

function cell(text, bad = false) {
  return make("td", bad ? "bad" : "", text ?? "–");
}

export function showProcesses(processes) {
  const rows = processes.map((p) => {
    const silent = p.silent ? ` silent ${Math.round(p.silent_s)} s` : "";
    const row = make("tr", p.silent ? "silent" : "", cell(p.service + silent),
      cell(p.rate_hz || p.age_ms !== null ? p.rate_hz.toFixed(1) : null),
      cell(p.age_ms?.toFixed(0)), cell(p.p50_ms?.toFixed(1)), cell(p.p99_ms?.toFixed(1)), cell(p.errors, p.errors > 0));
    if (p.last_error) row.title = p.last_error;
    return row;
  });
  fill($("rows"), ...rows);
}

function clock(event) {
  if (event.ago_s === null) return "";
  return new Date(event.came - 1000 * event.ago_s).toTimeString().slice(0, 8);
}

export function showEvents(events) {
  const rows = events.slice(-EVENT_ROWS).toReversed().map((event) => {
    const [text, mood] = eventText(event);
    return make("li", mood, make("time", "", clock(event)), make("b", "", text));
  });
  fill($("events"), ...rows);
}

/** The summary of a finished mission, as rows of name and value. */
export function summaryRows(robot) {
  const { navigation, tally, processes } = robot;
  const minutes = (s) => `${Math.floor(s / 60)} min ${Math.round(s % 60)} s`;
  const errors = processes.reduce((sum, p) => sum + p.errors, 0);
  const rows = [
    ["mission", navigation.mission.name],
    ["junctions counted", navigation.count],
    ["turns made", `${tally.turns} of ${navigation.mission.turns.filter((t) => t.turn !== "straight").length}`],
    ["time", tally.seconds === null ? "not known: this page's dashboard came later" : minutes(tally.seconds)],
    ["way", tally.moved_m ? `${tally.moved_m} m` : "no position told"],
    ["holds on the way", tally.holds],
    ["oldest picture flown by", `${tally.oldest_picture_ms} ms`],
    ["errors of processes", errors],
  ];
  return rows.flatMap(([name, value]) => [make("dt", "", name), make("dd", "", value)]);
}
