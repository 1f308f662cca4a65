// Measured and modelled curves overlaid, with the residual below in units of the noise, and the noise in both.
import { h } from "../lib.js";
import { plot } from "../plot.js";
import { row } from "./frames.js";

// One pair of plots for each channel. `set(record, picture)` with data from frames.js.
export const makeCurves = (opened) => {
  const narrow = window.matchMedia("(max-width: 40rem)").matches;
  // A table has points over the varied quantity, without lines between them.
  const { over } = opened;
  const xLabel = over ? `${over.title}${over.unit ? ` [${over.unit}]` : ""}` : "time in the record [s]";
  const along = over ? over.title : "time";
  const element = h("div", { class: "channels" });
  const pairs = opened.channels.map((channel, c) => {
    const upper = plot({
      height: narrow ? 130 : 170,
      sync: "workbench",
      yLabel: `${channel.title}${channel.shown ? ` [${channel.shown}]` : ""}`,
      describe: `${channel.title}: measured and modelled over ${along}, with the noise of a reading`,
      series: [
        { label: "measured", colour: 1, width: 0, points: true, size: over ? 8 : 3 },
        { label: "± twice the noise", colour: "--band", width: 0 },
        { label: "", colour: "--band", width: 0 },
        { label: "model", colour: 0, width: over ? 1 : 2, points: Boolean(over), size: 5 },
      ],
      bands: [{ between: [2, 3] }],
      ySpace: 28,
      legend: false,
    });
    const lower = plot({
      height: narrow ? 90 : 105,
      sync: "workbench",
      yLabel: narrow ? "/ noise" : "residual / noise",
      xLabel: c === opened.channels.length - 1 ? xLabel : "",
      describe: `${channel.title}: measured less modelled, in units of the noise`,
      series: [
        { label: "+ twice the noise", colour: "--band", width: 0 },
        { label: "− twice the noise", colour: "--band", width: 0 },
        { label: "residual", colour: 0, width: over ? 0 : 1.3, points: Boolean(over), size: 8 },
      ],
      bands: [{ between: [1, 2] }],
      ySpace: 18,
      yRange: (_, low, high) => {
        const most = Math.max(4, Math.abs(low ?? 0), Math.abs(high ?? 0)) * 1.05;
        return [-most, most];
      },
      legend: false,
    });
    const says = h("p", { class: "says" });
    const section = h("section", { class: "channel", "aria-label": channel.title }, h("h3", {}, channel.title, says), upper.element, lower.element);
    element.append(section);
    return { upper, lower, says, section };
  });

  let record = null;
  const setRecord = ({ arrays }) => {
    const times = Array.from(arrays.times.values);
    record = opened.channels.map((_, c) => {
      const counts = row(arrays.counts, c);
      const measured = row(arrays.measured, c).map((value, k) => (counts[k] ? value : null));
      const sigma = row(arrays.sigma, c);
      const edge = (side) => measured.map((value, k) => (value === null ? null : value + side * 2 * sigma[k]));
      return { times, measured, high: edge(1), low: edge(-1), two: times.map(() => 2), less: times.map(() => -2) };
    });
  };
  const setPicture = (model, error) => {
    if (!record) return;
    pairs.forEach(({ upper, lower }, c) => {
      const { times, measured, high, low, two, less } = record[c];
      upper.set([times, measured, high, low, row(model, c)]);
      lower.set([times, two, less, row(error, c).map((value) => (value === null ? null : -value))]);
    });
  };
  const remove = () => pairs.forEach(({ upper, lower }) => (upper.remove(), lower.remove()));
  // The one shown on a narrow screen.
  const choose = (channel) => pairs.forEach(({ section }, c) => section.classList.toggle("chosen", c === channel));
  return { element, setRecord, setPicture, remove, choose, says: pairs.map((pair) => pair.says) };
};
