// Commands: stop at once, resume and land at the second press, and what the answers were.
import { order } from "./link.js";

const $ = (id) => document.getElementById(id);
const ARMED_MS = 4000;
const ANSWER_MS = 6000;
let answerTimer = 0;

/** Shows what came of an order. */
export function say(text, bad = false) {
  $("answer").textContent = text;
  $("answer").className = bad ? "bad" : "";
  clearTimeout(answerTimer);
  answerTimer = setTimeout(() => ($("answer").textContent = ""), ANSWER_MS);
}

/** Sends an order to each of `robots` and shows the answers. */
export async function command(robots, body, word) {
  const answers = await Promise.all(robots.map((robot) => order({ robot, ...body })));
  const bad = answers.find((answer) => !answer.accepted);
  const who = robots.length > 1 ? ` ${robots.length} robots` : "";
  const reason = (bad ?? answers[0])?.reason;
  say(`${word}${who}: ${bad ? "NOT DONE" : "done"}${reason ? `: ${reason}` : ""}`, Boolean(bad));
  return !bad;
}

/** Stops `robots`, without a question; the button shows that it was heard. */
export async function stop(robots) {
  if (!robots.length) return say("STOP: no robot is known yet", true);
  $("stop").classList.add("sent");
  $("stopword").textContent = "STOP SENT";
  await command(robots, { do: "hold" }, "Stop");
  $("stop").classList.remove("sent");
  $("stopword").textContent = stopWord(robots.length);
}

export function stopWord(count) {
  return count > 1 ? `STOP ALL ${count}` : "STOP";
}

/** Makes a button act at its second press within some seconds. */
export function armed(button, question, act) {
  const word = button.querySelector("b");
  const rest = word.textContent;
  let timer = 0;
  const disarm = () => {
    clearTimeout(timer);
    timer = 0;
    button.classList.remove("armed");
    word.textContent = rest;
  };
  button.addEventListener("click", () => {
    if (timer) {
      disarm();
      act();
      return;
    }
    button.classList.add("armed");
    word.textContent = question;
    timer = setTimeout(disarm, ARMED_MS);
  });
}

/** Opens a dialog, alone, and not as a modal one: stop works while it is open. */
export function open(dialog) {
  document.querySelector("dialog[open]")?.close();
  dialog.show();
}

/** Calls actions by key. Space stops wherever the cursor is, before anything else sees the key. */
export function listenForKeys(actions) {
  window.addEventListener(
    "keydown",
    (event) => {
      if (event.code === "Space" && !event.ctrlKey && !event.altKey && !event.metaKey) {
        event.preventDefault();
        event.stopImmediatePropagation();
        if (!event.repeat) actions.stop();
        return;
      }
      if (event.ctrlKey || event.altKey || event.metaKey || event.repeat) return;
      const dialog = document.querySelector("dialog[open]");
      if (dialog) {
        if (event.key === "Escape") dialog.close();
        return;
      }
      if (/^[0-9]$/.test(event.key)) actions.choose(Number(event.key));
      else actions[event.key.toLowerCase()]?.();
    },
    { capture: true },
  );
  // A focused button would act when the key is let go.
  window.addEventListener("keyup", (event) => event.code === "Space" && event.preventDefault(), {
    capture: true,
  });
}
