// One quantity over another, as points: chosen from two lists, or by dragging a name onto a plot.
import { h } from "./lib.js";
import { plot } from "./plot.js";

// Make an element a name that can be dragged; the lists do the same without a mouse.
export const draggable = (element, name) => {
  element.draggable = true;
  element.title = `Drag it onto a plot to see one over the other`;
  element.addEventListener("dragstart", (event) => {
    event.dataTransfer.setData("text/rigctl-channel", name);
    event.dataTransfer.effectAllowed = "link";
  });
  return element;
};

// Call `taken(name, low)` when a name is dropped; low: in the lowest third, where the horizontal axis is.
export const dropPlace = (element, taken) => {
  const over = (on) => element.classList.toggle("drop", on);
  element.addEventListener("dragover", (event) => {
    if (!event.dataTransfer.types.includes("text/rigctl-channel")) return;
    event.preventDefault();
    over(true);
  });
  element.addEventListener("dragleave", () => over(false));
  element.addEventListener("drop", (event) => {
    over(false);
    const name = event.dataTransfer.getData("text/rigctl-channel");
    if (!name) return;
    event.preventDefault();
    const box = element.getBoundingClientRect();
    taken(name, event.clientY > box.top + (2 * box.height) / 3);
  });
  return element;
};

// Points of several series, each {x, y}, in the form of uPlot: ascending x, and a gap where a series has no point.
export const asPoints = (series) => {
  const points = series.flatMap(({ x, y }, at) => x.map((value, k) => [value, at, y[k]])).filter(([x, , y]) => Number.isFinite(x) && Number.isFinite(y));
  points.sort((one, other) => one[0] - other[0]);
  return [points.map(([x]) => x), ...series.map((_, at) => points.map(([, of, y]) => (of === at ? y : null)))];
};

const title = ({ name, unit }) => `${name.replaceAll("_", " ")}${unit && unit !== "1" ? ` [${unit}]` : ""}`;

// quantities: [{ name, unit }]. `changed(y, x)` is called with the names; x is "" for none or the first of `along`.
export const makeChoice = (quantities, along, changed) => {
  const id = crypto.randomUUID();
  const options = () => quantities.map((one) => h("option", { value: one.name }, title(one)));
  const y = h("select", { id: `y-${id}` }, options());
  const x = h("select", { id: `x-${id}` }, h("option", { value: "" }, along), options());
  const say = () => changed(y.value, x.value);
  y.addEventListener("change", say);
  x.addEventListener("change", say);
  return {
    element: h("span", { class: "labelled" }, h("label", { for: `y-${id}` }, "Plot"), y, h("label", { for: `x-${id}` }, "over"), x),
    show: (toY, toX) => {
      y.value = toY ?? y.value;
      x.value = toX ?? x.value;
    },
    set(toY, toX) {
      this.show(toY, toX);
      say();
    },
    get y() {
      return y.value;
    },
    get x() {
      return x.value;
    },
    title: (name) => title(quantities.find((one) => one.name === name) ?? { name }),
  };
};

// A plot of points with its axes named; `series` as those of plot.js.
export const pointPlot = (choice, series, more = {}) =>
  plot({
    height: 260, xLabel: choice.title(choice.x), yLabel: choice.title(choice.y), xName: choice.x, describe: `${choice.title(choice.y)} over ${choice.title(choice.x)}`,
    series: series.map((one) => ({ width: 0, points: true, size: 4, ...one })), ...more,
  });
