// Results of the buttons: the answer in a sentence first, then the evidence.
import { button, h } from "../lib.js";
import { plot } from "../plot.js";
import { chance, duration, figure, percent, plain, spread, unitText } from "./numbers.js";

const COLOURS = [0, 1, 2, 3];

const table = (caption, heads, lines, kind = "numbers") =>
  h("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": caption }, h("table", { class: kind }, h("caption", {}, caption), h("thead", {}, h("tr", {}, ...heads.map((one) => h("th", { scope: "col" }, one)))), h("tbody", {}, ...lines.map((line) => h("tr", {}, ...line.map((one, k) => (k ? h("td", {}, one) : h("th", { scope: "row" }, one))))))));

const fold = (title, ...inside) => h("details", {}, h("summary", {}, title), ...inside);

// Curves by name over one x: { times, curves: { name: [...] } }
const curves = ({ x, named, xLabel, yLabel, describe, height, bands = [], hidden = [], quiet = "", first = 0 }) => {
  const names = Object.keys(named);
  const colourOf = (label, k) => (hidden.includes(label) ? "--band" : label === quiet ? "--series-8" : COLOURS[(k + first) % COLOURS.length]);
  const drawn = plot({
    height: height ?? 190, xLabel, yLabel, describe, legend: true, bands,
    series: names.map((label, k) => ({ label, colour: colourOf(label, k), width: hidden.includes(label) ? 0 : label === quiet ? 1 : 1.8, unlisted: hidden.includes(label) && label !== "± 2 sigma" })),
  });
  drawn.set([x, ...names.map((name) => named[name])]);
  return drawn.element;
};

// The channels with a visible signal, and always the one with the largest. `quiet` is drawn behind the others.
const inSigmas = (found, { quiet = "" } = {}) => {
  const most = (channel) => Math.max(0, ...Object.entries(channel.curves).filter(([name]) => name !== quiet).flatMap(([, values]) => values.map((value) => Math.abs(value ?? 0))));
  const largest = Math.max(...found.channels.map(most));
  return found.channels
    .filter((channel) => most(channel) > 0.5 || most(channel) === largest)
    .map(({ title, curves: named }) => curves({ x: found.times, named, quiet, first: quiet ? -1 : 0, xLabel: "time in the record [s]", yLabel: `${title} [σ]`, describe: `${title} in sigmas: ${Object.keys(named).join(", ")}` }));
};

// Versions of a model on the same records and noise, one per column.
const beside = (found) => {
  const [first, last] = found.models;
  const names = Object.keys(last.channels);
  const cell = (one, name) => (one.channels[name] ? `${figure(one.channels[name].rmse)} ${one.channels[name].unit}` : "–");
  const held = (one, name) => one.channels[name]?.heldout_rmse ?? null;
  return [
    h("p", { class: `statement ${last.adequate ? "good" : last.below_noise ? "warn" : "bad"}` }, last.statement),
    h("p", { class: "note" }, first.statement),
    table("Root mean square error, on the same records", ["", found.names[0], found.names[1], "noise"], [
      ...names.flatMap((name) => [
        [plain(name), cell(first, name), cell(last, name), `${figure(last.channels[name].noise)} ${last.channels[name].unit}`],
        ...(held(last, name) === null ? [] : [[`${plain(name)}, held out`, figure(held(first, name)), figure(held(last, name)), ""]]),
      ]),
      ["reduced χ²", figure(first.chi2_reduced), figure(last.chi2_reduced), "1"],
    ]),
    ...(found.residuals ? [h("h3", {}, "What each leaves"), h("p", { class: "note" }, found.residuals.record), ...inSigmas(found.residuals)] : []),
  ];
};

export const comparison = (found) => (found.models?.length > 1 ? beside(found) : agreement(found));

const agreement = (found) => [
  h("p", { class: `statement ${found.adequate ? "good" : found.below_noise ? "warn" : "bad"}` }, found.statement),
  table("By channel", ["channel", "RMSE", "noise", "RMSE/noise", "bias", "χ²"], Object.entries(found.channels).map(([name, one]) => [plain(name), `${figure(one.rmse)} ${one.unit}`, `${figure(one.noise)} ${one.unit}`, figure(one.nrmse, 3), `${figure(one.bias, 2)} ${one.unit}`, figure(one.chi2_reduced, 4)])),
  fold("Where it fails, and the tests",
    table("Where it fails", ["", "share of the error", "error/noise", "p"], found.where.slice(0, 12).map((one) => [`${one.by} ${one.label}`, percent(one.share_of_error), figure(one.rmse, 3), chance(one.p_value)])),
    table("Tests", ["", "statistic", "p"], Object.entries(found.tests).map(([name, one]) => [name, figure(one.statistic, 4), chance(one.p_value)])),
    ...found.notes.map((text) => h("p", { class: "note" }, text))),
];

