// Probability over time, with the thresholds that decide and the events that followed.
import { colour, FONT, paper } from "./canvas.js";

const SECONDS = 30;
const LABEL_PX = 16;
const MARKS = { approached: "▲", turn_started: "↻", left: "✓", mission_finished: "■" };

/** Draws the last seconds of a robot: `history` has scores, smoothed and events. */
export function drawChart(canvas, history, thresholds) {
  const { pen, width, height } = paper(canvas);
  const box = { left: 40, right: width - 108, top: 20, bottom: height - 20 };
  const newest = history.scores.at(-1)?.[0] ?? history.smoothed.at(-1)?.[0];
  const x = (t) => box.right - ((newest - t) / SECONDS) * (box.right - box.left);
  const y = (p) => box.bottom - p * (box.bottom - box.top);
  drawFrame(pen, box, y);
  if (newest === undefined) return;
  drawThresholds(pen, box, y, thresholds, width);
  drawEvents(pen, box, x, history.events, newest);
  drawLine(pen, history.scores, x, y, newest, colour("line"), 1.5);
  drawLine(pen, history.smoothed, x, y, newest, colour("ink"), 3.5);
}

function drawFrame(pen, box, y) {
  pen.font = `600 13px ${FONT}`;
  pen.fillStyle = colour("soft");
  pen.strokeStyle = colour("line");
  pen.lineWidth = 1;
  pen.textAlign = "right";
  pen.textBaseline = "middle";
  for (const p of [0, 0.5, 1]) {
    pen.beginPath();
    pen.moveTo(box.left, y(p));
    pen.lineTo(box.right, y(p));
    pen.stroke();
    pen.fillText(p.toString(), box.left - 8, y(p));
  }
  pen.textBaseline = "alphabetic";
  pen.textAlign = "left";
  pen.fillText(`${SECONDS} s ago`, box.left, box.bottom + 16);
  pen.textAlign = "right";
  pen.fillText("now", box.right, box.bottom + 16);
}

function drawThresholds(pen, box, y, thresholds, width) {
  if (!thresholds) return;
  const names = { certain: "counts", enter: "rises", leave: "falls" };
  pen.textAlign = "left";
  pen.textBaseline = "middle";
  pen.font = `700 14px ${FONT}`;
  pen.setLineDash([7, 6]);
  let free = 0;
  for (const [name, word] of Object.entries(names)) {
    const style = colour(name === "certain" ? "junction" : name === "enter" ? "road" : "good");
    pen.strokeStyle = pen.fillStyle = style;
    pen.lineWidth = 2.5;
    pen.beginPath();
    pen.moveTo(box.left, y(thresholds[name]));
    pen.lineTo(box.right + 4, y(thresholds[name]));
    pen.stroke();
    const line = y(thresholds[name]);
    free = Math.max(line, free);
    pen.fillText(`${word} ${thresholds[name]}`, box.right + 10, free, width - box.right - 10);
    free += LABEL_PX;
  }
  pen.setLineDash([]);
}

function drawEvents(pen, box, x, events, newest) {
  pen.textAlign = "center";
  pen.textBaseline = "alphabetic";
  pen.font = `800 14px ${FONT}`;
  pen.fillStyle = pen.strokeStyle = colour("junction");
  pen.lineWidth = 1.5;
  for (const event of events) {
    if (!MARKS[event.kind] || event.t === null || newest - event.t > SECONDS || event.t > newest) continue;
    pen.beginPath();
    pen.moveTo(x(event.t), box.top);
    pen.lineTo(x(event.t), box.bottom);
    pen.stroke();
    pen.fillText(`${MARKS[event.kind]}${event.count}`, x(event.t), box.top - 5);
  }
}

function drawLine(pen, rows, x, y, newest, style, thickness) {
  pen.beginPath();
  let previous = null;
  for (const [t, p] of rows) {
    if (newest - t > SECONDS) continue;
    const joined = previous !== null && t - previous < 1;
    if (joined) pen.lineTo(x(t), y(p));
    else pen.moveTo(x(t), y(p));
    previous = t;
  }
  pen.strokeStyle = style;
  pen.lineWidth = thickness;
  pen.stroke();
}
