// The run in progress: state, steps, a live plot of each channel, and the controls, held by one window.
import { api, button, clock, colour, command, complain, h, sameAs, settle, tag, viewer, wait } from "./lib.js";
import { byHand } from "./live/by_hand.js";
import { plot } from "./plot.js";
import { asPoints, draggable, dropPlace, makeChoice, pointPlot } from "./xy.js";

const WINDOWS = [[10, "10 s"], [30, "30 s"], [60, "1 min"], [300, "5 min"], [900, "15 min"]];
const ENDED = ["finished", "failed", "aborted"];
// when the newest samples were drawn: run time and clock time in s, for measuring the latency
export const drawnAt = [];

// Columns of samples over the window; the last rows may be provisional.
class Samples {
  constructor() {
    this.columns = [];
    this.provisional = 0;
  }

  begin(count) {
    this.columns = Array.from({ length: count }, () => []);
    this.provisional = 0;
  }

  get newest() {
    const times = this.columns[0];
    return times?.length ? times[times.length - 1] : null;
  }

  // A batch: rows, columns, provisional, anew (u16), time of the first row (f64), then columns of f32.
  take(buffer, window) {
    const head = new DataView(buffer);
    const [rows, count, provisional, anew] = [0, 2, 4, 6].map((at) => head.getUint16(at, true));
    const first = head.getFloat64(8, true);
    if (anew || this.columns.length !== count) this.begin(count);
    if (this.provisional) for (const column of this.columns) column.length = Math.max(column.length - this.provisional, 0);
    const values = new Float32Array(buffer, 16);
    for (let at = 0; at < count; at++) {
      const column = this.columns[at];
      for (let row = 0; row < rows; row++) {
        const value = values[at * rows + row];
        column.push(at === 0 ? first + value : Number.isFinite(value) ? value : null);
      }
    }
    this.provisional = provisional;
    this.trim(window);
  }

  takeRows(rows, window) {
    if (!rows.length) return;
    if (this.columns.length !== rows[0].length) this.begin(rows[0].length);
    for (const row of rows) row.forEach((value, at) => this.columns[at].push(value));
    this.trim(window);
  }

  trim(window) {
    const times = this.columns[0];
    if (!times?.length) return;
    const oldest = times[times.length - 1] - window;
    let old = 0;
    while (old < times.length && times[old] < oldest) old++;
    if (old > 200 || old > times.length / 4) for (const column of this.columns) column.splice(0, old);
  }
}

// A connection that reconnects by itself; without sockets, the server is polled once a second.
class Line {
  constructor(hear, wanted) {
    this.hear = hear;
    this.wanted = wanted;
    this.failures = 0;
    this.socket = null;
    this.asking = false;
    this.open();
  }

  open() {
    if (typeof WebSocket !== "function" || this.failures >= 4) return this.ask();
    const address = `${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/api/live/stream?viewer=${encodeURIComponent(viewer)}`;
    let socket;
    try {
      socket = this.socket = new WebSocket(address);
    } catch {
      return this.ask();
    }
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      this.failures = 0;
      settle("line", null);
      this.want();
    };
    socket.onmessage = (event) => this.hear(event.data);
    socket.onclose = () => {
      if (this.socket !== socket) return;
      this.failures += 1;
      settle("line", "The connection is lost; what is shown has stopped. It is tried again.");
      setTimeout(() => this.open(), Math.min(500 * this.failures, 4000));
    };
  }

  want() {
    if (this.socket?.readyState === 1) this.socket.send(JSON.stringify(this.wanted()));
  }

  async ask() {
    if (this.asking) return;
    this.asking = true;
    settle("line", "This browser has no live connection to the server; it is asked once a second.");
    let known = null;
    let after = "";
    for (;;) {
      try {
        const { runs, lease } = await api("/api/live");
        this.hear({ kind: "runs", runs });
        this.hear({ kind: "lease", lease });
        const { run, window, width } = this.wanted();
        if (run) {
          const snapshot = await api(`/api/live/${encodeURIComponent(run)}`, { query: { after, window, width } });
          if (run !== known) this.hear({ kind: "run", run: snapshot.run });
          known = run;
          this.hear({ kind: "rows", rows: snapshot.rows });
          if (snapshot.rows.length) after = snapshot.rows[snapshot.rows.length - 1][0];
          this.hear({ kind: "events", events: snapshot.events, whole: true });
          this.hear({ kind: "state", state: snapshot.state });
          this.hear({ kind: "set_points", set_points: snapshot.set_points });
        }
      } catch (problem) {
        if (problem.status === 401) throw problem;
      }
      await wait(1000);
    }
  }
}

