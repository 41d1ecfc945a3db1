// The path flown, with the junctions where they were counted, north (or the frame's y) up.
import { colour, FONT, paper } from "./canvas.js";

const SMALLEST_M = 30;
const SCALES_M = [5, 10, 20, 50, 100, 200, 500, 1000, 2000];

/** Draws the map of a robot; returns whether there is a position to draw. */
export function drawMap(canvas, history, vehicle) {
  const here = vehicle?.place;
  const { pen, width, height } = paper(canvas);
  if (!here && !history.path.length) return false;
  const points = here ? [...history.path, here] : history.path;
  const view = fit(points, width, height);
  drawScale(pen, view, width, height);
  drawPath(pen, points, view);
  drawJunctions(pen, history.events, view);
  if (here) drawRobot(pen, view(here), vehicle.yaw_rad);
  return true;
}

function fit(points, width, height) {
  const xs = points.map((p) => p[0]);
  const ys = points.map((p) => p[1]);
  const [x0, x1, y0, y1] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
  const margin = 34;
  const scale = Math.min(
    (width - 2 * margin) / Math.max(x1 - x0, SMALLEST_M),
    (height - 2 * margin) / Math.max(y1 - y0, SMALLEST_M),
  );
  const view = ([x, y]) => [width / 2 + (x - (x0 + x1) / 2) * scale, height / 2 - (y - (y0 + y1) / 2) * scale];
  return Object.assign(view, { scale });
}

function drawScale(pen, view, width, height) {
  const metres = SCALES_M.findLast((m) => m * view.scale < width / 3) ?? SCALES_M[0];
  const [left, bottom, length] = [14, height - 12, metres * view.scale];
  pen.strokeStyle = pen.fillStyle = colour("soft");
  pen.lineWidth = 3;
  pen.beginPath();
  pen.moveTo(left, bottom - 6);
  pen.lineTo(left, bottom);
  pen.lineTo(left + length, bottom);
  pen.lineTo(left + length, bottom - 6);
  pen.stroke();
  pen.font = `700 13px ${FONT}`;
  pen.fillText(`${metres} m`, left + 6, bottom - 6);
}

function drawPath(pen, points, view) {
  pen.beginPath();
  points.forEach((p, i) => (i ? pen.lineTo(...view(p)) : pen.moveTo(...view(p))));
  pen.strokeStyle = colour("road");
  pen.lineWidth = 5;
  pen.stroke();
}

function drawJunctions(pen, events, view) {
  const places = new Map();
  for (const event of events) {
    if (!event.place || !["approached", "entered", "turn_started"].includes(event.kind)) continue;
    places.set(event.count, event.place);
  }
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  pen.font = `800 14px ${FONT}`;
  for (const [count, place] of places) {
    const [x, y] = view(place);
    pen.beginPath();
    pen.arc(x, y, 13, 0, 7);
    pen.fillStyle = "#ffb020";
    pen.fill();
    pen.strokeStyle = "#000";
    pen.lineWidth = 2;
    pen.stroke();
    pen.fillStyle = "#000";
    pen.fillText(count, x, y + 1);
  }
  pen.textAlign = "left";
  pen.textBaseline = "alphabetic";
}

function drawRobot(pen, [x, y], yaw) {
  pen.save();
  pen.translate(x, y);
  pen.rotate(-(yaw ?? 0));
  pen.beginPath();
  pen.moveTo(17, 0);
  pen.lineTo(-11, 11);
  pen.lineTo(-6, 0);
  pen.lineTo(-11, -11);
  pen.closePath();
  pen.fillStyle = colour("ink");
  pen.strokeStyle = colour("ground");
  pen.lineWidth = 3;
  pen.stroke();
  pen.fill();
  pen.restore();
}
