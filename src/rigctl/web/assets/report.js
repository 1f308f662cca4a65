// The report of one or more runs, in a sandboxed frame.
import { api, button, command, h, wait, word, work } from "./lib.js";

export const show = async (container) => {
  const query = new URLSearchParams(location.search);
  let runs = query.getAll("run");
  const { models } = await api("/api/report/models");
  const names = h("p", { class: "note chosen-runs" });
  const model = h("select", { id: "model" }, h("option", { value: "" }, "no model"), models.map((name) => h("option", { value: name, selected: query.get("model") === name }, name)));
  const diagnose = h("input", { type: "checkbox", id: "diagnose", checked: query.has("diagnose") });
  const progress = h("div");
  const standsFor = h("div");
  const frame = h("div", { class: "made" });

  const make = async () => {
    const body = { runs, models: model.value ? [model.value] : [], diagnose: diagnose.checked && Boolean(model.value) };
    const line = ["rigctl report", ...runs, ...(model.value ? ["--model", word(model.value)] : []), ...(body.diagnose ? ["--diagnose"] : [])].join(" ");
    standsFor.replaceChildren(command(line));
    progress.replaceChildren();
    const job = await api("/api/report", { method: "POST", body });
    try {
      await work(progress, job);
    } catch (problem) {
      frame.replaceChildren(h("p", { class: "statement bad" }, problem.message));
      return;
    }
    frame.replaceChildren(h("iframe", { class: "report", title: `Report of ${runs.join(", ")}`, src: `/report/made/${job.id}`, sandbox: "allow-scripts allow-downloads allow-popups" }));
    frame.dataset.made = job.id;
  };

  model.addEventListener("change", () => (diagnose.disabled = !model.value));
  diagnose.disabled = !model.value;
  container.replaceChildren(
    h("div", { class: "toolbar" }, names, h("label", { for: "model" }, "Compared with"), model,
      h("label", {}, diagnose, " and say what it lacks"), button("Make it again", make, { class: "primary" })),
    standsFor, progress, frame);

  if (!runs.length) {
    const newest = await api("/api/runs", { query: { count: 1 } });
    runs = newest.runs.map((run) => run.id);
  }
  if (!runs.length) {
    frame.replaceChildren(h("p", { class: "empty" }, "There are no runs yet."));
    return;
  }
  names.replaceChildren(h("strong", {}, runs.length === 1 ? runs[0] : `${runs.length} runs`), " ", h("a", { href: "/runs" }, "choose others"));
  names.title = runs.join(", ");
  const begin = async () => {
    // a run in progress has no report yet
    while (runs.length === 1 && (await api(`/api/runs/${encodeURIComponent(runs[0])}`)).status === "running") {
      frame.replaceChildren(h("p", { class: "statement" }, "This run is in progress: its report is made as soon as it is over. ", h("a", { href: "/live" }, "Watch it")));
      await wait(2000);
    }
    frame.replaceChildren();
    await make();
  };
  begin().catch((problem) => frame.replaceChildren(h("p", { class: "statement bad" }, problem.message)));
};
