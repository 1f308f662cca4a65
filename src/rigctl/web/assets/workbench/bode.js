// The frequency response: the report's Bode plot, which follows the sliders while it is open.
import { command, h } from "../lib.js";
import { plot } from "../plot.js";
import { row } from "./frames.js";
import { keeper } from "./kept.js";

// What was chosen stays when another version of the model opens, and over a reload.
const { remembered, remember } = keeper("rigctl-workbench-response");
const chosen = { open: false, every: false, input: "", channel: "", ...remembered() };

const PIXELS = 112;
const numbers = (_, values) => values.map((value) => (value === null ? null : String(Number(value.toPrecision(3)))));
// The marks of a logarithmic axis that get numbers: 1, 2 and 5, of many decades 1 alone.
const numbered = (_, marks) => {
  const shown = marks.at(-1) > 1e3 * marks[0] ? [1] : [1, 2, 5];
  return marks.map((mark) => (shown.includes(Math.round(mark / 10 ** Math.floor(Math.log10(mark) + 1e-9))) ? mark : null));
};
// The edges of an interval: two faint curves, of which only the first has a name.
const bands = (traces) => traces.flatMap((one, k) => (k && one.faint && !one.name && traces[k - 1].faint ? [{ between: [k + 1, k] }] : []));

// A plot of the report by uPlot: its panels under each other, over one axis.
const makeFigure = ({ caption, x, log, panels }) => {
  const plots = panels.map((panel, k) => {
    const last = k === panels.length - 1;
    return plot({
      height: PIXELS * panel.height + (last ? 22 : 0),
      sync: "bode",
      logX: log,
      xName: x,
      xLabel: last ? x : "",
      xValues: log ? numbers : undefined,
      xFilter: log ? numbered : undefined,
      bands: bands(panel.traces),
      yLabel: panel.title,
      yRange: panel.range ?? undefined,
      ySpace: 24,
      describe: `${caption}: ${panel.title}`,
      legend: panel.traces.some((one) => one.listed && one.name),
      series: panel.traces.map((one) => ({
        label: one.name,
        colour: `--series-${one.colour + 1}`,
        width: one.faint ? 1 : 1.7,
        dash: one.faint ? [2, 3] : undefined,
        points: one.look === "marked" || one.look === "points",
        size: 6,
        unlisted: !one.listed || !one.name,
      })),
    });
  });
  return {
    element: h("div", { class: "bode" }, h("p", { class: "note" }, caption), ...plots.map((one) => one.element)),
    set: (arrays) => plots.forEach((one, k) => one.set(panels[k].traces.reduce((columns, _, j) => [...columns, row(arrays[`panel ${k}`], j + 1)], [row(arrays[`panel ${k}`], 0)]))),
    remove: () => plots.forEach((one) => one.remove()),
  };
};

// `ask` sends what is chosen to the server, which answers with this and each further picture.
export const makeBode = (opened, ask) => {
  const choices = (list) => list.map(({ name, title }) => h("option", { value: name }, title));
  const again = () => {
    remember(chosen);
    ask({ ...chosen });
  };
  const pick = (key, of) => (event) => {
    chosen[key] = of(event.target.value);
    again();
  };
  const input = h("select", { id: "bode-input", onchange: pick("input", String) }, ...choices(opened.inputs));
  const channel = h("select", { id: "bode-channel", onchange: pick("channel", String) }, ...choices(opened.channels));
  const which = h("select", { id: "bode-records", onchange: pick("every", (value) => value === "all") }, h("option", { value: "one" }, "the one above"), h("option", { value: "all" }, "all"));
  const says = h("p", { class: "statement" });
  const notes = h("ul", { class: "note" });
  const place = h("div");
  const equals = h("div");
  const none = h("p", {}, "No input moves in these records: they show no frequency response.");
  const shown = h("div", {},
    h("div", { class: "toolbar" },
      h("label", { for: "bode-input" }, "From"), input,
      h("label", { for: "bode-channel" }, "to"), channel,
      opened.records.length > 1 ? [h("label", { for: "bode-records" }, "Records"), which] : null),
    says, place, notes, equals);
  const element = h("details", { class: "response", open: chosen.open && !opened.over, hidden: Boolean(opened.over) }, h("summary", {}, "Frequency response"), opened.inputs.length ? shown : none);

  let figure = null;
  let drawn = "";
  const clear = () => {
    figure?.remove();
    figure = null;
    drawn = "";
    place.replaceChildren();
  };
  const set = (header, arrays, change) => {
    if (!element.open) return;
    chosen.input = input.value = header.input;
    chosen.channel = channel.value = header.channel;
    which.value = header.every ? "all" : "one";
    says.className = `statement ${header.tone}`;
    says.textContent = header.statement;
    notes.replaceChildren(...header.notes.map((text) => h("li", {}, text)));
    equals.replaceChildren(command([change, header.equals].filter(Boolean).join(" && ")));
    const described = JSON.stringify(header.plot);
    if (described !== drawn) {
      clear();
      if (header.plot) {
        figure = makeFigure(header.plot);
        place.append(figure.element);
        drawn = described;
      }
    }
    figure?.set(arrays);
    element.dataset.seq = header.seq ?? 0;
    element.dataset.settled = header.exact ? "yes" : "no";
  };
  const known = (list, name) => (list.some((one) => one.name === name) ? name : "");
  chosen.input = known(opened.inputs, chosen.input);
  chosen.channel = known(opened.channels, chosen.channel);
  const toggled = () => {
    chosen.open = element.open;
    again();
    if (!element.open) clear();
  };
  element.addEventListener("toggle", toggled);
  return {
    element, set,
    // the channel whose errors are shown is the first choice
    suggest: (name) => (chosen.channel ||= name),
    remove: clear,
  };
};
