// The error of every record: its size, and separately its bias, in sigmas of the noise.
import { h } from "../lib.js";
import { figure } from "./numbers.js";

const BINS = 6;

// size 1 is noise alone; each bin is twice the one before
const sizeBin = (value) => Math.min(Math.max(Math.ceil(2 * Math.log2(Math.max(value, 1e-9) / 1.1)), 0), BINS);
const biasBin = (value) => Math.sign(value) * Math.min(Math.ceil(Math.max(Math.abs(value) - 0.1, 0) / 0.4), BINS);

// `choose(record)` when a cell is selected. Rows and columns are the operating point; its records share a cell.
export const makeMap = (opened, choose) => {
  const { axes, cells } = opened.map;
  const rows = axes[0]?.shown ?? ["all"];
  const columns = axes[1]?.shown ?? [""];
  const at = new Map();
  opened.records.forEach((_, k) => {
    const [r, c] = [cells[k][0] ?? 0, cells[k][1] ?? 0];
    const key = `${r},${c}`;
    at.set(key, [...(at.get(key) ?? []), k]);
  });
  const buttons = [];
  const biases = new Map();
  const turn = new Map();

  const table = (title, fill) => {
    const head = h("tr", {}, h("th", { scope: "col" }, axes[0] ? `${axes[0].title}${axes[0].unit ? ` [${axes[0].unit}]` : ""}` : ""), ...columns.map((text) => h("th", { scope: "col" }, text)));
    const body = rows.map((text, r) => h("tr", {}, h("th", { scope: "row" }, text), ...columns.map((_, c) => h("td", {}, fill(r, c)))));
    const across = axes[1] ? ` over ${axes[1].title}${axes[1].unit ? ` [${axes[1].unit}]` : ""}` : "";
    return h("table", { class: "map" }, h("caption", {}, `${title}${across}`), h("thead", {}, head), h("tbody", {}, ...body));
  };

  const sizes = table("Error, 1 is noise alone", (r, c) => {
    const records = at.get(`${r},${c}`);
    if (!records) return "";
    const made = h("button", { type: "button", class: "cell", tabindex: buttons.length ? -1 : 0 });
    made.addEventListener("click", () => {
      const next = ((turn.get(made) ?? -1) + 1) % records.length;
      turn.set(made, next);
      choose(records[next]);
    });
    made.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [-1, 0], ArrowDown: [1, 0] }[event.key];
      if (!step) return;
      event.preventDefault();
      let [y, x] = [r, c];
      for (;;) {
        [y, x] = [y + step[0], x + step[1]];
        if (y < 0 || x < 0 || y >= rows.length || x >= columns.length) return;
        const other = buttons.find((one) => one.r === y && one.c === x);
        if (other) {
          for (const one of buttons) one.made.tabIndex = one === other ? 0 : -1;
          other.made.focus();
          return;
        }
      }
    });
    buttons.push({ made, records, r, c });
    return made;
  });
  const signed = table("Bias, model − measured", (r, c) => {
    const records = at.get(`${r},${c}`);
    if (!records) return "";
    const made = h("span", { class: "cell" });
    biases.set(`${r},${c}`, made);
    return made;
  });
  const element = h("div", { class: "maps" }, sizes, signed);

  // channel's place, arrays `size` and `bias` of (records, channels); NaN where a record was not simulated
  const set = (channel, title, size, bias, chosen) => {
    const width = size.shape[1];
    for (const { made, records, r, c } of buttons) {
      const here = records.map((k) => size.values[k * width + channel]).filter((value) => !Number.isNaN(value));
      const side = records.map((k) => bias.values[k * width + channel]).filter((value) => !Number.isNaN(value));
      made.classList.toggle("old", !here.length);
      made.classList.toggle("chosen", records.includes(chosen));
      made.setAttribute("aria-pressed", String(records.includes(chosen)));
      if (!here.length) continue;
      const rms = Math.sqrt(here.reduce((sum, value) => sum + value * value, 0) / here.length);
      const mean = side.reduce((sum, value) => sum + value, 0) / side.length;
      made.textContent = figure(rms, 2);
      made.dataset.bin = sizeBin(rms);
      made.setAttribute("aria-label", `${opened.records[records[0]].condition || `record ${records[0] + 1}`}: ${title} ${figure(rms, 2)} sigma, bias ${figure(mean, 2)}`);
      const other = biases.get(`${r},${c}`);
      const rounded = Math.abs(mean) < 0.05 ? "0" : figure(Math.abs(mean), 2);
      other.textContent = rounded === "0" ? "0" : (mean > 0 ? "+" : "−") + rounded;
      other.dataset.bin = biasBin(mean);
    }
  };
  return { element, set };
};
