// Everything that this page asks of its dashboard. The key stands behind the # of the address.
const key = location.hash.slice(1);
const ANSWER_MS = 3000;

async function ask(path, more = {}) {
  const answer = await fetch(path, {
    cache: "no-store",
    signal: AbortSignal.timeout(ANSWER_MS),
    ...more,
    headers: { Authorization: `Bearer ${key}`, ...more.headers },
  });
  if (!answer.ok) {
    const text = await answer.json().catch(() => ({}));
    throw new Error(text.reason ?? `the dashboard answered ${answer.status}`);
  }
  return answer;
}

/** The state of all robots, with the rows that came after a serial number. */
export async function state(after) {
  return (await ask(`/state?after=${after}`)).json();
}

/** The newest picture of a robot and what was found in it; null: the one before is the newest. */
export async function still(robot, before) {
  const seen = before ? `&epoch=${before.epoch}&sequence=${before.sequence}` : "";
  const answer = await ask(`/still?robot=${encodeURIComponent(robot)}${seen}`);
  if (answer.status === 204) return null;
  const bytes = await answer.arrayBuffer();
  const length = new DataView(bytes).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 4, length)));
  const jpeg = new Uint8Array(bytes, 4 + length, head.jpeg_bytes);
  const bitmap = await createImageBitmap(new Blob([jpeg], { type: "image/jpeg" }));
  const planes = new Uint8Array(bytes, 4 + length + head.jpeg_bytes);
  return { ...head, bitmap, planes, came: performance.now() };
}

/** Asks for something to be done; resolves to { accepted, reason }, also when nobody answers. */
export async function order(body) {
  try {
    const answer = await ask("/ask", {
      method: "POST",
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify(body),
      signal: AbortSignal.timeout(12000),
    });
    return await answer.json();
  } catch (error) {
    return { accepted: false, reason: `${error.message}` };
  }
}

export async function models() {
  return (await (await ask("/models")).json()).models;
}
