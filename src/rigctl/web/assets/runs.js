// The catalogue: searched, sorted and paged by the server; one run beside it; two campaigns overlaid.
import { api, button, clock, command, h, sameAs, say, scrolling, seldom, tag, wait, word, work } from "./lib.js";
import { plot } from "./plot.js";
import { asPoints, draggable, dropPlace, makeChoice, pointPlot } from "./xy.js";

const PAGE = 50;
const COLUMNS = [
  ["started", "Run", "id"],
  ["status", "Status"],
  ["procedure", "Procedure"],
  ["rig", "Rig"],
  ["duration", "Duration"],
  ["records", "Records"],
  ["notes", "Notes"],
];

const count = (number, one, more = `${one}s`) => `${number.toLocaleString("en")} ${number === 1 ? one : more}`;
const figure = (value, digits = 5) => (typeof value === "number" ? Number(value.toPrecision(digits)).toString() : String(value));
const apart = (value) => figure(value, 3);
const bench = ({ kind, name, seed, ...rest }) => [kind, ...Object.entries(rest).map(([key, value]) => `${key.replaceAll("_", " ")} ${value}`)].filter(Boolean).join(", ");
const moment = (text) => (text ? text.replace("T", " ").slice(0, 16) : "");

// A project without runs: README's first steps, the first of them by a click.
const PUBLISHED = { file: "data/hl32-strokes.csv", rig: "rigs/hl32-bench.yaml" };
const MODEL = "models/hl32-textbook.yaml";
const firstSteps = async (place) => {
  const { files } = await api("/api/workbench/choices");
  if (!files.includes(PUBLISHED.file)) return;
  const jobs = h("div", { class: "jobs", "aria-live": "polite" });
  const bring = button("Bring in the published strokes", async () => {
    await work(jobs, await api("/api/workbench/import", { method: "POST", body: { ...PUBLISHED, assume: [] } }));
    location.assign("/workbench");
  }, { class: "primary" });
  place.replaceChildren(h("section", { class: "panel beginning", "aria-label": "First steps" },
    h("h2", {}, "First steps"),
    h("p", {}, "The strokes of a hydraulic cylinder fall as its oil warms; the textbook's model says that they rise. Which effect does it lack?"),
    h("ol", {},
      h("li", {}, "Bring in the eight strokes that were published. The workbench opens with them and the textbook's model.", command(`rigctl import ${PUBLISHED.file} --rig ${PUBLISHED.rig}`)),
      h("li", {}, "There, compare: the model has the wrong direction.", command(`rigctl compare latest --model ${MODEL}`)),
      h("li", {}, "Diagnose: several effects explain it, and the answer says which measurement would decide.", command(`rigctl diagnose latest --model ${MODEL}`)),
      h("li", {}, "Simulate that measurement on the page ", h("a", { href: "/procedure" }, "Procedure"), ", strokes over time with one of the effects hidden, and diagnose again.")),
    h("div", { class: "toolbar" }, bring, jobs)));
};

