// The live picture: road and verdict of that very frame are drawn on it.
import { FONT, paper } from "./canvas.js";

const LIKELY = 0.5;

function path(pen, points, width, height) {
  points.forEach(([u, v], i) => (i ? pen.lineTo(u * width, v * height) : pen.moveTo(u * width, v * height)));
}

function drawRoad(pen, lines, width, height) {
  const { left, centre, right } = lines;
  if (left.length > 1 && right.length > 1) {
    pen.beginPath();
    path(pen, [...left, ...right.toReversed()], width, height);
    pen.closePath();
    pen.fillStyle = "#00c8ff3d";
    pen.fill();
  }
  for (const [points, dash] of [[left, []], [right, []], [centre, [10, 10]]]) {
    for (const [style, line] of [["#000000b0", 6], ["#5fe3ff", 3]]) {
      pen.beginPath();
      path(pen, points, width, height);
      pen.setLineDash(dash);
      pen.strokeStyle = style;
      pen.lineWidth = line;
      pen.stroke();
    }
  }
  pen.setLineDash([]);
}

/** Draws a picture into a canvas, with its road. */
export function drawPicture(canvas, still) {
  const { pen, width, height } = paper(canvas);
  pen.drawImage(still.bitmap, 0, 0, width, height);
  if (still.road?.lines) drawRoad(pen, still.road.lines, width, height);
}

/** Draws a verdict in words into a small picture, for tiles. */
export function stampVerdict(canvas, still) {
  const pen = canvas.getContext("2d");
  const { text, junction } = verdict(still);
  pen.font = `800 15px ${FONT}`;
  const width = pen.measureText(text).width + 20;
  pen.fillStyle = junction ? "#ffb020" : "#000000d0";
  pen.fillRect(8, 8, width, 30);
  pen.fillStyle = junction ? "#000" : "#fff";
  pen.fillText(text, 18, 28);
}

/** What the network says of a picture, in words. */
export function verdict(still) {
  if (!still?.score) return { text: "no verdict", junction: false };
  const junction = still.score.junction >= LIKELY;
  const percent = Math.round(100 * still.score.junction);
  const name = junction ? still.score.label.toUpperCase() : "plain road";
  return { text: `${name} ${junction ? percent : 100 - percent} %`, junction };
}

/** Age of a picture now, in seconds; null: it cannot be known. */
export function ageOf(still) {
  return still.age_s === null ? null : still.age_s + (performance.now() - still.came) / 1000;
}

export function ageText(age) {
  if (age === null) return "age unknown";
  return age < 1 ? `${Math.round(1000 * age)} ms old` : `${age.toFixed(1)} s old`;
}

/** What the follower says of the road, in words. */
export function roadText(road) {
  if (!road) return "";
  if (!road.seen) return "no road seen: holding";
  const side = road.offset_m > 0 ? "left" : "right";
  const where = road.offset_m === undefined ? "" : `, centre ${Math.abs(road.offset_m).toFixed(1)} m ${side}`;
  return `road ${Math.round(100 * road.confidence)} % sure${where}`;
}

/** Draws one channel of the features, uint8 (H, W), into a canvas of their size. */
export function drawPlane(canvas, still, channel) {
  const [count, height, width] = still.features ?? [0, 0, 0];
  canvas.closest("figure").hidden = channel >= count;
  if (channel >= count) return;
  Object.assign(canvas, { width, height });
  const image = new ImageData(width, height);
  const from = channel * width * height;
  for (let i = 0; i < width * height; i++) {
    image.data.fill(still.planes[from + i], 4 * i, 4 * i + 3);
    image.data[4 * i + 3] = 255;
  }
  canvas.getContext("2d").putImageData(image, 0, 0);
}
