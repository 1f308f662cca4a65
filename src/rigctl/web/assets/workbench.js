// The workbench: a model on its runs, with its parameters as sliders and its effects as switches.
import { api, button, command, complain, h, Refusal, say, work } from "./lib.js";
import { makeBode } from "./workbench/bode.js";
import { makeCurves } from "./workbench/curves.js";
import { readFrame } from "./workbench/frames.js";
import { history } from "./workbench/history.js";
import { keeper } from "./workbench/kept.js";
import { makeMap } from "./workbench/map.js";
import { figure } from "./workbench/numbers.js";
import * as results from "./workbench/results.js";
import { makeSlider, makeSwitch } from "./workbench/sliders.js";

const records = (count) => `${count} record${count === 1 ? "" : "s"}`;
// ms between two moves that count as one step
const TOGETHER = 250;
// undo steps kept over a reload
const MOST_STEPS = 50;
const { remembered, remember } = keeper("rigctl-workbench");

// The socket to the process of this page: messages in order, answers by kind.
const connect = (hear) => {
  const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/api/workbench/session`);
  socket.binaryType = "arraybuffer";
  socket.addEventListener("message", ({ data }) => {
    try {
      if (typeof data === "string") hear(JSON.parse(data), null);
      else {
        const { header, arrays } = readFrame(data);
        hear(header, arrays);
      }
    } catch (problem) {
      complain(problem);
    }
  });
  const ready = new Promise((done, fail) => {
    socket.addEventListener("open", done, { once: true });
    socket.addEventListener("error", () => fail(new Error("The server does not take a socket: without one nothing follows. The commands do all that this page does.")), { once: true });
  });
  return { ready, socket, send: (message) => socket.readyState === WebSocket.OPEN && socket.send(JSON.stringify(message)) };
};

// Measured data of the project that have not been imported.
const importer = (choices, imported) => {
  const file = h("input", { type: "text", id: "import-file", list: "import-files", placeholder: "data/unknown-bench.csv", spellcheck: "false", autocomplete: "off" });
  const rig = h("select", { id: "import-rig" }, ...choices.rigs.map((path) => h("option", { value: path }, path)), h("option", { value: "" }, "no bench: a table"));
  const assume = h("input", { type: "text", id: "import-assume", placeholder: "heater=off", spellcheck: "false" });
  const jobs = h("div", { class: "jobs", "aria-live": "polite" });
  const bring = button("Import", async () => {
    const job = await api("/api/workbench/import", { method: "POST", body: { file: file.value.trim(), rig: rig.value, assume: assume.value.split(/\s+/).filter(Boolean) } });
    const result = await work(jobs, job);
    say(`${result.run}: ${records(result.records)}, ${result.rows} rows. ${job.command}`, "good");
    await imported(result.run);
  });
  return h("details", { class: "import" }, h("summary", {}, "Bring in measured data"),
    h("div", { class: "fields" },
      h("div", { class: "field" }, h("label", { for: "import-file" }, "File"), file, h("datalist", { id: "import-files" }, ...choices.files.map((path) => h("option", { value: path })))),
      h("div", { class: "field" }, h("label", { for: "import-rig" }, "Bench"), rig),
      h("div", { class: "field" }, h("label", { for: "import-assume" }, "Assume"), assume),
      bring, jobs));
};

const chooser = async (open, again) => {
  const choices = await api("/api/workbench/choices");
  const query = new URLSearchParams(location.search);
  const before = remembered() ?? {};
  const wanted = query.getAll("run").length ? query.getAll("run") : (before.runs ?? choices.runs.slice(0, 1).map((run) => run.id));
  const boxes = choices.runs.map((run) => {
    const box = h("input", { type: "checkbox", value: run.id, checked: wanted.includes(run.id) });
    return h("label", { class: "pickrun" }, box, h("span", {}, run.id), h("span", { class: "note" }, ` ${records(run.records)}, ${run.status}`));
  });
  const model = h("select", { id: "choose-model" }, ...choices.models.map(({ path }) => h("option", { value: path }, path)));
  const known = (path) => choices.models.some((one) => one.path === path);
  const rigs = new Set(choices.runs.filter((run) => wanted.includes(run.id)).map((run) => run.rig));
  const named = query.get("model") ?? before.model ?? choices.models.find((one) => rigs.has(one.rig) && /textbook/.test(one.path))?.path ?? choices.models.find((one) => rigs.has(one.rig))?.path;
  if (named && known(named)) model.value = named;
  const field = (id, label, placeholder, value) => {
    const input = h("input", { type: "text", id, placeholder, spellcheck: "false", value: value ?? "" });
    return [input, h("div", { class: "field" }, h("label", { for: id }, label), input)];
  };
  const [holdOut, holdOutField] = field("hold-out", "Hold out", "oil == 60 degC", before.hold_out);
  const [only, onlyField] = field("only", "Only", "oil > 30 degC", before.only);
  const [assume, assumeField] = field("assume", "Assume", "heater=off", (before.assume ?? []).join(" "));
  const choice = () => ({
    runs: boxes.map((one) => one.querySelector("input")).filter((one) => one.checked).map((one) => one.value),
    model: model.value, hold_out: holdOut.value.trim(), only: only.value.trim(), assume: assume.value.split(/\s+/).filter(Boolean),
  });
  const empty = !choices.runs.length || !choices.models.length;
  const element = h("form", { class: "panel chooser", onsubmit: (event) => event.preventDefault() },
    h("fieldset", {}, h("legend", {}, "Runs"), h("div", { class: "picks", tabindex: 0 }, ...boxes), importer(choices, again)),
    h("div", { class: "fields" },
      h("div", { class: "field" }, h("label", { for: "choose-model" }, "Model"), model),
      holdOutField, onlyField, assumeField,
      button("Open", () => open(choice()), { class: "primary", disabled: empty })));
  if (empty) element.append(h("p", { class: "empty" }, choices.runs.length ? "There is no model in this project's models folder." : "There is no run yet: record one, simulate one, or bring in data."));
  // What was open before; else the newest run with a model of its bench.
  const reopened = before.runs && !empty && before.runs.every((id) => choices.runs.some((run) => run.id === id)) && known(before.model);
  const newest = !before.runs && !empty && named && known(named) && choices.runs[0].records > 0;
  return { element, auto: () => (reopened ? before : newest ? choice() : null) };
};

// The buttons: each runs its command in a separate process, and shows the result.
// `current()` is the open model: each new version reopens it. The server stores
// results, which reappear after a reload, and jobs in progress are awaited again.
const makeDesk = (current) => {
  const jobs = h("div", { class: "jobs", "aria-live": "polite" });
  const found = h("div", { class: "found" });
  const listed = () => remembered()?.cards ?? [];
  const list = (cards) => remember({ ...(remembered() ?? {}), cards });
  const unlist = (id) => list(listed().filter((one) => one.id !== id));

  // Changes are saved first, so that the command uses the displayed model.
  const begin = async (verb, { effect = "", beside = "" } = {}) => {
    if (current().changed()) await current().keep();
    const { runs, model, hold_out, only, assume } = current().asked;
    const job = await api("/api/workbench/work", { method: "POST", body: { verb, effect, beside, runs, model, hold_out: hold_out ?? "", only: only ?? "", assume: assume ?? [] } });
    if (verb in shows) list([...listed().filter((one) => one.verb !== verb), { verb, id: job.id, version: current().version }]);
    try {
      return { job, result: await work(jobs, job) };
    } catch (problem) {
      if (problem instanceof Refusal) unlist(job.id); // not while leaving the page
      throw problem;
    }
  };
  const card = (name, job, inside, { version = current().version, quiet = false } = {}) => {
    found.querySelector(`[data-verb="${name}"]`)?.remove();
    const close = () => {
      panel.remove();
      unlist(job.id);
    };
    const panel = h("section", { class: "panel result", "data-verb": name, tabindex: -1 },
      h("h2", {}, h("span", {}, job.name, version ? h("span", { class: "mark" }, ` of version ${version}`) : ""), button("×", close, { class: "small close", "aria-label": `Close ${job.name}` })),
      command(job.command), ...inside.filter(Boolean));
    found.prepend(panel);
    if (version !== current().version) stripped(panel);
    if (quiet) return;
    panel.scrollIntoView({ block: "nearest" });
    panel.focus({ preventScroll: true });
  };
  // Results of an earlier version remain readable, without their buttons.
  const stripped = (container) => {
    for (const one of container.querySelectorAll(".buttons, .toolbar")) one.remove();
  };
  // Results from before a reload, as far as the server still has them.
  const restore = async () => {
    for (const { verb, id, version } of listed()) {
      try {
        const job = await api(`/api/jobs/${id}`);
        card(verb, job, shows[verb](job.state === "working" ? await work(jobs, job) : done(job)), { version, quiet: true });
      } catch (problem) {
        if (problem instanceof Refusal) unlist(id); // stopped, or no longer stored
        else throw problem;
      }
    }
  };
  const done = (job) => {
    if (job.state !== "done") throw new Refusal(409, { message: `${job.name}: ${job.state}` });
    return job.result;
  };
  const changing = async (verb, effect) => {
    const { job, result } = await begin(verb, { effect });
    await current().reload();
    card("change", job, verb === "improve" ? results.improvement(result) : results.change(result));
  };
  const approve = async (procedure, effects) => {
    const job = await api("/api/workbench/approve", { method: "POST", body: { procedure, effects } });
    const result = await work(jobs, job);
    const wider = { ...current().asked, runs: [...current().asked.runs, result.run], state: null };
    card("approve", job, [
      h("p", { class: "statement good" }, `${result.run}: ${result.status}`),
      h("div", { class: "toolbar" }, button("Open with the new run", () => current().open(wider), { class: "primary" })),
    ]);
  };
  const toReal = async (procedure) => {
    const written = await api("/api/workbench/procedure", { method: "POST", body: { procedure } });
    location.assign(`/procedure?file=${encodeURIComponent(written.file)}`);
  };
  const actions = {
    look: (state) => current().look(state),
    add: (effect) => changing("add", effect),
    improve: () => changing("improve"),
    design: () => run.design(),
    discover: () => run.discover(),
  };
  const shows = {
    compare: results.comparison,
    diagnose: (result) => results.diagnosis(result, actions),
    design: (result) => results.experiment(result, { approve: (effects) => approve(result.procedure, effects), toReal: () => toReal(result.procedure) }),
    discover: results.discovery,
  };
  const run = Object.fromEntries(Object.entries(shows).map(([verb, show]) => [verb, async () => {
    const { job, result } = await begin(verb);
    card(verb, job, show(result));
  }]));
  run.fit = () => changing("fit");
  run.history = async () => {
    const inside = h("div");
    const head = current().asked.model.replace(/@\d+$/, "");
    await history(inside, head, {
      version: current().version,
      open: (version, newest) => current().open({ ...current().asked, model: version === newest ? head : `${head}@${version}`, state: null }),
      beside: async (version) => {
        const { job, result } = await begin("compare", { beside: `${head}@${version}` });
        card("compare", job, results.comparison(result));
      },
    });
    card("history", { name: "History", command: current().commands.history }, [inside]);
  };
  const NAMES = { fit: "Fit", compare: "Compare", diagnose: "Diagnose", design: "Next experiment", discover: "Discover", history: "History" };
  const buttons = Object.fromEntries(Object.entries(NAMES).map(([verb, name]) => [verb, button(name, run[verb], { "data-verb": verb })]));
  return {
    changing, found, jobs,
    toolbar: h("div", { class: "toolbar verbs", role: "toolbar", "aria-label": "Analyses" }, ...Object.values(buttons)),
    tell: (command, commands) => {
      for (const [verb, one] of Object.entries(buttons)) one.title = [verb === "history" ? "" : command, commands[verb]].filter(Boolean).join(" && ");
    },
    restore,
    retire: () => stripped(found),
  };
};

const bench = (container, opened, { send, asked, desk }) => {
  const start = opened.state;
  const state = { values: { ...start.values }, on: new Set(start.on) };
  let shownRecord = opened.shown[0];
  let channel = null;
  let sequence = 0;
  let waiting = false;
  let again = null;
  // the steps of this page, as counted by the server, so that undo works after a reload
  let steps = { past: [], future: [] };
  let present = null;
  let before = null; // a refused step does not count

  const choice = () => ({
    values: Object.fromEntries(Object.entries(state.values).filter(([name, value]) => value !== start.values[name])),
    on: [...state.on],
  });
  const counts = (name) => !name.includes(".") || state.on.has(name.split(".")[0]);
  const changed = () => Object.keys(choice().values).some(counts) || [...state.on].sort().join() !== [...start.on].sort().join();
  // One picture is requested at a time; only the latest of later moves counts.
  const followNow = () => {
    sequence += 1;
    const message = { do: "follow", seq: sequence, sent: performance.now(), ...choice() };
    if (waiting) again = message;
    else {
      waiting = true;
      send(message);
    }
  };
  // Arrow keys release a slider at every press: presses in quick succession are one step, like a drag.
  let resting = null;
  const rested = () => {
    clearTimeout(resting);
    mood("fitting");
    resting = setTimeout(restNow, TOGETHER);
  };
  const flush = () => resting !== null && restNow();
  const restNow = () => {
    clearTimeout(resting);
    resting = null;
    mood("fitting");
    sequence += 1;
    again = null;
    send({ do: "settle", seq: sequence, sent: performance.now(), ...choice() });
    stepped();
  };
  const same = (one, other) => JSON.stringify([one.values, [...one.on].sort()]) === JSON.stringify([other.values, [...other.on].sort()]);
  const stepped = () => {
    before = { steps, present };
    if (same(choice(), present)) return;
    steps = { past: [...steps.past, present].slice(-MOST_STEPS), future: [] };
    noted();
  };
  const noted = () => {
    present = choice();
    remember({ ...remembered(), state: present, steps, version: opened.version });
  };
  const moved = (name, value) => {
    clearTimeout(resting);
    state.values[name] = value;
    mood("moving");
    followNow();
  };
  const switched = (name, on) => {
    if (on) state.on.add(name);
    else state.on.delete(name);
    switches.find((one) => one.name === name)?.set(on);
    restNow();
  };

  const status = h("p", { class: "mood", role: "status" });
  const MOODS = {
    moving: "moving: each record keeps what it has of its own",
    fitting: "fitting what each record has of its own…",
    exact: "exact: the numbers of compare --no-fit",
  };
  const mood = (name) => {
    if (name !== "exact") container.dataset.exact = "no";
    if (status.dataset.mood === name) return;
    status.dataset.mood = name;
    status.textContent = MOODS[name];
  };

  const curves = makeCurves(opened);
  const bode = makeBode(opened, (asked) => send({ do: "frequency", seq: sequence, ...asked }));
  const title = h("h2", { class: "record" });
  const channelChoice = h("select", { id: "map-channel", onchange: () => ((channel = Number(channelChoice.value)), showChannel()) }, ...opened.channels.map((one, k) => h("option", { value: k }, one.title)));
  const map = makeMap(opened, (k) => {
    shownRecord = k;
    send({ do: "show", records: [k], seq: (sequence += 1) });
  });
  const errors = { size: null, bias: null };
  const showChannel = () => {
    curves.choose(channel);
    drawMap();
  };
  const drawMap = () => errors.size && map.set(channel, opened.channels[channel].title, errors.size, errors.bias, shownRecord);

  const worst = (header) => opened.channels.reduce((best, one, k) => ((header.channels[one.name]?.nrmse ?? 0) > (header.channels[opened.channels[best].name]?.nrmse ?? 0) ? k : best), 0);

  const numbers = h("ul", { class: "figures now", "aria-label": "Error of each channel" });
  const showNumbers = (header) => {
    numbers.replaceChildren(...opened.channels.map((one) => {
      const error = header.channels[one.name];
      const held = header.heldout[one.name];
      if (!error) return h("li", {}, h("b", {}, "–"), one.title);
      return h("li", {}, h("b", {}, `${figure(error.rmse)} ${error.unit}`), `${one.title}: ${figure(error.nrmse, 3)} times its noise`, held ? h("span", { class: "note" }, `, held out ${figure(held.nrmse, 3)}`) : "");
    }));
    for (const [c, one] of opened.channels.entries()) {
      const error = header.channels[one.name];
      curves.says[c].textContent = error ? `noise ${figure(error.noise, 3)} ${error.unit}` : "";
    }
  };

  const step = (way) => {
    flush();
    mood("fitting");
    const { past, future } = steps;
    if (way === "undo" && past.length) steps = { past: past.slice(0, -1), future: [present, ...future] };
    if (way === "redo" && future.length) steps = { past: [...past, present], future: future.slice(1) };
    send({ do: way, seq: (sequence += 1) });
  };
  const undo = button("Undo", () => step("undo"), { "aria-keyshortcuts": "Control+Z" });
  const redo = button("Redo", () => step("redo"), { "aria-keyshortcuts": "Control+Shift+Z" });
  const keep = button("Keep as version", () => keepNow(), { class: "primary" });
  const commandPlace = h("div", { class: "standsfor" });
  const showCommand = (text) => {
    keep.disabled = !text;
    commandPlace.replaceChildren(text ? command(text) : h("p", { class: "note" }, `as ${opened.model}${opened.version ? `, version ${opened.version}` : ""}, has it`));
    desk.tell(text, opened.commands);
  };
  const showSteps = (header) => {
    undo.disabled = !header.undo;
    redo.disabled = !header.redo;
  };

  let keeping = null;
  const keepNow = () =>
    new Promise((done, fail) => {
      flush();
      keeping = { done, fail };
      send({ do: "keep" });
    });
  let reloading = null;
  const reload = () =>
    new Promise((done) => {
      reloading = done;
      send({ do: "reload" });
    });

  const sliders = opened.sliders.map((one) => makeSlider(one, { moved, rested }));
  const effectButtons = (effect, on) => [
    effect.base ? null : on === effect.on && on
      ? button("Remove", () => desk.changing("remove", effect.name), { class: "small", "aria-label": `Remove ${effect.title} and fit the rest` })
      : !effect.on ? button("Fit in", () => desk.changing("add", effect.name), { class: "small", "aria-label": `Add ${effect.title} and fit it` }) : null,
  ].filter(Boolean);
  const switches = opened.switches.map((one) => makeSwitch(one, { moved, rested, switched, actions: effectButtons }));
  const look = (other) => {
    for (const [name, value] of Object.entries(other.values)) if (name in state.values) state.values[name] = value;
    for (const name of other.on) state.on.add(name);
    showState();
    rested();
  };
  const every = new Map([...sliders, ...switches.flatMap((one) => one.sliders)].map((one) => [one.name, one]));
  const showState = () => {
    for (const [name, one] of every) one.set(state.values[name]);
    for (const one of switches) one.set(state.on.has(one.name));
  };
  const find = h("input", { type: "search", id: "find-effect", placeholder: "leak, friction, drift", oninput: () => {
    const text = find.value.trim().toLowerCase();
    for (const one of switches) one.element.hidden = Boolean(text) && !`${one.effect.title} ${one.effect.summary} ${one.effect.looks_like}`.toLowerCase().includes(text);
  } });
  const fitted = sliders.filter((_, k) => opened.sliders[k].fit);
  const others = sliders.filter((_, k) => !opened.sliders[k].fit);
  const base = switches.filter((one) => one.effect.base);
  const first = switches.filter((one) => one.effect.on && !one.effect.base);
  const rest = switches.filter((one) => !one.effect.on && !one.effect.base);

  container.replaceChildren(
    h("div", { class: "bench" },
      h("div", { class: "sight", tabindex: 0, role: "region", "aria-label": "Curves" }, numbers, h("div", { class: "toolbar about" }, title, h("label", { for: "map-channel" }, "Channel"), channelChoice, status), curves.element, bode.element),
      h("aside", { class: "panel hands", "aria-label": "Sliders and switches" },
        h("div", { class: "toolbar" }, undo, redo, keep),
        commandPlace,
        h("h2", {}, "Parameters"), ...fitted.map((one) => one.element),
        others.length ? h("details", { open: !fitted.length }, h("summary", {}, fitted.length ? "Those that no fit changes" : "All"), ...others.map((one) => one.element)) : null,
        h("h2", {}, "Effects"), h("div", { class: "field" }, h("label", { for: "find-effect" }, "Find"), find),
        h("ul", { class: "effects" }, ...first.map((one) => one.element), ...rest.map((one) => one.element)),
        base.length ? h("details", {}, h("summary", {}, "Base physics"), h("ul", { class: "effects" }, ...base.map((one) => one.element))) : null),
      h("div", { class: "panel spread" }, h("div", { class: "toolbar" }, h("h2", {}, opened.over ? "Every row" : "Every record")), map.element)),
  );

  const drawn = (header) => {
    container.dataset.seq = header.seq ?? 0;
    container.dataset.exact = header.exact ? "yes" : "no";
    requestAnimationFrame(() => document.dispatchEvent(new CustomEvent("workbench-drawn", { detail: { seq: header.seq, sent: header.sent, exact: header.exact, records: header.records.length, server: header.seconds } })));
  };
  const hear = (header, arrays) => {
    if (header.kind === "record" && header.record === shownRecord) curves.setRecord({ arrays });
    // one of an older state than the sliders': a newer one is on its way
    if (header.kind === "frequency" && !(header.exact && (header.seq ?? 0) < sequence)) bode.set(header, arrays, header.command);
    if (header.kind === "picture") {
      // also the first one, when steps are restored after a reload
      const stale = header.exact && (header.seq ?? 0) < sequence;
      if (!stale) {
        errors.size = arrays.size;
        errors.bias = arrays.bias;
        if (channel === null) {
          channelChoice.value = channel = worst(header);
          bode.suggest(opened.channels[channel].name);
          curves.choose(channel);
        }
        if (header.shown.includes(shownRecord)) curves.setPicture(arrays[`model ${shownRecord}`], arrays[`error ${shownRecord}`]);
        const one = opened.records[shownRecord];
        const which = opened.over ? [one.series, `over ${opened.over.title}`] : [one.label, one.condition];
        title.textContent = [...which, one.held_out ? "held out" : ""].filter(Boolean).join(" · ");
        drawMap();
        showNumbers(header);
        showCommand(header.command);
        showSteps(header);
        if (header.exact) mood("exact");
        for (const why of Object.values(header.failures).slice(0, 1)) status.textContent = `no course: ${why}`;
        drawn(header);
      }
      if (waiting && !header.exact) {
        waiting = false;
        if (again) {
          const next = again;
          again = null;
          waiting = true;
          send(next);
        }
      }
    }
    if (header.kind === "state") {
      for (const [name, value] of Object.entries(header.state.values)) state.values[name] = value;
      state.on = new Set(header.state.on);
      showState();
      mood("fitting");
      noted();
    }
    if (header.kind === "kept") {
      say(`${header.model} is now version ${header.version}.`, "good");
    }
    if (header.kind === "problem") {
      waiting = false;
      if (header.do === "settle" && before) {
        ({ steps, present } = before);
        remember({ ...remembered(), state: present, steps });
      }
      if (header.do === "retrace") {
        steps = { past: [], future: [] };
        rested();
      }
      keeping?.fail(new Error(header.error.message));
      if (!keeping) say(header.error.message, "bad");
      keeping = null;
    }
  };
  const keys = (event) => {
    if (!(event.ctrlKey || event.metaKey) || event.key.toLowerCase() !== "z" || /^(text|search)$/.test(event.target.type ?? "")) return;
    event.preventDefault();
    if (!(event.shiftKey ? redo : undo).disabled) step(event.shiftKey ? "redo" : "undo");
  };
  document.addEventListener("keydown", keys);
  const restore = (saved) => {
    if (!saved?.state?.on || (saved.version && saved.version !== opened.version)) return;
    // names missing in this model are from another version
    const known = (one) => ({
      values: Object.fromEntries(Object.entries(one.values).filter(([name]) => name in start.values)),
      on: one.on.filter((name) => opened.switches.some((each) => each.name === name)),
    });
    const now = known(saved.state);
    Object.assign(state.values, now.values);
    state.on = new Set(now.on);
    steps = { past: (saved.steps?.past ?? []).map(known), future: (saved.steps?.future ?? []).map(known) };
    showState();
    mood("fitting");
    send({ do: "retrace", seq: (sequence += 1), ...choice(), ...steps });
    noted();
  };
  present = choice();
  return {
    hear, restore, look, reload, asked,
    keep: keepNow,
    changed: () => (flush(), changed()),
    commands: opened.commands,
    version: opened.version,
    // The next version is open: continue with it.
    close: () => {
      document.removeEventListener("keydown", keys);
      curves.remove();
      bode.remove();
      clearTimeout(resting);
      keeping?.done();
      reloading?.();
    },
  };
};

export const show = async (container) => {
  document.head.append(h("link", { rel: "stylesheet", href: "/assets/workbench/workbench.css" }));
  const area = h("div", { class: "area" });
  const progress = h("p", { class: "note", role: "status" });
  const took = h("span", { class: "note", "aria-hidden": "true" });
  const waiting = (text) => {
    progress.replaceChildren(text, ...(text ? [took] : []));
    clearInterval(ticking);
    const since = Date.now();
    took.textContent = "";
    if (text) ticking = setInterval(() => {
      took.textContent = `, ${Math.round((Date.now() - since) / 1000)} s`;
      if (!took.isConnected) clearInterval(ticking);
    }, 1000);
  };
  let ticking = 0;
  let link = null;
  let now = null;
  let restoring = null;
  const desk = makeDesk(() => now);
  const tools = h("div", { hidden: true }, desk.toolbar, desk.jobs);

  const open = async ({ state = null, steps = null, version = null, cards = [], ...asked }) => {
    if (!asked.runs.length) throw new Error("Choose a run.");
    link?.socket.close();
    now?.close();
    now = null;
    tools.hidden = true;
    desk.found.replaceChildren();
    area.replaceChildren();
    area.removeAttribute("data-open");
    restoring = { state, steps, version };
    remember({ ...asked, ...restoring, cards });
    const mine = connect((header, arrays) => {
      if (link !== mine) return;
      if (header.kind === "progress") waiting(header.text);
      else if (header.kind === "opened") {
        waiting("");
        const older = now;
        now = { ...bench(area, header, { send: mine.send, asked, desk }), open };
        desk.retire();
        older?.close();
        tools.hidden = false;
        area.dataset.open = `${header.model}@${header.version}`;
        summary.textContent = `${header.model}, version ${header.version}, on ${header.runs.join(", ")}: ${records(header.records.length)}`;
        choosing.open = false;
        if (older) remember({ ...asked, cards: remembered()?.cards });
        now.restore(restoring);
        restoring = null;
        if (!older) desk.restore().catch(complain);
      } else if (now) now.hear(header, arrays);
      else if (header.kind === "problem") {
        waiting("");
        choosing.open = true;
        say(header.error.message, "bad");
      }
    });
    link = mine;
    waiting("Starting");
    choosing.open = false;
    mine.socket.addEventListener("close", () => {
      if (link !== mine) return;
      link = null;
      waiting("");
      progress.replaceChildren("The connection has ended. ", button("Open again", () => open(remembered() ?? asked), { class: "small" }));
    });
    await mine.ready;
    mine.send({ do: "open", ...asked });
  };

  const imported = async (run) => {
    remember({ ...(remembered() ?? {}), runs: [run], state: null });
    choosing.replaceChildren(choosing.firstElementChild, (await chooser(open, imported)).element);
  };
  const { element, auto } = await chooser(open, imported);
  const summary = h("span", {}, "Choose runs and a model");
  const choosing = h("details", { class: "choosing", open: true }, h("summary", {}, summary), element);
  container.replaceChildren(choosing, progress, tools, area, desk.found);
  const before = auto();
  if (before && !location.search) await open(before);
};
