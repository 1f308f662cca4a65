// Common code of all parts: requests to the server, elements from text, error messages.

// The name of this window: it survives a reload, and differs from that of other tabs.
export const viewer = (() => {
  try {
    let name = sessionStorage.getItem("rigctl-viewer");
    if (!name) sessionStorage.setItem("rigctl-viewer", (name = crypto.randomUUID()));
    return name;
  } catch {
    return crypto.randomUUID();
  }
})();

export class Refusal extends Error {
  constructor(status, error) {
    super(error.message);
    this.status = status;
    this.error = error;
  }
}

// Send a request: returns the JSON of the answer, or throws a Refusal with the parts of the error.
export const api = async (path, { method = "GET", body = null, query = null } = {}) => {
  const given = Object.entries(query ?? {}).filter(([, value]) => value !== null && value !== undefined && value !== "");
  const address = given.length ? `${path}?${new URLSearchParams(given)}` : path;
  const headers = { "X-Rigctl-Viewer": viewer };
  if (body !== null) headers["Content-Type"] = "application/json";
  const answer = await fetch(address, { method, headers, body: body === null ? null : JSON.stringify(body), credentials: "same-origin" });
  if (answer.status === 204) return null;
  const text = await answer.text();
  let content = null;
  try {
    content = JSON.parse(text);
  } catch {
    throw new Refusal(answer.status, { message: "the server's answer cannot be read" });
  }
  if (!answer.ok) throw new Refusal(answer.status, content.error ?? { message: `the server answers ${answer.status}` });
  return content;
};

// An element. Texts are always shown as text: nothing here parses HTML.
export const h = (tag, attributes = {}, ...inside) => {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name === "value" || name === "checked" || name === "disabled") element[name] = value;
    else element.setAttribute(name, value === true ? "" : String(value));
  }
  element.append(...inside.flat(3).filter((one) => one !== null && one !== undefined && one !== false));
  return element;
};

// A scrollable region for wide content, also operable by keyboard.
export const scrolling = (label, ...inside) => h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": label }, ...inside);

export const wait = (milliseconds) => new Promise((done) => setTimeout(done, milliseconds));

// At most one call per interval in ms; the last call is never lost.
export const seldom = (work, milliseconds) => {
  let timer = null;
  let next = 0;
  return (...given) => {
    clearTimeout(timer);
    const now = performance.now();
    const run = () => {
      next = performance.now() + milliseconds;
      work(...given);
    };
    if (now >= next) run();
    else timer = setTimeout(run, next - now);
  };
};

const messages = document.getElementById("messages");

// A message that stays until it is closed.
export const say = (text, kind = "") => {
  const box = h("div", { class: `message ${kind}` }, h("p", {}, text));
  box.append(h("button", { type: "button", "aria-label": "Close this message", onclick: () => box.remove() }, "×"));
  messages.append(box);
  while (messages.children.length > 4) messages.firstElementChild.remove();
  return box;
};

// A state that is announced once, and removed when it ends.
const states = new Map();
export const settle = (name, text) => {
  const line = states.get(name);
  if (line && line.isConnected && text && line.dataset.text === text) return;
  line?.remove();
  states.delete(name);
  if (text) {
    const box = say(text, "warn");
    box.dataset.text = text;
    states.set(name, box);
  }
};

export const complain = (problem) => {
  if (!(problem instanceof Refusal)) console.error(problem);
  return say(problem.message ?? String(problem), "bad");
};

// Run an action on a click; errors are shown, and the button is disabled meanwhile.
export const button = (label, work, attributes = {}) => {
  const element = h("button", { type: "button", ...attributes }, label);
  element.addEventListener("click", async () => {
    element.disabled = true;
    try {
      await work(element);
    } catch (problem) {
      complain(problem);
    } finally {
      element.disabled = false;
    }
  });
  return element;
};

// The command equivalent to a view, for copying.
export const command = (text) => {
  const code = h("code", { tabindex: 0 }, text); // may need to scroll
  const copy = button("Copy", async () => {
    await navigator.clipboard.writeText(text);
    copy.textContent = "Copied";
    setTimeout(() => (copy.textContent = "Copy"), 1500);
  }, { class: "small", "aria-label": "Copy the command" });
  return h("p", { class: "command" }, code, copy);
};

// The command equivalent to what was just done; the next one takes its place.
let done = null;
export const sameAs = (text) => {
  done?.remove();
  const box = (done = say("At a terminal:"));
  box.firstElementChild.after(command(text));
  setTimeout(() => box.remove(), 15000);
};

// A word for a shell, quoted if necessary.
export const word = (text) => (/^[\w@%+=:,./-]+$/.test(text) ? text : `'${text.replaceAll("'", "'\\''")}'`);

const kinds = { finished: "good", pass: "good", done: "good", running: "live", failed: "bad", fail: "bad", damaged: "bad", died: "bad", "outputs not confirmed safe": "bad", aborted: "warn", paused: "warn", unclosed: "warn", stopped: "warn" };
export const tag = (text) => h("span", { class: `tag ${kinds[text] ?? ""}` }, text);

// 1:02:03, or 2:03
export const clock = (seconds) => {
  if (seconds === null || seconds === undefined || !Number.isFinite(seconds)) return "–";
  const total = Math.max(Math.round(seconds), 0);
  const [hours, minutes, rest] = [Math.floor(total / 3600), Math.floor((total % 3600) / 60), total % 60];
  const two = (number) => String(number).padStart(2, "0");
  return hours ? `${hours}:${two(minutes)}:${two(rest)}` : `${minutes}:${two(rest)}`;
};

// A job in a separate process, polled until it ends. `look` is called with each state.
export const follow = async (job, look = () => {}) => {
  let state = job;
  for (;;) {
    look(state);
    if (state.state !== "working") return state;
    await wait(300);
    state = await api(`/api/jobs/${job.id}`);
  }
};

// Progress of a job with a stop button; resolves with its result, or throws its error.
export const work = async (container, job) => {
  const bar = h("progress", { max: 1, "aria-label": job.name });
  const text = h("span", { role: "status" });
  const stop = button("Stop", () => api(`/api/jobs/${job.id}`, { method: "DELETE" }), { class: "small" });
  const box = h("div", { class: "job" }, h("strong", {}, job.name), bar, text, stop);
  container.append(box);
  try {
    const ended = await follow(job, (state) => {
      if (state.share === null) bar.removeAttribute("value");
      else bar.value = state.share;
      text.textContent = `${state.text} ${clock(state.seconds)}`;
    });
    if (ended.state === "done") return ended.result;
    if (ended.state === "stopped") throw new Refusal(409, { message: `${job.name}: stopped` });
    throw new Refusal(409, ended.error);
  } finally {
    box.remove();
  }
};

// The current colours of the style sheet.
export const colour = (name) => getComputedStyle(document.body).getPropertyValue(name).trim();
export const onTheme = (work) => window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", work);
