// The reduction of the error from version to version, limited by the noise.
import { api, button, h } from "../lib.js";
import { figure, plain } from "./numbers.js";

const NS = "http://www.w3.org/2000/svg";
const svg = (tag, attributes, ...inside) => {
  const element = document.createElementNS(NS, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...inside);
  return element;
};

const WIDTH = 360, HEIGHT = 150, LEFT = 46, RIGHT = 12, TOP = 12, BOTTOM = 26;

// The systematic part of an error, in units of the noise, without the noise.
const systematic = (error, name) => {
  const [rmse, noise] = [error.rmse[name], error.noise[name]];
  return noise ? Math.sqrt(Math.max(rmse * rmse - noise * noise, 0)) / noise : null;
};

const chart = (name, errors) => {
  const values = errors.map((error) => systematic(error, name));
  const most = Math.max(1, ...values.filter(Number.isFinite)) * 1.1;
  const x = (k) => LEFT + (errors.length === 1 ? 0.5 : k / (errors.length - 1)) * (WIDTH - LEFT - RIGHT);
  const y = (value) => TOP + (1 - value / most) * (HEIGHT - TOP - BOTTOM);
  const summary = errors.map((error, k) => `version ${error.version} ${figure(values[k], 2)}`).join(", ");
  const drawing = svg("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, class: "fall", role: "img", "aria-label": `${plain(name)}, systematic error in units of the noise: ${summary}` },
    svg("rect", { x: LEFT, y: y(Math.min(1, most)), width: WIDTH - LEFT - RIGHT, height: y(0) - y(Math.min(1, most)), class: "noise" }),
    svg("line", { x1: LEFT, y1: y(0), x2: WIDTH - RIGHT, y2: y(0), class: "base" }),
    svg("polyline", { points: values.map((value, k) => `${x(k)},${y(value)}`).join(" "), class: "line" }));
  for (const mark of [0, most / 1.1]) drawing.append(Object.assign(svg("text", { x: LEFT - 6, y: y(mark) + 4, "text-anchor": "end" }), { textContent: figure(mark, 2) }));
  errors.forEach((error, k) => {
    drawing.append(svg("circle", { cx: x(k), cy: y(values[k]), r: 4, class: "dot" }));
    drawing.append(Object.assign(svg("text", { x: x(k), y: HEIGHT - 8, "text-anchor": "middle" }), { textContent: `v${error.version}` }));
  });
  return h("figure", { class: "fall" }, h("figcaption", {}, `${plain(name)} / noise`), drawing);
};

// `open(version)` shows another version; `beside(version)` compares it with the open one.
export const history = async (container, model, { version: openVersion, open, beside }) => {
  const listing = await api("/api/workbench/history", { query: { model } });
  const channels = [...new Set(listing.errors.flatMap((error) => Object.keys(error.rmse)))];
  const alike = new Set(listing.errors.map((error) => JSON.stringify([error.runs, error.hold_out, error.only, error.assume])));
  container.replaceChildren(
    listing.errors.length ? h("div", { class: "falls" }, ...channels.map((name) => chart(name, listing.errors))) : h("p", { class: "note" }, "No version has been held against runs yet."),
    alike.size > 1 ? h("p", { class: "note" }, "Not all errors were computed on the same runs and held-out records: compare with care.") : "",
    h("ol", { class: "versions" }, ...listing.versions.map((one) => h("li", { value: one.version, class: one.version === listing.current ? "current" : "" }, h("strong", {}, one.done), one.version === openVersion ? h("span", { class: "mark" }, " open here") : h("span", { class: "buttons" },
      button("Open", () => open(one.version, listing.current), { class: "small", "aria-label": `Open version ${one.version}` }),
      button("Compare", () => beside(one.version), { class: "small", "aria-label": `Compare version ${one.version} with version ${openVersion}`, title: "Both on these records, beside each other" })),
      h("span", { class: "note" }, ` ${one.time.slice(0, 16).replace("T", " ")} UTC${one.note ? `: ${one.note}` : ""}`)))),
  );
};
