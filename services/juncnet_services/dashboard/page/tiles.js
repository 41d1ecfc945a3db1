// All robots at once: a tile each.
import { make } from "./panels.js";
import { outputText, phaseText } from "./words.js";

const tiles = new Map();

/** Shows a tile for each robot; `choose` and `stop` are called with a robot's name. */
export function showTiles(place, robots, mayCommand, choose, stop) {
  for (const [name, tile] of tiles) {
    if (!(name in robots)) {
      tile.element.remove();
      tiles.delete(name);
    }
  }
  for (const [name, robot] of Object.entries(robots)) {
    if (!tiles.has(name)) tiles.set(name, newTile(place, name, choose, stop));
    const tile = tiles.get(name);
    const [word, mood] = outputText(robot.vehicle);
    tile.pill.className = `pill ${mood}`;
    tile.pill.textContent = word;
    const { navigation } = robot;
    const total = navigation?.mission.finish_after;
    const count = navigation ? ` · ${navigation.count}${total ? ` of ${total}` : ""} junctions` : "";
    tile.phase.textContent = phaseText(navigation) + count;
    tile.stop.hidden = !mayCommand;
  }
}

function newTile(place, name, choose, stop) {
  const canvas = make("canvas", "");
  const pill = make("span", "pill");
  const phase = make("p", "");
  const open = make("button", "", "Open");
  const halt = make("button", "halt", `STOP ${name}`);
  const title = make("h2", "", name, pill, open);
  open.addEventListener("click", () => choose(name));
  canvas.addEventListener("click", () => choose(name));
  halt.addEventListener("click", () => stop(name));
  const element = make("article", "tile", canvas, make("div", "body", title, phase, halt));
  place.append(element);
  return { element, canvas, pill, phase, stop: halt };
}

export function tileCanvas(name) {
  return tiles.get(name)?.canvas;
}
