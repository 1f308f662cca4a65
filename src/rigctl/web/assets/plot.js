// Curves by uPlot, in the page's colours, redrawn when these change, at the available width.
import { colour, h, onTheme } from "./lib.js";

export const palette = () => ["--curve-1", "--curve-2", "--curve-3", "--curve-4"].map(colour);

const font = () => `12px ${getComputedStyle(document.body).fontFamily}`;

// Labels of an axis: enough digits to distinguish them, and powers of ten for very small or large values.
const marks = (_, values) => {
  const known = values.filter((value) => value !== null);
  const step = known.length > 1 ? Math.abs(known[1] - known[0]) : 1;
  const most = Math.max(...known.map(Math.abs), 0);
  if (most && (most < 1e-3 || most >= 1e6)) {
    const digits = Math.min(Math.max(Math.floor(Math.log10(most)) - Math.floor(Math.log10(step) + 1e-9), 0) + 1, 7);
    const short = (value) => value.toExponential(digits).replace(/\.?0+e/, "e").replace("e+", "e");
    return values.map((value) => (value === null ? null : value ? short(value) : "0"));
  }
  const digits = Math.min(Math.max(-Math.floor(Math.log10(step) + 1e-9), 0), 12);
  return values.map((value) => (value === null ? null : String(Number(value.toFixed(digits + 1)))));
};

const axis = (label, more = {}) => ({
  stroke: colour("--quiet"),
  grid: { stroke: colour("--grid"), width: 1 },
  ticks: { stroke: colour("--grid"), width: 1, size: 4 },
  font: font(),
  labelFont: font(),
  label,
  labelSize: label ? 20 : 0,
  ...more,
});

// options: { height, series: [{ label, colour: 0, dash, width, points, size, unlisted }], bands: [{ between: [2, 3] }], logX, xLabel, xValues, xFilter, yLabel, yRange, ySpace, hooks, legend, sync, describe }
// Returns { element, set(data), remove() }; data as uPlot has it: [x, y1, y2 …].
export const plot = (options) => {
  const figure = h("figure", { class: "curves", role: "img", "aria-label": options.describe ?? options.yLabel ?? "plot" });
  let drawn = null;
  let data = null;

  const make = () => {
    drawn?.destroy();
    const colours = palette();
    const paint = (given) => (given === undefined ? colours[0] : typeof given === "number" ? colours[given] : colour(given));
    const bands = (options.bands ?? []).map(({ between, shade }) => ({ series: between, fill: colour(shade ?? "--band") }));
    const series = options.series.map((one) => ({
      label: one.label,
      stroke: paint(one.colour),
      width: one.width ?? 1.5,
      dash: one.dash,
      paths: one.stepped ? uPlot.paths.stepped({ align: 1 }) : undefined,
      points: { show: Boolean(one.points), size: one.size ?? 5, stroke: paint(one.colour) },
      spanGaps: false,
    }));
    drawn = new uPlot(
      {
        width: Math.max(figure.clientWidth, 200),
        height: options.height ?? 220,
        scales: { x: { time: false, distr: options.logX ? 3 : 1, range: options.xRange }, y: { range: options.yRange } },
        axes: [axis(options.xLabel, { size: options.xLabel ? 26 : 24, values: options.xValues ?? marks, ...(options.xFilter ? { filter: options.xFilter } : {}) }), axis(options.yLabel, { size: 56, values: marks, ...(options.ySpace ? { space: options.ySpace } : {}) })],
        bands,
        series: [{ label: options.xName ?? "time", value: (_, value) => (value === null || value === undefined ? "–" : value.toFixed(2)) }, ...series],
        legend: { show: options.legend ?? series.length > 1, live: options.live ?? false },
        cursor: { y: false, points: { size: 6 }, sync: options.sync ? { key: options.sync } : undefined, drag: { x: options.zoom ?? true, y: false } },
        hooks: options.hooks?.() ?? {},
        padding: [8, 10, 0, 0],
      },
      data,
      figure,
    );
    const listed = drawn.root.querySelectorAll(".u-legend .u-series");
    const first = listed.length - options.series.length; // a static legend has no row for x
    options.series.forEach((one, k) => one.unlisted && listed[k + first]?.classList.add("hidden"));
  };

  const set = (next) => {
    data = next;
    if (!drawn) {
      if (figure.isConnected && figure.clientWidth) make();
      return;
    }
    drawn.setData(data);
  };

  const observer = new ResizeObserver(() => {
    if (!figure.clientWidth || !data) return;
    if (!drawn) make();
    else if (Math.abs(drawn.width - figure.clientWidth) > 1) drawn.setSize({ width: figure.clientWidth, height: drawn.height });
  });
  observer.observe(figure);
  onTheme(() => drawn && make());
  return {
    element: figure,
    set,
    get drawn() {
      return drawn;
    },
    remove: () => {
      observer.disconnect();
      drawn?.destroy();
      drawn = null;
      figure.remove();
    },
  };
};
