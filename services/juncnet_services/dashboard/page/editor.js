// Dialogs: the mission before take-off, and the swap of model and follower.
import { command, open } from "./controls.js";
import { models } from "./link.js";
import { arrow, fill, make } from "./panels.js";
import { wayWord } from "./words.js";

const $ = (id) => document.getElementById(id);
const NEXT_WAY = { straight: "left", left: "right", right: "straight" };
const LONGEST = 60;
let plan = { name: "edited", turns: new Map(), length: 4, endless: false };

for (const button of document.querySelectorAll("[data-close]")) {
  button.addEventListener("click", () => button.closest("dialog").close());
}

/** Opens the mission editor with the mission that the robot has. */
export function editMission(robot) {
  const mission = robot.navigation?.mission ?? { name: "edited", turns: [] };
  const last = Math.max(0, ...mission.turns.map((turn) => turn.at));
  plan = {
    name: mission.name,
    turns: new Map(mission.turns.map((turn) => [turn.at, turn])),
    length: mission.finish_after ?? Math.max(last, 4),
    endless: mission.finish_after === undefined,
  };
  $("endless").checked = plan.endless;
  drawPlan();
  open($("editor"));
}

/** Says in the editor, while it is open, whether a mission can be sent now. */
export function showMayEdit(robot) {
  const phase = robot.navigation?.phase;
  const moving = ["pipeline", "manual", "landing"].includes(robot.vehicle?.output);
  const free = ["waiting", "finished"].includes(phase) || !moving;
  $("send").disabled = !free;
  fill($("mayfly"), free ? "The count starts at 0 with a new mission." : "The robot moves: stop it first.");
}

function drawPlan() {
  const cells = [];
  for (let n = 1; n <= plan.length; n++) {
    const turn = plan.turns.get(n);
    const button = make("button", turn && turn.turn !== "straight" ? "turning" : "",
      arrow(turn), make("span", "number", n));
    button.setAttribute("aria-label", `junction ${n}: ${wayWord(turn)}`);
    button.addEventListener("click", () => {
      plan.turns.set(n, { at: n, turn: NEXT_WAY[turn?.turn ?? (turn ? "right" : "straight")] });
      drawPlan();
      $("plan").children[n - 1].firstChild.focus();
    });
    cells.push(make("li", "", button));
  }
  $("plan").replaceChildren(...cells);
  $("length").textContent = plan.endless ? "no end" : `ends after ${plan.length}`;
}

/** The mission as it stands in the editor. */
function edited() {
  const turns = [...plan.turns.values()].filter((t) => t.at <= plan.length && t.turn !== "straight");
  const mission = { name: plan.name, turns: turns.sort((a, b) => a.at - b.at) };
  return plan.endless ? mission : { ...mission, finish_after: plan.length };
}

/** Connects the dialogs; `chosen` returns the robot's name. */
export function connectDialogs(chosen) {
  $("more").addEventListener("click", () => resize(1));
  $("fewer").addEventListener("click", () => resize(-1));
  $("endless").addEventListener("change", () => {
    plan.endless = $("endless").checked;
    drawPlan();
  });
  $("send").addEventListener("click", async () => {
    const done = await command([chosen()], { do: "mission", mission: edited() }, "Mission");
    if (done) $("editor").close();
  });
  $("loadmodel").addEventListener("click", () =>
    command([chosen()], { do: "model", model: $("model").value.trim() }, "Model"));
  $("loadfollower").addEventListener("click", () =>
    command([chosen()], { do: "follower", follower: $("follower").value.trim() }, "Follower"));
}

function resize(by) {
  plan.length = Math.min(LONGEST, Math.max(1, plan.length + by));
  drawPlan();
}

/** Opens the swap of model and follower with what there is. */
export async function openSwap(robot, followers) {
  $("model").value = robot.model ?? "";
  $("follower").value = robot.follower ?? followers[0] ?? "";
  showServed(robot);
  fill($("followers"), ...followers.map((name) => new Option(name)));
  open($("swapper"));
  fill($("models"), ...(await models().catch(() => [])).map((name) => new Option(name)));
}

/** Shows what is served now. */
export function showServed(robot) {
  fill($("modelnow"), robot.model ? `now ${robot.model}` : "");
  fill($("followernow"), robot.follower ? `now ${robot.follower.split(":").at(-1)}` : "");
}