const parameters = (found) => Object.entries(found).map(([name, one]) => `${plain(name)} ${spread(one.value, one.std)} ${unitText(one.unit)}`.trim()).join(", ");

// `actions`: { look(state), add(effect), improve(), design(), discover() }
export const diagnosis = (found, actions) => {
  const titleOf = (name) => found.titles[name] ?? plain(name);
  const tone = { adequate: "good", missing_effect: "bad", ambiguous: "warn", outside_library: "warn" }[found.verdict];
  const ranked = found.verdict === "adequate" ? [] : found.ranking.slice(0, 6);
  const line = (one) => {
    const state = found.states[one.effect];
    return h("li", {},
      h("span", { class: "name" }, titleOf(one.effect)),
      h("meter", { min: 0, max: 1, value: one.probability, "aria-label": `probability of ${titleOf(one.effect)}` }),
      h("span", { class: "share" }, percent(one.probability)),
      h("span", { class: "note" }, parameters(one.parameters)),
      h("span", { class: "buttons" },
        state ? button("Look", () => actions.look(state), { class: "small", title: "Set the sliders to it; undo takes it back" }) : null,
        button("Add", () => actions.add(one.effect), { class: "small", title: "Fit it, and keep it as the next version" })));
  };
  const group = (one) => h("div", { class: "group" },
    h("p", {}, h("strong", {}, `${one.titles.slice(0, -1).join(", ")} or ${one.titles.at(-1)}`), ` — these data cannot tell them apart${one.difference ? "; what is between them:" : "."}`),
    ...(one.difference ? [h("p", { class: "note" }, one.difference.record), ...inSigmas(one.difference)] : []));
  return [
    h("p", { class: `statement ${tone}` }, h("strong", {}, `${found.title}. `), found.statement),
    ranked.length ? h("ul", { class: "ranking", "aria-label": "Probability that an effect is among what is missing" }, ...ranked.map(line)) : null,
    found.effects.length ? h("div", { class: "toolbar" }, button(found.verdict === "missing_effect" ? "Add what is missing" : "Add the most likely", actions.improve, { class: found.verdict === "missing_effect" ? "primary" : "" })) : null,
    found.alike.length ? h("div", {}, h("h3", {}, "Not distinguished"), ...found.alike.map(group)) : null,
    h("div", { class: "toolbar" }, found.alike.length ? button("What to measure next", actions.design, { class: "primary" }) : null, found.verdict === "outside_library" ? button("Look for a formula", actions.discover) : null),
    found.signatures ? fold("What each would explain", h("p", { class: "note" }, `over the residual of ${found.signatures.record}, in grey`), ...inSigmas(found.signatures, { quiet: "measured − model" })) : null,
    fold("For and against", h("ul", {}, ...found.evidence.map((text) => h("li", {}, text))), ...(found.drift.length ? [table("Fitted parameters", ["", "without", "with it"], found.drift.map((one) => [plain(one.parameter), spread(one.before, one.before_std), `${spread(one.after, one.after_std)} ${unitText(one.unit)}`]))] : [])),
  ];
};

export const improvement = (found) => [
  h("p", { class: "statement" }, found.improvement),
  table("Steps", ["added", "version", "χ² before", "χ² after"], found.steps.map((one) => [one.effects.map(plain).join(", "), one.version, figure(one.before.chi2_reduced), figure(one.after.chi2_reduced)])),
];

export const change = (found) => [
  h("p", { class: "statement" }, `${found.model} is now version ${found.version}.`),
  found.before && found.after
    ? table("Error", ["", "before", "after", "noise"], Object.keys(found.after.rmse).map((name) => [plain(name), `${figure(found.before.rmse[name])} ${found.after.units[name]}`, `${figure(found.after.rmse[name])} ${found.after.units[name]}`, figure(found.after.noise[name])]))
    : null,
];

