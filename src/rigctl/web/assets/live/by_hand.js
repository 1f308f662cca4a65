// The bench while no run is in progress: watched, and single outputs moved, by the commands `monitor` and `jog`.
import { api, button, command, complain, h, settle, tag, viewer, wait } from "../lib.js";

const LOOK = 300; // ms between two requests; the server leaves the bench when none comes for some seconds

// hear: takes the messages of a run, so that the bench is drawn like one. idle: whether no run is shown.
export const byHand = (hear, idle) => {
  const ask = (what, body = {}) => api(`/api/live/bench/${what}`, { method: "POST", body });
  const stand = h("p", { class: "note", role: "status" });
  const unsafe = h("p", { class: "statement bad", role: "alert", hidden: true });
  const alarms = h("ul", { class: "alarms", role: "alert" });
  const shownCommand = h("div");
  const messages = h("ul", { class: "events", tabindex: "0", "aria-label": "What the bench says, newest first" });
  const showCommand = (text) => shownCommand.replaceChildren(command(text));
  const watch = button("Watch the bench", async () => {
    showCommand((await ask("watch")).command);
    wanted = true;
    await look();
  }, { class: "primary", title: "rigctl monitor" });
  const leave = button("Leave it", () => ask("close").then(look));
  const name = h("input", { type: "text", id: "bench-name", autocomplete: "off" });
  const nameLabel = h("label", { for: "bench-name" });
  const open = button("Open the controls", async () => {
    await ask("open", { rig: name.value });
    name.value = "";
    await look();
  });
  const opening = h("span", { class: "labelled opening" }, nameLabel, name, open);
  const seconds = h("input", { type: "number", id: "bench-seconds", value: "0.5", min: "0.05", step: "0.05", size: "5" });
  const stop = button("Stop", () => ask("stop"), { class: "danger" });
  const knobs = h("div", { class: "knobs" });
  const controls = h("div", { class: "hand-controls", hidden: true },
    h("span", { class: "labelled" }, h("label", { for: "bench-seconds" }, "For, s"), seconds, stop), knobs,
    h("p", { class: "note" }, "One press moves one output for that time, from its arrival where it has a max_rate, at most 10 s in all, within its range and under the interlocks; then every output is safe again."));
  const element = h("section", { class: "panel by-hand", "aria-label": "The bench by hand" },
    h("div", { class: "toolbar" }, h("h2", {}, "By hand"), watch, leave, opening), stand, alarms, controls, shownCommand, messages);

  let drawn = ""; // the bench that is drawn
  let anew = false; // it is drawn from the beginning: nobody has looked for a while
  let wanted = false; // this window has begun to watch; a run that is over gives way to the first readings
  let built = "";
  let after = "";
  let outputs = {};
  let state = null;

  const move = (actuator, value) => async () => showCommand((await ask("move", { actuator, value: value(), seconds: Number(seconds.value) })).command);
  const knob = (one) => {
    const title = one.name.replaceAll("_", " ");
    if (one.positions.length) return h("div", { class: "knob" }, h("strong", {}, title), one.positions.map((word) => button(word, move(one.name, () => word), { "aria-label": `${title} ${word}` })));
    const [low, high] = one.ends;
    const level = h("input", { type: "number", value: String(low ?? 0), min: low, max: high, step: "any", "aria-label": `${title}, ${one.unit}` });
    return h("div", { class: "knob" }, h("strong", {}, title), level, one.unit, button("Move", move(one.name, () => `${level.value} ${one.unit}`), { "aria-label": `Move ${title}` }));
  };

  const show = () => {
    const { watched, moving, real } = state;
    watch.hidden = watched;
    leave.hidden = !watched;
    opening.hidden = !watched || state.open;
    name.hidden = nameLabel.hidden = !real;
    nameLabel.textContent = `Type ${state.rig} to`;
    controls.hidden = !state.open;
    stop.disabled = !moving;
    for (const one of knobs.querySelectorAll("button")) one.disabled = moving;
    stand.replaceChildren(tag(moving ? "moving" : watched ? "watched" : "idle"), ` ${state.rig}, ${real ? "the real bench" : `a ${state.about.backend.kind} bench, which begins anew each time`}. `,
      moving ? "An output moves; then all are safe again." : watched ? "Its outputs are in their safe state." : "Reading it brings its outputs to their safe state: this may move what is on now.");
    alarms.replaceChildren(...state.alarms.map((text) => h("li", {}, text)));
    messages.hidden = !state.messages.length;
    messages.replaceChildren(...state.messages.slice(-20).reverse().map((one) => h("li", { class: "event" }, h("span", { class: "when" }, `${one.time.toFixed(1)} s`), h("span", {}, one.text))));
    if (built !== JSON.stringify(state.knobs)) {
      built = JSON.stringify(state.knobs);
      seconds.max = String(state.longest);
      knobs.replaceChildren(...state.knobs.map(knob));
    }
  };

  const lookOnce = async () => {
    const seen = idle();
    if (anew) after = "";
    state = await api("/api/live/bench", { query: { after, glance: seen ? "" : "1" } });
    unsafe.hidden = !state.unsafe;
    unsafe.textContent = state.unsafe ? `OUTPUTS NOT CONFIRMED SAFE: ${state.unsafe} may still be on. Press 'Everything off', or switch it off by hand, at its supply.` : "";
    if (!seen || !idle()) { // a run is shown, or has begun meanwhile
      anew = true;
      return;
    }
    element.hidden = !state.rig;
    if (state.rig) show();
    outputs = state.outputs ?? {};
    if (!state.watched) {
      if (drawn) hear({ kind: "left" });
      drawn = after = "";
      anew = false;
      return;
    }
    if (wanted && state.rows.length) {
      wanted = false;
      if (hear({ kind: "bench" })) anew = true;
    }
    if (!drawn || anew) {
      drawn = state.rig;
      anew = false;
      hear({ kind: "run", run: state.about });
    }
    if (state.rows.length) after = String(state.rows[state.rows.length - 1][0]);
    hear({ kind: "rows", rows: state.rows });
  };

  let looking = null; // two requests at a time would bring the same samples twice
  const look = () => (looking ??= lookOnce().finally(() => (looking = null)));

  (async () => {
    for (;;) {
      element.hidden = !idle();
      try {
        if (document.hidden) anew = true;
        else await look();
        settle("bench", null);
      } catch (problem) {
        if (problem.status === 401) return complain(problem);
        settle("bench", problem.message);
      }
      await wait(state?.watched ? LOOK : 1500);
    }
  })();
  // the server would leave the bench by itself some seconds later
  addEventListener("pagehide", () => {
    if (idle() && state?.watched) fetch("/api/live/bench/close", { method: "POST", keepalive: true, headers: { "Content-Type": "application/json", "X-Rigctl-Viewer": viewer }, body: "{}", credentials: "same-origin" }).catch(() => {});
  });
  return {
    element,
    alert: unsafe, // shown also beside a run
    get watched() {
      return Boolean(idle() && state?.watched);
    },
    get outputs() {
      return outputs;
    },
  };
};