export const show = async (container) => {
  const query = { search: "", where: "", sort: "started", order: "down", first: 0 };
  const chosen = new Set();

  const search = h("input", { type: "search", id: "search", placeholder: "Name, rig, person, serial number", oninput: () => ask({ search: search.value, first: 0 }) });
  const where = h("input", { type: "text", id: "where", size: 34, placeholder: "records > 20 AND status = 'finished'", spellcheck: "false", onchange: () => load({ where: where.value, first: 0 }) });
  const stated = h("p", { class: "note count", role: "status" });
  const body = h("tbody");
  const head = h("tr");
  const pager = h("div", { class: "pager" });
  const elsewhere = h("div");
  const steps = h("div");
  const actions = h("div", { class: "actions" });
  const side = h("aside", { class: "side", "aria-label": "The run that was chosen" });
  const below = h("div", { class: "below" });
  const standsFor = h("div");

  container.replaceChildren(
    steps,
    h("div", { class: "toolbar" },
      h("span", { class: "labelled" }, h("label", { for: "search" }, "Find"), search),
      h("span", { class: "labelled" }, h("label", { for: "where" }, "Where"), where),
      stated, actions),
    h("div", { class: "split" },
      h("div", {},
        scrolling("Runs", h("table", { class: "runs" }, h("caption", { class: "hidden" }, "Runs"), h("thead", {}, head), body)),
        pager, elsewhere, standsFor),
      side),
    below,
  );

  const showHead = () =>
    head.replaceChildren(
      h("th", { class: "pick" }, h("span", { class: "hidden" }, "Choose")),
      ...COLUMNS.map(([key, title]) => {
        const sorted = query.sort === key;
        const turn = () => load({ sort: key, order: sorted && query.order === "down" ? "up" : "down", first: 0 });
        const arrow = sorted ? (query.order === "down" ? " ↓" : " ↑") : "";
        return h("th", { "aria-sort": sorted ? (query.order === "down" ? "descending" : "ascending") : "none" }, h("button", { type: "button", class: "sort", onclick: turn }, title + arrow));
      }),
    );

  const showActions = () => {
    const ids = [...chosen];
    actions.replaceChildren(
      ...(ids.length
        ? [
            h("span", { class: "note" }, count(ids.length, "run chosen", "runs chosen")),
            button("Compare", () => compare(ids), { disabled: ids.length !== 2, title: "Two campaigns over each other" }),
            button("Overlay", () => overlay(ids), { disabled: ids.length > 8, title: "These runs over each other" }),
            h("a", { class: "button", href: `/report?${ids.map((id) => `run=${encodeURIComponent(id)}`).join("&")}` }, "Report"),
            button("None", () => {
              chosen.clear();
              for (const box of body.querySelectorAll("input")) box.checked = false;
              showActions();
            }, { class: "small", "aria-label": "Choose none" }),
          ]
        : []),
    );
  };

  const line = (run) => {
    const box = h("input", {
      type: "checkbox", "aria-label": `Choose ${run.id}`, checked: chosen.has(run.id),
      onchange: () => {
        if (box.checked) chosen.add(run.id);
        else chosen.delete(run.id);
        showActions();
      },
    });
    const complete = run.complete_records === run.records;
    const records = run.records === null ? "" : `${complete ? run.records : `${run.complete_records} of ${run.records}`}${run.excluded ? `, ${run.excluded} excluded` : ""}`;
    return h("tr", { "data-run": run.id },
      h("td", { class: "pick" }, box),
      h("td", {}, h("a", { href: `?run=${encodeURIComponent(run.id)}`, onclick: (event) => open(event, run.id) }, run.id), h("span", { class: "change" }, [moment(run.started), run.serial_number, run.operator].filter(Boolean).join(" · "))),
      h("td", {}, tag(run.status), run.test && run.test !== "none" ? [" ", tag(run.test)] : null, run.unconfirmed ? [" ", tag("outputs not confirmed safe")] : null),
      h("td", {}, run.procedure), h("td", {}, run.rig),
      h("td", { class: "right" }, clock(run.duration)), h("td", { class: "right" }, records),
      h("td", { class: "right" }, run.notes ? String(run.notes) : ""));
  };

  let latest = 0;
  const load = async (change = {}) => {
    Object.assign(query, change);
    const number = ++latest;
    let listing;
    try {
      listing = await api("/api/runs", { query: { ...query, count: PAGE } });
    } catch (problem) {
      if (number === latest) say(problem.message, "bad");
      return;
    }
    if (number !== latest) return; // a later request was answered first
    showHead();
    // whoever has come to a run by the keyboard stays there while the list is drawn anew
    const at = document.activeElement, row = body.contains(at) ? at.closest("tr[data-run]") : null;
    body.replaceChildren(...listing.runs.map(line));
    if (row) body.querySelector(`tr[data-run="${CSS.escape(row.dataset.run)}"] ${at.localName}`)?.focus();
    if (!listing.runs.length) body.append(h("tr", {}, h("td", { class: "empty", colspan: COLUMNS.length + 1 }, listing.all ? "No run meets this." : "There are no runs yet: a simulation on the page Procedure makes one.")));
    if (listing.all) steps.replaceChildren();
    else if (!steps.childElementCount) firstSteps(steps).catch(() => {});
    stated.textContent = listing.found === listing.all ? count(listing.all, "run") : `${listing.found.toLocaleString("en")} of ${count(listing.all, "run")}`;
    elsewhere.replaceChildren(...(listing.store ? [h("p", { class: "note" }, `These are the runs on this computer. Those that lie in ${listing.store} alone are listed, and analysed, by commands.`), command("rigctl runs list")] : []));
    const last = Math.min(query.first + PAGE, listing.found);
    pager.replaceChildren(
      ...(listing.found > PAGE
        ? [
            button("Newer", () => load({ first: Math.max(query.first - PAGE, 0) }), { disabled: query.first === 0 }),
            h("span", { class: "note" }, `${(query.first + 1).toLocaleString("en")} to ${last.toLocaleString("en")}`),
            button("Older", () => load({ first: query.first + PAGE }), { disabled: last >= listing.found }),
          ]
        : []),
    );
    if (query.order === "up" && pager.children.length) [pager.children[0].textContent, pager.children[2].textContent] = ["Back", "On"];
    standsFor.replaceChildren(command(`rigctl runs list${query.where ? ` --where ${word(query.where)}` : ""}`));
    mark();
  };
  const ask = seldom(load, 150);

  let current = new URLSearchParams(location.search).get("run");
  const mark = () => {
    for (const row of body.children) row.classList.toggle("chosen", row.dataset.run === current);
  };
  const open = (event, id) => {
    if (event && (event.ctrlKey || event.metaKey || event.shiftKey)) return;
    event?.preventDefault();
    if (id !== current) history.pushState(null, "", `?run=${encodeURIComponent(id)}`);
    detail(id);
  };
  window.addEventListener("popstate", () => detail(new URLSearchParams(location.search).get("run")));

  const detail = async (id) => {
    current = id;
    mark();
    if (!id) return side.replaceChildren(h("p", { class: "empty" }, "Choose a run to see what it holds."));
    let run;
    try {
      run = await api(`/api/runs/${encodeURIComponent(id)}`);
    } catch (problem) {
      return side.replaceChildren(h("div", { class: "panel" }, h("p", { class: "statement bad" }, problem.message)));
    }
    const facts = {
      status: h("span", {}, tag(run.status), run.reason ? ` ${run.reason}` : ""),
      procedure: run.procedure, rig: run.rig, bench: bench(run.backend ?? {}),
      operator: run.operator, started: moment(run.started), duration: run.duration === null ? "" : clock(run.duration),
      samples: run.rows === null ? "" : run.rows?.toLocaleString("en"), seed: run.seed === null ? "" : String(run.seed),
      "serial number": run.device?.serial_number, part: run.device?.part,
    };
    const text = h("input", { type: "text", id: "note", placeholder: "new piston seals" });
    const note = async () => {
      await api(`/api/runs/${encodeURIComponent(id)}/notes`, { method: "POST", body: { text: text.value } });
      sameAs(`rigctl runs annotate ${id} ${word(text.value)}`);
      await detail(id);
      load();
    };
    side.replaceChildren(
      h("div", { class: "panel" },
        h("h2", {}, run.id),
        run.unconfirmed ? h("p", { class: "statement bad", role: "alert" }, `OUTPUTS NOT CONFIRMED SAFE: ${run.unconfirmed} may still be on. Look at the bench before you touch it.`) : null,
        run.test?.result === "fail" ? h("p", { class: "statement bad" }, `FAIL: ${run.test.missed} of ${run.test.passed + run.test.missed} measures outside their limits.`) : null,
        h("dl", { class: "facts" }, Object.entries(facts).filter(([, value]) => value).map(([name, value]) => h("div", {}, h("dt", {}, name), h("dd", {}, value)))),
        h("p", { class: "links" },
          run.status === "running"
            ? h("a", { class: "button", href: "/live" }, "Watch")
            : [h("a", { class: "button", href: `/report?run=${encodeURIComponent(id)}` }, "Report"), " ", h("a", { class: "button", href: `/workbench?run=${encodeURIComponent(id)}` }, "Workbench")]),
        run.records.length ? records(run, id) : null,
        h("h3", {}, "Notes"),
        run.annotations.length
          ? h("ul", { class: "notes" }, run.annotations.map((note) => h("li", {}, note.text, h("span", { class: "change" }, `${note.kind}${note.record === null ? "" : ` of record ${note.record}`}, ${note.by}, ${moment(note.when)}`))))
          : null,
        h("form", { class: "inline", onsubmit: (event) => { event.preventDefault(); note().catch((problem) => say(problem.message, "bad")); } },
          h("label", { class: "hidden", for: "note" }, "A note"), text, h("button", { type: "submit" }, "Add")),
        command(`rigctl runs show ${id}`)),
    );
    if (run.status === "running") lookAgain(id);
  };

  // a run in progress is refreshed until it ends
  const lookAgain = async (id) => {
    await wait(2000);
    if (current !== id) return;
    const { status } = await api(`/api/runs/${encodeURIComponent(id)}`).catch(() => ({ status: "running" }));
    if (current !== id) return;
    if (status === "running") return lookAgain(id);
    await detail(id);
    load();
  };

  const records = (run, id) => {
    const turn = async (record, undo) => {
      const reason = window.prompt(undo ? `Why take record ${record} back into analysis?` : `Why leave record ${record} out of analysis? The reason is kept with it.`);
      if (!reason) return;
      await api(`/api/runs/${encodeURIComponent(id)}/exclude`, { method: "POST", body: { record, reason, undo } });
      sameAs(`rigctl runs exclude ${id} ${record} --reason ${word(reason)}${undo ? " --undo" : ""}`);
      await detail(id);
      load();
    };
    return h("details", { open: run.records.length <= 30 },
      h("summary", {}, count(run.records.length, "record")),
      h("ul", { class: "records" }, run.records.map((record) =>
        h("li", { class: record.excluded ? "out" : "" },
          h("span", { class: "what" }, `${record.record} ${record.name}`, record.outcome === "complete" ? null : [" ", tag(record.outcome)],
            h("span", { class: "change" }, record.excluded ? `excluded: ${record.excluded}` : record.values.map((one) => `${one.name} ${figure(one.value)} ${one.unit}`.replace(/ 1$/, "")).join(", "))),
          button(record.excluded ? "Include" : "Exclude", () => turn(record.record, Boolean(record.excluded)), { class: "small", "aria-label": `${record.excluded ? "Include" : "Exclude"} record ${record.record}` })))),
      run.left_out ? h("p", { class: "note" }, `${run.left_out} more are not shown.`) : null);
  };

  const compare = async ([one, other]) => {
    const [first, second] = one < other ? [one, other] : [other, one];
    const difference = await api("/api/runs/difference", { query: { first, second } });
    const names = Object.keys(difference.channels);
    const channel = h("select", { id: "channel" }, names.map((name) => h("option", { value: name }, name)));
    const numbers = h("tbody");
    const caption = h("p", { class: "lead", role: "status" });
    const curves = h("div");
    let at = 0;
    const draw = () => {
      const name = channel.value;
      const unit = difference.channels[name];
      numbers.replaceChildren(...difference.conditions.map((condition, index) => {
        const values = condition.channels[name];
        const ratio = values && values.scatter ? values.rms / values.scatter : null;
        return h("tr", { class: index === at ? "chosen" : "" },
          h("th", {}, h("button", { type: "button", class: "sort", onclick: () => { at = index; draw(); } }, condition.label)),
          h("td", {}, condition.records.join(" and ")),
          h("td", {}, values ? apart(values.bias) : "–"), h("td", {}, values ? apart(values.rms) : "–"),
          h("td", {}, values?.scatter ? apart(values.scatter) : "–"), h("td", {}, ratio === null ? "–" : ratio.toFixed(1)));
      }));
      const values = difference.conditions[at].channels[name];
      caption.textContent = `${difference.conditions[at].label}: ${name}${values ? `, ${apart(values.rms)} ${unit} apart (root mean square)` : ": nothing measured"}`;
      curves.replaceChildren();
      if (!values) return;
      const drawn = plot({ height: 260, xLabel: "time [s]", yLabel: `${name} [${unit}]`, describe: caption.textContent, series: [{ label: difference.first }, { label: difference.second, colour: 1 }] });
      const below = plot({ height: 150, xLabel: "time [s]", yLabel: `difference [${unit}]`, describe: `the difference of the two curves of ${name}`, series: [{ label: "second minus first", colour: 2 }] });
      curves.append(drawn.element, below.element);
      drawn.set([values.time, ...values.curves]);
      below.set([values.time, values.curves[0].map((value, index) => (value === null || values.curves[1][index] === null ? null : values.curves[1][index] - value))]);
    };
    channel.addEventListener("change", draw);
    const more = [difference.only_first ? `${difference.only_first} conditions in the first alone` : "", difference.only_second ? `${difference.only_second} in the second alone` : ""].filter(Boolean).join(", ");
    below.replaceChildren(
      h("section", { class: "panel", id: "difference" },
        h("h2", {}, `${difference.second} minus ${difference.first}`),
        h("div", { class: "toolbar" }, h("label", { for: "channel" }, "Channel"), channel, more ? h("span", { class: "note" }, more) : null, button("Close", () => below.replaceChildren(), { class: "push small" })),
        h("div", { class: "pair" },
          scrolling("Differences", h("table", { class: "numbers" }, h("thead", {}, h("tr", {}, ["Condition", "Records", "Mean", "Rms", "Scatter", "Rms / scatter"].map((title) => h("th", {}, title)))), numbers)),
          h("div", {}, caption, curves))),
    );
    draw();
    document.getElementById("difference").scrollIntoView({ block: "nearest" });
  };

  // The chosen runs over each other: quantities from two lists, or dragged onto the plot.
  const overlay = async (ids) => {
    const runs = ids.toSorted();
    let choice = null;
    let data = null;
    const curves = h("div");
    const caption = h("p", { class: "lead", role: "status" });
    const same = h("div");
    const key = h("ul", { class: "key" }, runs.map((id, at) => h("li", { class: `curve-${at % 4}` }, id)));
    const names = h("ul", { class: "quantities", "aria-label": "Quantities, to be dragged onto the plot" });
    const draw = () => {
      const { y, x, kind, series, left_out: out } = data;
      caption.textContent = `${choice.title(y)} over ${x ? choice.title(x) : kind === "curves" ? "time in the record [s]" : "number of the record"}${out ? `; ${out} more records are not drawn` : ""}`;
      const look = series.map((one) => ({ label: one.run, colour: runs.indexOf(one.run) % 4, dash: runs.indexOf(one.run) > 3 ? [6, 4] : undefined }));
      const axes = { height: 340, legend: false, describe: caption.textContent, yLabel: choice.title(y), xLabel: x ? choice.title(x) : kind === "curves" ? "time in the record [s]" : "record" };
      const drawn = kind === "curves" ? plot({ ...axes, series: look.map((one) => ({ width: 1.2, ...one })) }) : pointPlot(choice, look.map((one) => ({ ...one, size: kind === "records" ? 8 : 4 })), axes);
      curves.replaceChildren(dropPlace(drawn.element, (name, low) => (low ? choice.set(null, name) : choice.set(name, null))));
      if (series.length) drawn.set(kind === "curves" ? [series[0].x, ...series.map((one) => one.y)] : asPoints(series));
      same.replaceChildren(command(data.command));
    };
    let asked = 0;
    const fetchData = async (y, x) => {
      const own = ++asked;
      const answer = await api("/api/runs/overlay", { query: { runs: runs.join(","), y, x } });
      if (own === asked) data = answer; // one that took longer does not replace a later choice
    };
    const change = (y, x) => fetchData(y, x).then(draw).catch((problem) => say(problem.message, "bad"));
    await fetchData("", "");
    choice = makeChoice(data.quantities, "time or number", change);
    choice.show(data.y, data.x);
    names.replaceChildren(...data.quantities.map((one) => h("li", {}, draggable(h("span", {}, choice.title(one.name)), one.name))));
    below.replaceChildren(
      h("section", { class: "panel", id: "overlay", "aria-label": "Runs over each other" },
        h("h2", {}, runs.length > 1 ? `${runs.length} runs over each other` : runs[0]),
        h("div", { class: "toolbar" }, choice.element, button("Close", () => below.replaceChildren(), { class: "push small" })),
        names, caption, curves, key, same),
    );
    draw();
    document.getElementById("overlay").scrollIntoView({ block: "nearest" });
  };

  await load();
  await detail(current);
};