export const discovery = (found) => {
  const drawn = found.curves.map((one) => {
    const points = one.points;
    const column = (key) => points.map((point) => point[key]);
    const multiplied = one.times ? ` (times ${one.times})` : "";
    return h("div", {}, h("h3", {}, `${plain(one.slot)} over ${plain(one.over)}${multiplied}`),
      one.free ? h("p", { class: "note" }, "The fit absorbs part of this term: that part may have any size for all these data say, and is not in the curve.") : "",
      curves({ x: column("x"), named: { "the term": column("value"), "highest within its band": column("high"), "lowest within its band": column("low") }, hidden: ["highest within its band", "lowest within its band"], bands: [{ between: [2, 3] }], xLabel: `${plain(one.over)} [${unitText(one.over_unit)}]`, yLabel: `${plain(one.slot)} [${unitText(one.unit)}]`, describe: `The term at ${plain(one.slot)} over ${plain(one.over)}, with its 95 % band` }));
  });
  return [
    h("p", { class: "statement" }, found.statement),
    ...drawn.slice(0, 1),
    drawn.length > 1 ? fold("The same misfit at other places, or over other variables", ...drawn.slice(1)) : null,
    found.formulas.length ? table("Formulas that these data do not tell from the best", ["formula", "parameters", "Δ", "accepted"], found.formulas.map((one) => [one.formula, parameters(one.parameters), figure(one.delta, 3), one.accepted ? "yes" : "no"]), "") : null,
  ];
};

// `approve(effects)` carries it out on the simulated bench
export const experiment = (found, { approve, toReal }) => {
  const titleOf = (name) => found.titles[name] ?? plain(name);
  const hidden = h("input", { type: "text", id: "bench-hides", placeholder: "valve_leakage:conductance=4e-16 m^3", size: 34, spellcheck: "false" });
  const record = (one, k) => h("div", { class: "group" },
    h("h3", {}, `${one.duration ? "Record" : "Row"} ${k + 1}: ${Object.entries(one.settings).map(([name, value]) => `${plain(name)} ${value}`).join(", ")}`),
    h("p", { class: "note" }, one.duration ? `${one.why}. It takes ${duration(one.duration)}.` : `${one.why}.`),
    ...telling(found.predictions[k] ?? []).flatMap(predicted));
  // Channels in which the rivals agree are left out.
  const telling = (channels) => {
    const some = channels.filter((channel) => apart(channel) > 0.5);
    return some.length ? some : channels.slice(-1);
  };
  const less = ({ by_rival, sigma }, name) => by_rival[name].map((value, at) => (value - by_rival[Object.keys(by_rival)[0]][at]) / sigma[at]);
  const apart = (channel) => Math.max(0, ...Object.keys(channel.by_rival).slice(1, 4).flatMap((name) => less(channel, name).map(Math.abs)));
  const predicted = (channel) => {
    const names = Object.keys(channel.by_rival).slice(0, 4);
    const first = channel.by_rival[names[0]];
    const named = Object.fromEntries(names.map((name) => [titleOf(name), channel.by_rival[name]]));
    named["± 2 sigma"] = first.map((value, at) => value + 2 * channel.sigma[at]);
    named[""] = first.map((value, at) => value - 2 * channel.sigma[at]);
    const drawn = [curves({ x: channel.times, named, hidden: ["± 2 sigma", ""], bands: [{ between: [names.length + 1, names.length + 2] }], yLabel: `${channel.channel} [${channel.unit}]`, describe: `${channel.channel}: what each rival predicts` })];
    if (names.length > 1) {
      const others = Object.fromEntries(names.slice(1).map((name) => [`${titleOf(name)} less ${titleOf(names[0])}`, less(channel, name)]));
      drawn.push(curves({ x: channel.times, named: others, height: 130, first: 1, xLabel: "time in the record [s]", yLabel: "difference [σ]", describe: `${channel.channel}: the others less ${titleOf(names[0])}, in sigmas` }));
    }
    return drawn;
  };
  return [
    h("p", { class: "statement" }, found.statement),
    found.records.length
      ? h("ul", { class: "figures" },
          h("li", {}, h("b", {}, `${percent(found.probability_before)} → ${percent(found.probability)}`), "chance that a diagnosis names what is right"),
          found.duration ? h("li", {}, h("b", {}, duration(found.duration)), "of bench time") : null,
          h("li", {}, h("b", {}, String(found.records.length)), `${found.duration ? "record" : "row"}${found.records.length === 1 ? "" : "s"}`))
      : null,
    table("Rivals", ["", "weight", "parameters"], found.rivals.map((one) => [titleOf(one.name), percent(one.weight), parameters(one.parameters)])),
    ...found.records.map(record),
    found.procedure
      ? h("div", {},
          fold("The procedure", h("pre", { tabindex: 0, "aria-label": "The procedure" }, found.procedure)),
          h("div", { class: "toolbar" },
            button("Approve: run it on the simulated bench", () => approve(hidden.value.split(";").map((one) => one.trim()).filter(Boolean)), { class: "primary" }),
            h("label", { for: "bench-hides" }, "the simulated bench hides"), hidden),
          h("div", { class: "toolbar" }, button("Approve for the real bench…", toReal), h("span", { class: "note" }, "keeps the procedure; the page of procedures asks for the bench by its name")))
      : null,
  ];
};
