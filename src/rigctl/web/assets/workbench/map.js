// The error of every record: its size, and separately its bias, in units of the noise.
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
    const square = h("button", { type: "button", class: "cell", tabindex: buttons.length ? -1 : 0 });
    square.addEventListener("click", () => {
      const next = ((turn.get(square) ?? -1) + 1) % records.length;
      turn.set(square, next);
      choose(records[next]);
    });
    square.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [-1, 0], ArrowDown: [1, 0] }[event.key];
      if (!step) return;
      event.preventDefault();
      let [y, x] = [r, c];
      for (;;) {
        [y, x] = [y + step[0], x + step[1]];
        if (y < 0 || x < 0 || y >= rows.length || x >= columns.length) return;
        const other = buttons.find((one) => one.r === y && one.c === x);
        if (other) {
          for (const one of buttons) one.square.tabIndex = one === other ? 0 : -1;
          other.square.focus();
          return;
        }
      }
    });
    buttons.push({ square, records, r, c });
    return square;
  });
  const signed = table("Bias, model − measured", (r, c) => {
    const records = at.get(`${r},${c}`);
    if (!records) return "";
    const cell = h("span", { class: "cell" });
    biases.set(`${r},${c}`, cell);
    return cell;
  });
  const element = h("div", { class: "maps" }, sizes, signed);

  // channel's place, arrays `size` and `bias` of (records, channels); NaN where a record was not simulated
  const set = (channel, title, size, bias, chosen) => {
    const width = size.shape[1];
    for (const { square, records, r, c } of buttons) {
      const errors = records.map((k) => size.values[k * width + channel]).filter((value) => !Number.isNaN(value));
      const side = records.map((k) => bias.values[k * width + channel]).filter((value) => !Number.isNaN(value));
      square.classList.toggle("old", !errors.length);
      square.classList.toggle("chosen", records.includes(chosen));
      square.setAttribute("aria-pressed", String(records.includes(chosen)));
      if (!errors.length) continue;
      const rms = Math.sqrt(errors.reduce((sum, value) => sum + value * value, 0) / errors.length);
      const mean = side.reduce((sum, value) => sum + value, 0) / side.length;
      square.textContent = figure(rms, 2);
      square.dataset.bin = sizeBin(rms);
      square.setAttribute("aria-label", `${opened.records[records[0]].condition || `record ${records[0] + 1}`}: ${title} ${figure(rms, 2)} times the noise, bias ${figure(mean, 2)}`);
      const other = biases.get(`${r},${c}`);
      const rounded = Math.abs(mean) < 0.05 ? "0" : figure(Math.abs(mean), 2);
      other.textContent = rounded === "0" ? "0" : (mean > 0 ? "+" : "−") + rounded;
      other.dataset.bin = biasBin(mean);
    }
  };
  return { element, set };
};
