// What is known of a robot, in words.
export const ARROWS = { left: "↰", right: "↱", straight: "↑" };

/** A turn as an arrow, or as an angle. */
export function way(turn) {
  if (!turn) return ARROWS.straight;
  if (turn.turn) return ARROWS[turn.turn];
  return `${turn.angle_deg > 0 ? "+" : ""}${turn.angle_deg}°`;
}

export function wayWord(turn) {
  if (!turn) return "straight on";
  return turn.turn ? (turn.turn === "straight" ? "straight on" : turn.turn) : `${turn.angle_deg}°`;
}

const PHASES = {
  waiting: "Waiting",
  following: "Following the road",
  approaching: "Approaching junction",
  crossing: "Crossing junction",
  turning: "Turning at junction",
  aligning: "Finding the new road behind junction",
  finished: "Mission finished",
};

export function phaseText(navigation) {
  if (!navigation) return "No word from the navigator yet";
  const at = ["approaching", "crossing", "turning", "aligning"].includes(navigation.phase);
  return PHASES[navigation.phase] + (at ? ` ${Math.max(1, navigation.count)}` : "");
}

const OUTPUTS = {
  pipeline: ["FLYING", "good"],
  manual: ["MANUAL", "good"],
  hold: ["HOLDING", "calm"],
  stopped: ["STOPPED", "bad"],
  landing: ["LANDING", "bad"],
  emergency: ["MOTORS CUT", "bad"],
};

/** What the vehicle is told: [word, mood]. */
export function outputText(vehicle) {
  if (!vehicle) return ["NO VEHICLE", "calm"];
  if (vehicle.silent_s > 2) return [`VEHICLE SILENT ${Math.round(vehicle.silent_s)} s`, "bad"];
  const [word, mood] = OUTPUTS[vehicle.output];
  return [vehicle.kind === "rover" && word === "FLYING" ? "DRIVING" : word, mood];
}

const EVENTS = {
  approached: (e) => [`Junction ${e.count} ahead, ${Math.round(100 * e.probability)}\u00a0%`, "junction"],
  entered: (e) => [`Entered junction ${e.count}`, "junction"],
  turn_started: (e) => [`Turning ${wayWord(e.turn)} at junction ${e.count}`, "turn"],
  turn_finished: (e) => [`Turned ${wayWord(e.turn)} at junction ${e.count}`, "turn"],
  left: (e) => [`Left junction ${e.count}`, "good"],
  mission_finished: (e) => [`Mission finished after ${e.count} junctions`, "good"],
  restarted: (e) => [`${e.text} was restarted`, "bad"],
  error: (e) => [e.text, "bad"],
  order: (e) => [e.text, e.text.includes("refused") ? "bad" : "good"],
  swapped: (e) => [e.text, "turn"],
};

/** An event: [text, mood]. */
export function eventText(event) {
  return EVENTS[event.kind]?.(event) ?? [event.text, ""];
}
