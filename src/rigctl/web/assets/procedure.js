// A procedure: its text, checked while typing; a drawing of its plan; its start.
import { api, button, clock, command, complain, h, say, scrolling, seldom, tag, word } from "./lib.js";

const SVG = "http://www.w3.org/2000/svg";
const svg = (name, attributes, ...inside) => {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, String(value));
  element.append(...inside);
  return element;
};

// Completions at the caret: names with descriptions, and the length of the typed part.
export const suggestions = (known, text, caret) => {
  const before = text.slice(0, caret);
  const line = before.slice(before.lastIndexOf("\n") + 1);
  const typed = /[\w]*$/.exec(line)[0];
  const head = line.slice(0, line.length - typed.length);
  const named = (names) => Object.entries(names ?? {}).filter(([name]) => name.startsWith(typed) && name !== typed);
  // inside braces on this line: the fields of the key before them
  let depth = 0;
  for (let at = head.length - 1; at >= 0; at--) {
    if (head[at] === "}") depth += 1;
    else if (head[at] === "{" && depth-- === 0) {
      if (!/[{,]\s*$/.test(head)) return { typed, entries: [] };
      const key = /(\w+)\s*:\s*$/.exec(head.slice(0, at))?.[1];
      return { typed, entries: named(known.fields[key]) };
    }
  }
  if (!/^\s*(- )?\s*$/.test(head)) return { typed, entries: [] };
  if (/^\s*- \s*$/.test(head)) return { typed, entries: named(known.steps) };
  const indent = head.length;
  for (const above of before.slice(0, before.length - line.length).split("\n").reverse()) {
    if (!above.trim() || above.trim().startsWith("#")) continue;
    const [, spaces, dash, key] = /^(\s*)(- )?(\w+)\s*:/.exec(above) ?? [];
    if (key === undefined) continue;
    const column = spaces.length + (dash ? dash.length : 0);
    if (column === indent && dash) return { typed, entries: named(known.beside[key]) };
    if (column < indent) return { typed, entries: named(known.fields[key]) };
  }
  return { typed, entries: named(indent ? {} : known.fields[""]) };
};

// A drawing of the plan: time to the right, nesting downwards.
const timeline = (plan, room, jump) => {
  const total = plan.duration || 1;
  const [width, row] = [Math.max(room, 480), 22];
  const boxes = [];
  let deepest = 0;
  const lay = (node, start, end, depth) => {
    if ((end - start) / total > 0.004) deepest = Math.max(deepest, depth);
    if (depth >= 0) boxes.push({ node, start, end, depth });
    const inside = node.steps ?? [];
    const sum = inside.reduce((seconds, child) => seconds + (child.duration ?? 0), 0);
    const scale = sum > 0 ? Math.min((end - start) / sum, 1) : 0;
    let at = start;
    for (const child of inside) {
      const next = at + (child.duration ?? 0) * scale;
      if (next - at > total / 4000) lay(child, at, next, depth + 1);
      at = next;
    }
  };
  let at = 0;
  for (const root of plan.steps) {
    lay(root, at, at + (root.duration ?? 0), -1);
    at += root.duration ?? 0;
  }
  const x = (seconds) => (seconds / total) * width;
  const shapes = boxes.filter((box) => box.depth <= deepest).slice(0, 3000).map(({ node, start, end, depth }) => {
    const wide = Math.max(x(end) - x(start) - 0.6, 0.4);
    const title = `${node.label}: ${clock(node.duration)}${node.basis === "timed" ? "" : ", estimated"}`;
    const box = svg("g", { class: `box ${node.kind}` }, svg("title", {}, title), svg("rect", { x: x(start), y: depth * row, width: wide, height: row - 2, rx: Math.min(3, wide / 2) }));
    const letters = Math.floor(wide / 6.4) - 1;
    if (letters > 3) box.append(svg("text", { x: x(start) + 4, y: depth * row + 14.5 }, node.label.length > letters ? `${node.label.slice(0, letters - 1)}…` : node.label));
    box.addEventListener("click", () => jump(Number(/:(\d+):\d+$/.exec(node.where)?.[1])));
    return box;
  });
  const height = (deepest + 1) * row;
  const step = [1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1200, 1800, 3600, 7200, 14400, 36000, 86400].find((seconds) => total / seconds <= 10) ?? 172800;
  const marks = [];
  for (let mark = 0; mark <= total; mark += step) marks.push(svg("g", { class: "mark" }, svg("line", { x1: x(mark), x2: x(mark), y1: 0, y2: height }), svg("text", { x: x(mark) + 2, y: height + 13 }, clock(mark))));
  return h("div", { class: "scroll timeline", tabindex: "0", role: "img", "aria-label": `The plan over time, ${clock(total)} long` },
    svg("svg", { viewBox: `0 0 ${width} ${height + 18}`, width, height: height + 18 }, ...marks, ...shapes));
};

export const show = async (container) => {
  const [{ files }, known] = await Promise.all([api("/api/procedure"), api("/api/procedure/completion")]);
  let file = { path: "", text: "", sha256: "" };
  let checked = null;

  const choose = h("select", { id: "file", onchange: () => open(choose.value) }, files.map((name) => h("option", { value: name }, name)));
  const area = h("textarea", { id: "text", spellcheck: "false", wrap: "off", autocapitalize: "off", autocomplete: "off", "aria-label": "The procedure's text", "aria-describedby": "wrong", "aria-autocomplete": "list", "aria-controls": "offers" });
  const gutter = h("pre", { class: "gutter", "aria-hidden": "true" });
  const offers = h("ul", { class: "offers", id: "offers", role: "listbox", hidden: true });
  const wrong = h("ul", { class: "wrong", id: "wrong", "aria-live": "polite" });
  const saved = h("span", { class: "note", role: "status" });
  const plan = h("div", { class: "plan" });
  const begin = h("section", { class: "panel begin", "aria-label": "Start" });

  const save = button("Save", async () => {
    const saved = await api("/api/procedure/save", { method: "POST", body: { path: file.path, text: area.value, sha256: file.sha256 } });
    file = { ...file, text: area.value, sha256: saved.sha256 };
    status();
  });
  const saveAs = button("Save as…", async () => {
    const name = window.prompt("The new file, under procedures/", file.path.replace(/\.yaml$/, "-copy.yaml"));
    if (!name) return;
    const saved = await api("/api/procedure/save", { method: "POST", body: { path: name, text: area.value, sha256: "" } });
    file = { path: name, text: area.value, sha256: saved.sha256 };
    choose.append(h("option", { value: name, selected: true }, name));
    address();
    status();
  });

  const jump = (line, column = 1) => {
    if (!line) return;
    const lines = area.value.split("\n");
    const at = lines.slice(0, line - 1).reduce((length, one) => length + one.length + 1, 0) + column - 1;
    area.focus();
    area.setSelectionRange(at, at + Math.max((lines[line - 1] ?? "").length - column + 1, 0));
    area.scrollTop = Math.max((line - 6) * lineHeight(), 0);
  };
  const lineHeight = () => Number.parseFloat(getComputedStyle(area).lineHeight);

  const status = () => {
    const changed = area.value !== file.text;
    saved.textContent = changed ? "changed, not saved" : "";
    save.disabled = !changed;
    showBegin();
  };
  addEventListener("beforeunload", (event) => area.value !== file.text && event.preventDefault());

  const number = (bad = new Map()) => {
    const count = area.value.split("\n").length;
    gutter.replaceChildren(...Array.from({ length: count }, (_, at) => h("span", { class: bad.has(at + 1) ? "bad" : "", title: bad.get(at + 1) }, `${at + 1}\n`)));
    gutter.scrollTop = area.scrollTop;
  };

  let latest = 0;
  const check = async () => {
    const now = ++latest;
    let outcome;
    try {
      outcome = await api("/api/procedure/check", { method: "POST", body: { path: file.path, text: area.value } });
    } catch (problem) {
      if (now === latest) wrong.replaceChildren(h("li", {}, problem.message));
      return;
    }
    if (now !== latest) return;
    checked = outcome;
    const lineOf = (error) => (error.line && (!error.file || error.file.endsWith(file.path)) ? error.line : null);
    const text = (error) => [error.what, error.value === null ? "" : `got '${error.value}'`, error.expected ? `expected ${error.expected}` : "", error.nearest ? `did you mean '${error.nearest}'?` : "", error.hint ?? ""].filter(Boolean).join("; ");
    const bad = new Map(outcome.errors.filter(lineOf).map((error) => [lineOf(error), text(error)]));
    number(bad);
    wrong.replaceChildren(...outcome.errors.map((error) => h("li", {}, lineOf(error) ? h("button", { type: "button", class: "sort", onclick: () => jump(error.line, error.column ?? 1) }, `Line ${error.line}`) : h("span", {}, error.file ?? "file"), ` ${text(error)}`)));
    area.setAttribute("aria-invalid", String(outcome.errors.length > 0));
    if (outcome.plan) showPlan(outcome.plan);
    plan.classList.toggle("stale", !outcome.plan);
    showBegin();
  };
  const checkSoon = seldom(check, 350);

  const limit = (one) => {
    const bound = one.above ?? one.below;
    const kind = { clear: "finished", approached: "paused", touched: "failed" }[one.state];
    const state = tag(kind ?? "");
    state.textContent = one.state;
    return h("tr", {}, h("th", {}, one.name.replaceAll("_", " ")), h("td", { class: "words" }, `${one.channel.replaceAll("_", " ")} ${one.above === undefined ? "below" : "above"} ${Number(bound?.toPrecision(4))} ${one.unit}: ${one.action}s`), h("td", {}, one.closest === null ? "–" : `${Number(one.closest.toPrecision(4))} ${one.unit}`), h("td", {}, state));
  };

  const showPlan = (forecast) => {
    const facts = [[clock(forecast.duration), forecast.open_ended ? "at least" : forecast.duration_basis === "timed" ? "long" : "long, estimated"], [String(forecast.records), forecast.records === 1 ? "record" : "records"], [forecast.samples.toLocaleString("en"), "samples"], [forecast.rig, "rig"]];
    plan.replaceChildren(
      h("ul", { class: "figures" }, facts.map(([value, name]) => h("li", {}, h("b", {}, value), name))),
      timeline(forecast, plan.clientWidth, jump),
      h("ul", { class: "warnings" }, forecast.warnings.map((warning) => h("li", {}, warning.message))),
      h("details", { open: true }, h("summary", {}, "Limits, and how near the plan comes"), scrolling("Limits", h("table", { class: "numbers" }, h("thead", {}, h("tr", {}, ["Limit", "Trips", "Nearest", "Plan"].map((title) => h("th", {}, title)))), h("tbody", {}, forecast.limits.map(limit))))),
      command(`rigctl check ${word(file.path)}`),
    );
  };

  const inputs = { bench: "simulated", speed: "1x", seed: "", rig: "", operator: "", serial_number: "", part: "" };
  const field = (name, label, more = {}) => {
    const input = h("input", { type: "text", id: `start-${name}`, value: inputs[name], autocomplete: "off", oninput: () => { inputs[name] = input.value; ready(); }, ...more });
    return [h("label", { for: `start-${name}` }, label), input];
  };
  let ready = () => {};
  const showBegin = () => {
    const rig = checked?.plan?.rig ?? "";
    const demands = checked?.demands ?? [];
    const usable = Boolean(checked?.plan) && area.value === file.text;
    const real = inputs.bench === "real";
    const radio = (value, label) => h("label", { class: "radio" }, h("input", { type: "radio", name: "bench", value, checked: inputs.bench === value, onchange: () => { inputs.bench = value; showBegin(); } }), ` ${label}`);
    const go = button(real ? `Start on ${rig || "the bench"}` : "Simulate", async () => {
      const launch = await api("/api/procedure/start", { method: "POST", body: { path: file.path, ...inputs, seed: inputs.seed === "" ? null : inputs.seed } });
      location.assign(inputs.bench === "simulated" && inputs.speed === "max" ? `/runs?run=${encodeURIComponent(launch.run)}` : `/live?run=${encodeURIComponent(launch.run)}`);
    }, { class: real ? "danger solid" : "primary" });
    ready = () => {
      go.disabled = !usable || (real && (inputs.rig.trim() !== rig || demands.some((name) => !inputs[name]?.trim())));
    };
    const identity = ["operator", "serial_number", "part"].flatMap((name) => field(name, `${name.replaceAll("_", " ")}${demands.includes(name) ? " (demanded)" : ""}`));
    const focused = document.activeElement?.id;
    begin.replaceChildren(
      h("h2", {}, "Start"),
      h("div", { class: "radios", role: "radiogroup", "aria-label": "Which bench" }, radio("simulated", "simulated bench"), radio("real", "real bench")),
      real
        ? h("div", { class: "fields" }, h("p", { class: "note" }, "Outputs will move. Questions are answered on the page Live."), ...field("rig", `Type the rig's name, ${rig}`), ...identity)
        : h("div", { class: "fields" },
            h("label", { for: "speed" }, "Speed"),
            h("select", { id: "speed", onchange: (event) => { inputs.speed = event.target.value; showBegin(); } }, [["1x", "in real time"], ["10x", "ten times as fast"], ["max", "as fast as it computes"]].map(([value, label]) => h("option", { value, selected: inputs.speed === value }, label))),
            ...field("seed", "Seed of the noise", { inputmode: "numeric", placeholder: "the rig file's" })),
      h("p", { class: "note" }, usable ? "" : checked && !checked.plan ? "Not while something is wrong in the text." : area.value === file.text ? "" : "Save the text first: what is carried out is the file."),
      go,
      command(real ? `rigctl run ${word(file.path)}` : `rigctl simulate ${word(file.path)} --speed ${inputs.speed}${inputs.seed === "" ? "" : ` --seed ${inputs.seed}`}`),
    );
    if (focused) document.getElementById(focused)?.focus();
    ready();
  };

  // --- what the editor offers --------------------------------------------------------------------------------
  let offered = [];
  let marked = 0;
  const hide = () => {
    offers.hidden = true;
    offered = [];
    area.removeAttribute("aria-activedescendant");
  };
  const offer = (always) => {
    const { typed, entries } = suggestions(known, area.value, area.selectionStart);
    if (area.selectionStart !== area.selectionEnd || !entries.length || (!always && !typed)) return hide();
    offered = entries.slice(0, 12).map(([name]) => ({ name, typed }));
    marked = 0;
    offers.replaceChildren(...entries.slice(0, 12).map(([name, about], at) => h("li", { id: `offer-${at}`, role: "option", onmousedown: (event) => { event.preventDefault(); accept(at); } }, h("code", {}, name), h("span", { class: "note" }, about))));
    const before = area.value.slice(0, area.selectionStart).split("\n");
    const style = getComputedStyle(area);
    const letter = h("span", { class: "letter" }, "0".repeat(20));
    area.parentElement.append(letter);
    const wide = letter.getBoundingClientRect().width / 20;
    letter.remove();
    offers.style.left = `${Math.min(area.offsetLeft + Number.parseFloat(style.paddingLeft) + (before[before.length - 1].length - typed.length) * wide - area.scrollLeft, Math.max(area.offsetWidth - 220, 0))}px`;
    offers.style.top = `${area.offsetTop + Number.parseFloat(style.paddingTop) + before.length * lineHeight() - area.scrollTop}px`;
    offers.hidden = false;
    mark(0);
  };
  const mark = (at) => {
    marked = (at + offered.length) % offered.length;
    [...offers.children].forEach((one, index) => one.setAttribute("aria-selected", String(index === marked)));
    area.setAttribute("aria-activedescendant", `offer-${marked}`);
  };
  const accept = (at) => {
    const { name, typed } = offered[at];
    area.setRangeText(`${name.slice(typed.length)}: `, area.selectionStart, area.selectionEnd, "end");
    hide();
    changed();
  };
  const changed = () => {
    number();
    status();
    checkSoon();
  };
  area.addEventListener("input", () => {
    changed();
    offer(false);
  });
  area.addEventListener("scroll", () => {
    gutter.scrollTop = area.scrollTop;
    hide();
  });
  area.addEventListener("blur", hide);
  area.addEventListener("keydown", (event) => {
    if (event.key === " " && event.ctrlKey) {
      event.preventDefault();
      offer(true);
    } else if (event.key === "s" && (event.ctrlKey || event.metaKey)) {
      event.preventDefault();
      save.click();
    } else if (!offers.hidden) {
      if (event.key === "ArrowDown" || event.key === "ArrowUp") mark(marked + (event.key === "ArrowDown" ? 1 : -1));
      else if (event.key === "Enter" || event.key === "Tab") accept(marked);
      else if (event.key === "Escape") hide();
      else return;
      event.preventDefault();
    }
  });

  const address = () => history.replaceState(null, "", `?file=${encodeURIComponent(file.path)}`);
  const open = async (path) => {
    if (area.value !== file.text && !window.confirm("The text was changed and not saved. Read another file all the same?")) {
      choose.value = file.path;
      return;
    }
    file = await api("/api/procedure/file", { query: { path } });
    area.value = file.text;
    checked = null;
    choose.value = path;
    address();
    number();
    status();
    await check();
  };

  container.replaceChildren(
    h("div", { class: "toolbar" }, h("label", { for: "file" }, "File"), choose, save, saveAs, saved, h("span", { class: "note push keys" }, "Ctrl Space completes, Ctrl S saves")),
    h("div", { class: "procedure" },
      h("div", {}, h("div", { class: "editor" }, gutter, area, offers), wrong),
      h("div", { class: "right-side" }, h("section", { class: "panel", "aria-label": "Plan" }, h("h2", {}, "Plan"), plan), begin)),
  );
  if (!files.length) {
    container.replaceChildren(h("p", { class: "empty" }, "There are no procedures yet: a file procedures/NAME.yaml is one, and 'rigctl init' writes some."));
    return;
  }
  const wanted = new URLSearchParams(location.search).get("file");
  try {
    await open(files.includes(wanted) ? wanted : (files.find((name) => name.endsWith("quick-check.yaml")) ?? files[0]));
  } catch (problem) {
    complain(problem);
  }
  if (wanted && !files.includes(wanted)) say(`The project has no procedure ${wanted}.`, "warn");
};