export const show = async (container) => {
  const samples = new Samples();
  let window_ = 60;
  let run = new URLSearchParams(location.search).get("run");
  let about = null;
  let state = null;
  let setPoints = []; // of the steps: channel, begin, end, from, to, seconds, within
  let lease = { holder: null, mine: false, window: null, viewers: 0 };
  let running = [];
  let panels = [];
  let dirty = false;

  // --- the head: state, progress, controls -------------------------------------------------------------------
  const stateTag = h("span", { class: "run-state" });
  const title = h("h2", { class: "run-title" });
  const subtitle = h("p", { class: "note" });
  const progress = h("progress", { max: 1, value: 0, "aria-label": "Progress" });
  const left = h("span", { class: "note left" });
  const why = h("p", { class: "statement bad", hidden: true, role: "alert" });
  const asks = h("p", { role: "alert" });
  const answer = h("input", { type: "text", id: "answer", autocomplete: "off" });
  const answerLabel = h("label", { for: "answer", class: "hidden" }, "The answer");
  const done = h("button", { type: "submit", class: "primary" }, "Answer");
  const reply = h("form", { class: "inline", onsubmit: async (event) => {
    event.preventDefault();
    try {
      await api(`/api/live/${encodeURIComponent(run)}/answer`, { method: "POST", body: { question: state.asked, text: answer.value } });
      answer.value = "";
    } catch (problem) {
      complain(problem);
    }
  } }, answerLabel, answer, done);
  const question = h("div", { class: "statement warn question", hidden: true }, asks, reply);
  const alarms = h("ul", { class: "alarms", role: "alert" });

  const request = (wanted) => async () => {
    const { answer } = await api(`/api/live/${encodeURIComponent(run)}/request`, { method: "POST", body: { request: wanted } });
    settle("answer", `${run}: ${answer}`);
    sameAs(`rigctl ${wanted} ${run}`);
    setTimeout(() => settle("answer", null), 6000);
  };
  const pause = button("Pause", request("pause"), { title: "rigctl pause" });
  const goOn = button("Continue", request("continue"), { title: "rigctl continue", class: "primary" });
  const abort = h("button", { type: "button", class: "danger", title: "rigctl abort" }, "Abort");
  let sure = null;
  const calm = () => {
    clearTimeout(sure);
    sure = null;
    abort.textContent = "Abort";
  };
  abort.addEventListener("click", async () => {
    if (!sure) {
      abort.textContent = "Abort now: press again";
      sure = setTimeout(calm, 4000);
      return;
    }
    calm();
    try {
      await request("abort")();
    } catch (problem) {
      complain(problem);
    }
  });
  const off = button("Everything off", async () => {
    const done = await api("/api/live/off", { method: "POST", body: run ? { run } : {} });
    settle("off", done.done);
    sameAs("rigctl off");
    if (done.confirmed) setTimeout(() => settle("off", null), 8000);
  }, { class: "danger solid", title: "rigctl off: all outputs to their safe state, now, by any window" });
  const leaseText = h("span", { class: "note", role: "status" });
  const take = button("Take the controls", () => api("/api/live/lease", { method: "POST", body: { over: true } }).then(showLease), { class: "small" });
  const give = button("Give them back", () => api("/api/live/lease", { method: "POST", body: { give: true } }).then(showLease), { class: "small" });
  const chooser = h("select", { "aria-label": "Run in progress", onchange: () => watch(chooser.value) });
  const span = h("select", { id: "span", onchange: () => { window_ = Number(span.value); line.want(); } }, WINDOWS.map(([seconds, text]) => h("option", { value: String(seconds), selected: seconds === window_ }, text)));

  const second = h("div", { class: "live-line", hidden: true }, progress, left, h("span", { class: "push lease" }, leaseText, take, give));
  const head = h("section", { class: "panel live-head", "aria-label": "State" },
    h("div", { class: "live-line" }, stateTag, h("div", { class: "live-names" }, title, subtitle), chooser,
      h("div", { class: "controls" }, pause, goOn, abort, off)),
    second,
    question, why, alarms);

  // --- beside the plots --------------------------------------------------------------------------------------
  const tree = h("ol", { class: "tree" });
  const commands = h("dl", { class: "facts commands" });
  const events = h("ul", { class: "events", tabindex: "0", "aria-label": "Events, newest first" });
  const plots = h("div", { class: "plots" });
  const overWhat = h("span"); // one channel over another
  const together = h("div");
  const beside = h("aside", { class: "live-side" },
    h("section", { class: "panel of-run" }, h("h2", {}, "Steps"), tree),
    h("section", { class: "panel" }, h("h2", {}, "Outputs"), commands),
    h("section", { class: "panel of-run" }, h("h2", {}, "Events"), events));
  const idle = h("div", { class: "panel idle" });
  const body = h("div", { class: "split live", hidden: true },
    h("div", {}, h("div", { class: "toolbar" }, h("label", { for: "span" }, "Shown"), span, overWhat), together, plots), beside);

  const showLease = (granted) => {
    lease = granted;
    const many = lease.viewers > 1 ? `, ${lease.viewers} windows watch` : "";
    const one = lease.window === null ? "" : ` (this is window ${lease.window}${many})`;
    leaseText.textContent = lease.mine ? `This window has the controls${many}` : lease.holder === null ? `Nobody has the controls${one}` : `Window ${lease.holder} has the controls${one}`;
    take.textContent = lease.holder === null ? "Take the controls" : "Take over";
    take.hidden = lease.mine;
    give.hidden = !lease.mine;
    buttons();
  };

  const buttons = () => {
    const going = Boolean(state) && !state.ended;
    const locked = lease.holder !== null && !lease.mine;
    pause.hidden = !going || state.state === "paused";
    goOn.hidden = !going || state.state !== "paused";
    abort.hidden = !going;
    for (const one of [pause, goOn, abort, done]) one.disabled = locked;
  };

  const shown = (value, unit, places) => (value === null || value === undefined ? "no value" : `${value.toFixed(places)} ${unit}`.replace(/ 1$/, "").replace(/^-(0\.?0* )/, "$1"));

  const position = (one, value) => {
    if (value === null || value === undefined) return "–";
    if (one.kind === "switch") return value ? "on" : "off";
    if (one.kind === "directional_valve") return value > 0 ? "extend" : value < 0 ? "retract" : "neutral";
    return `${Number(value.toPrecision(4))} ${one.unit}`.replace(/ 1$/, "");
  };

  const limitText = (limits, unit) => {
    const parts = limits.map((limit) => `${limit.action}s ${limit.bound} ${Number(limit.value.toPrecision(4))}`);
    return parts.length ? `${parts.join(", ")} ${unit}`.replace(/ 1$/, "") : "";
  };

  const limitLines = (limits) => (drawn) => {
    const { ctx, bbox } = drawn;
    ctx.save();
    ctx.lineWidth = devicePixelRatio;
    ctx.setLineDash([6 * devicePixelRatio, 4 * devicePixelRatio]);
    for (const limit of limits) {
      const y = Math.round(drawn.valToPos(limit.value, "y", true));
      if (y < bbox.top || y > bbox.top + bbox.height) continue;
      ctx.strokeStyle = colour(limit.action === "stop" ? "--bad" : "--warn");
      ctx.beginPath();
      ctx.moveTo(bbox.left, y);
      ctx.lineTo(bbox.left + bbox.width, y);
      ctx.stroke();
    }
    ctx.restore();
  };

  // Set-points of a channel: a line per step, along its ramp, from the step's start to its end or until now.
  const courseOf = (one) => {
    const end = one.end ?? samples.newest ?? one.begin;
    const arrives = one.begin + (one.seconds ?? 0);
    const at = (time) => (one.seconds ? one.from + (one.to - one.from) * Math.min((time - one.begin) / one.seconds, 1) : one.to);
    return [[one.begin, at(one.begin)], ...(one.seconds && arrives < end ? [[arrives, one.to]] : []), [end, at(end)]];
  };

  const setPointLines = (name) => (drawn) => {
    const { ctx, bbox } = drawn;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    ctx.lineWidth = 1.5 * devicePixelRatio;
    ctx.setLineDash([6 * devicePixelRatio, 4 * devicePixelRatio]);
    ctx.strokeStyle = colour("--curve-2");
    for (const one of setPoints) {
      if (one.channel !== name) continue;
      ctx.beginPath();
      courseOf(one).forEach(([time, value], k) => ctx[k ? "lineTo" : "moveTo"](drawn.valToPos(time, "x", true), drawn.valToPos(value, "y", true)));
      ctx.stroke();
    }
    ctx.restore();
  };

  // lowest and highest visible set-point of a channel
  const setPointRange = (name) => {
    const since = (samples.newest ?? 0) - window_;
    const values = setPoints.filter((one) => one.channel === name && (one.end ?? Infinity) >= since)
      .flatMap((one) => courseOf(one).filter(([time]) => time >= since || one.end === null).map(([, value]) => value));
    return values.length ? [Math.min(...values), Math.max(...values)] : null;
  };

  const target = (panel) => {
    const one = setPoints.findLast((each) => each.channel === panel.channel.name && each.end === null);
    if (!one) return "";
    const within = one.within === null ? "" : ` ± ${Number(one.within.toPrecision(2))}`;
    return `to ${Number(one.to.toPrecision(5))}${within} ${panel.unit}`.trimEnd();
  };

  // One channel over another, as chosen from the lists, or by dragging one channel onto the plot of another.
  let choice = null;
  let points = null;
  const showTogether = (y, x) => {
    points?.remove();
    points = null;
    together.replaceChildren();
    if (!x || x === y) return;
    points = pointPlot(choice, [{ label: y }], { zoom: false, legend: false });
    together.append(dropPlace(h("section", { class: "panel together", "aria-label": `${y} over ${x}` }, points.element), (name, low) => (low ? choice.set(null, name) : choice.set(name, null))));
    dirty = true;
  };
  const columnOf = (name) => samples.columns[1 + about.channels.findIndex((one) => one.name === name)] ?? [];

  const build = () => {
    choice = makeChoice(about.channels, "time", showTogether);
    overWhat.replaceChildren(choice.element);
    showTogether("", "");
    for (const panel of panels) panel.plot.remove();
    const names = about.channels.map((channel) => channel.name);
    panels = about.channels.map((channel, index) => {
      const unit = channel.unit === "1" ? "" : channel.unit;
      const follows = channel.set_point === null ? -1 : about.commands.findIndex((one) => one.name === channel.set_point);
      const least = 10 * 10 ** -channel.places;
      const value = h("b", { class: "value" });
      const wanted = h("span", { class: "note set-point" });
      const series = [{ label: channel.name }];
      if (follows >= 0) series.push({ label: "set-point", colour: 1, dash: [6, 4], stepped: true });
      const drawn = plot({
        height: 170, series, legend: false, zoom: false, sync: "live", describe: `${channel.name} over the last ${span.selectedOptions[0].textContent}`,
        xValues: (_, values) => values.map((value) => clock(value)),
        xRange: () => (samples.newest === null ? [0, window_] : [Math.min(Math.max(samples.newest - window_, samples.columns[0][0]), samples.newest - Math.min(window_, 5)), samples.newest]),
        yRange: (_, low, high) => {
          if (low === null || high === null) return [0, 1];
          const wanted = setPointRange(channel.name);
          if (wanted) [low, high] = [Math.min(low, wanted[0]), Math.max(high, wanted[1])];
          const middle = (low + high) / 2;
          const half = Math.max((high - low) / 2, least / 2) * 1.15;
          return [middle - half, middle + half];
        },
        hooks: () => ({ draw: [limitLines(channel.limits), setPointLines(channel.name)] }),
      });
      const box = h("section", { class: "panel channel", "data-channel": channel.name },
        h("header", { class: "channel-head" }, draggable(h("h3", {}, channel.name.replaceAll("_", " ")), channel.name), value, wanted, h("span", { class: "note limits" }, limitText(channel.limits, unit))), drawn.element);
      dropPlace(box, (name) => choice.set(channel.name, name));
      return { channel, unit, plot: drawn, box, value, wanted, index: index + 1, follows: follows < 0 ? -1 : 1 + names.length + follows };
    });
    plots.replaceChildren(...panels.map((panel) => panel.box));
    commands.replaceChildren(...about.commands.map((one) => h("div", {}, h("dt", {}, one.name.replaceAll("_", " ")), h("dd", { "data-command": one.name }, "–"))));
    title.textContent = about.run;
    for (const one of beside.querySelectorAll(".of-run")) one.hidden = !run;
    subtitle.textContent = [about.procedure, about.rig, about.backend.kind, about.operator && `by ${about.operator}`].filter(Boolean).join(" · ");
  };

  const redraw = () => {
    if (!dirty || document.hidden || !about || !samples.columns.length) return;
    dirty = false;
    const last = samples.columns[0].length - 1;
    for (const panel of panels) {
      const data = [samples.columns[0], samples.columns[panel.index] ?? []];
      if (panel.follows >= 0) data.push(samples.columns[panel.follows] ?? []);
      panel.plot.set(data);
      panel.wanted.textContent = target(panel);
      panel.value.textContent = shown(samples.columns[panel.index]?.[last], panel.unit, panel.channel.places);
    }
    points?.set(asPoints([{ x: columnOf(choice.x), y: columnOf(choice.y) }]));
    about.commands.forEach((one, index) => {
      const cell = commands.children[index]?.lastElementChild;
      if (cell && !state?.ended) cell.textContent = hand.watched ? hand.outputs[one.name] ?? "–" : position(one, samples.columns[1 + about.channels.length + index]?.[last]);
    });
    if (samples.newest !== null) {
      drawnAt.push([samples.newest, (performance.timeOrigin + performance.now()) / 1000]);
      if (drawnAt.length > 3000) drawnAt.splice(0, 1000);
    }
  };
  const frame = () => {
    redraw();
    setTimeout(() => requestAnimationFrame(frame), 30);
  };
  frame();

  const showState = () => {
    if (!about) return;
    stateTag.replaceChildren(tag(state.state ?? "unknown"));
    progress.value = state.ended && state.state === "finished" ? 1 : state.progress ?? 0;
    const record = state.records_total ? `record ${Math.min(state.records_done + (state.record >= 0 ? 1 : 0), state.records_total)} of ${state.records_total}` : "";
    const rest = state.ended || state.time_left === null ? "" : `about ${clock(state.time_left)} left`;
    left.textContent = [`${Math.round(100 * progress.value)} %`, record, `${clock(state.time)} so far`, rest].filter(Boolean).join(" · ");
    const reason = state.ended && state.message ? state.message : "";
    const unsafe = state.unconfirmed ? `OUTPUTS NOT CONFIRMED SAFE: ${state.unconfirmed} may still be on. Switch it off by hand, at its supply.` : "";
    why.hidden = !(reason || unsafe || state.silent);
    why.textContent = [unsafe, state.silent ? `The run's program has not been heard of for ${state.silent} s; 'Everything off' brings the bench to its safe state.` : "", reason].filter(Boolean).join(" ");
    question.hidden = !state.question;
    const text = state.question ? `The operator is asked: ${state.question.replace(/ ?\[Enter\]/, "")}` : "";
    if (asks.textContent !== text) asks.textContent = text;
    const confirms = /\[Enter\]$/.test(state.asked ?? "");
    reply.hidden = !state.remote || !/\]$/.test(state.asked ?? "");
    answer.hidden = confirms;
    done.textContent = confirms ? "Done" : "Answer";
    alarms.replaceChildren(...(state.alarms ?? []).map((text) => h("li", {}, text)));
    tree.replaceChildren(...(state.tree.length ? state.tree : state.label ? [{ depth: 0, label: state.label, stage: "current", note: "" }] : []).map((step) =>
      h("li", { class: step.stage, "data-depth": String(Math.min(step.depth, 6)), "aria-current": step.stage === "current" ? "step" : null }, step.label, step.note ? h("span", { class: "note" }, ` ${step.note}`) : null)));
    if (state.ended) {
      idleText();
      // the last samples may be from before the outputs were made safe
      about.commands.forEach((one, index) => {
        const cell = commands.children[index]?.lastElementChild;
        if (cell) cell.textContent = state.unconfirmed ? "not confirmed" : one.safe === null ? "–" : `${position(one, one.safe)} (safe)`;
      });
    }
    idle.hidden = !state.ended;
    buttons();
  };

  const showEvents = (list, complete) => {
    const lines = list.map((event) => h("li", { class: `event ${event.kind}${event.passed === false ? " missed" : ""}` },
      h("span", { class: "when" }, clock(event.time)), h("span", { class: "kind" }, event.kind), h("span", {}, event.text)));
    if (complete) events.replaceChildren();
    events.prepend(...lines.reverse());
    while (events.children.length > 300) events.lastElementChild.remove();
  };

  const idleText = async () => {
    const next = h("p", {}, h("a", { class: "button", href: "/procedure" }, "Start a procedure"), " ", run && about ? h("a", { class: "button", href: `/report?run=${encodeURIComponent(run)}` }, `Report of ${run}`) : null);
    idle.replaceChildren(h("p", { class: "finding" }, run && state?.ended ? `This run is over: ${state.state}.` : "Begin one here, or at a terminal."), next, command(run && about ? `rigctl report ${run}` : "rigctl run procedures/NAME.yaml --serve"));
  };

  const watch = (id) => {
    run = id;
    about = state = null;
    setPoints = [];
    samples.begin(0);
    events.replaceChildren();
    history.replaceState(null, "", id ? `?run=${encodeURIComponent(id)}` : location.pathname);
    line.want();
  };

  const showRuns = (ids) => {
    running = ids;
    chooser.hidden = running.length < 2;
    chooser.replaceChildren(...running.map((id) => h("option", { value: id, selected: id === run }, id)));
    // a finished run remains visible until the next one starts
    if (running.length && (!run || (state?.ended && !running.includes(run)))) watch(running[0]);
    if (!run) {
      idle.hidden = false;
      body.hidden = !hand.watched;
      title.textContent = "No run is in progress";
      subtitle.textContent = "What a bench does is shown here as soon as one begins.";
      stateTag.replaceChildren(tag("idle"));
      for (const one of [pause, goOn, abort]) one.hidden = true;
      idleText();
    }
    second.hidden = false;
    progress.hidden = left.hidden = !run;
  };

  const hear = (data) => {
    if (data instanceof ArrayBuffer) {
      if (about) samples.take(data, window_);
      dirty = true;
      return;
    }
    const message = typeof data === "string" ? JSON.parse(data) : data;
    if (message.kind === "runs") showRuns(message.runs);
    else if (message.kind === "lease") showLease(message.lease);
    else if (message.kind === "run") {
      about = message.run;
      if (!run) samples.begin(0);
      body.hidden = false;
      idle.hidden = Boolean(run);
      build();
    } else if (message.kind === "left") {
      about = null;
      body.hidden = true;
    } else if (message.kind === "state" && message.state.state) {
      state = message.state;
      showState();
    } else if (message.kind === "set_points") {
      setPoints = message.set_points;
      dirty = true;
    } else if (message.kind === "events") showEvents(message.events, message.whole);
    else if (message.kind === "rows") {
      samples.takeRows(message.rows, window_);
      dirty = true;
    } else if (message.kind === "dropped") {
      settle("dropped", "This window is too slow for all that comes: some of it is left out here, and none of it in the run.");
      setTimeout(() => settle("dropped", null), 5000);
    } else if (message.kind === "refused") settle("refused", message.refused);
  };

  const fromBench = (message) => {
    if (message.kind === "bench" && run) {
      why.hidden = !state?.unconfirmed; // the readings may be those of another bench
      question.hidden = true;
      alarms.replaceChildren();
      watch(null);
      showRuns(running);
      return true;
    }
    if (!run) hear(message);
    return false;
  };
  const hand = byHand(fromBench, () => !run || Boolean(state?.ended));
  container.replaceChildren(head, hand.alert, idle, hand.element, body);
  const width = () => Math.round(panels[0]?.plot.element.clientWidth || container.clientWidth / 2 || 600);
  const line = new Line(hear, () => ({ run, window: window_, width: width() }));
  let resized = null;
  addEventListener("resize", () => {
    clearTimeout(resized);
    resized = setTimeout(() => line.want(), 300);
  });
  document.addEventListener("visibilitychange", () => !document.hidden && line.want());
  showLease(lease);
  showRuns([]);
};
