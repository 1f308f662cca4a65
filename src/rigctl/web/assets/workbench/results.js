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
    series: names.map((label, k) => ({ label, colour: colourOf(label, k), width: hidden.includes(label) ? 0 : label === quiet ? 1 : 1.8, unlisted: hidden.includes(label) && label !== "± twice the noise" })),
  });
  drawn.set([x, ...names.map((name) => named[name])]);
  return drawn.element;
};

// The channels with a visible signal, and always the one with the largest. `quiet` is drawn behind the others.
const inSigmas = (differences, { quiet = "" } = {}) => {
  const most = (channel) => Math.max(0, ...Object.entries(channel.curves).filter(([name]) => name !== quiet).flatMap(([, values]) => values.map((value) => Math.abs(value ?? 0))));
  const largest = Math.max(...differences.channels.map(most));
  return differences.channels
    .filter((channel) => most(channel) > 0.5 || most(channel) === largest)
    .map(({ title, curves: named }) => curves({ x: differences.times, named, quiet, first: quiet ? -1 : 0, xLabel: "time in the record [s]", yLabel: `${title} / noise`, describe: `${title} in units of the noise: ${Object.keys(named).join(", ")}` }));
};

// `adequate` is null where these data cannot tell.
const agreementTone = ({ adequate }) => (adequate === null ? "open" : adequate ? "good" : "bad");

// What would tell slow noise from a missing effect.
const decidedBy = (result) => (result.decided_by.length ? h("div", {}, h("p", { class: "note" }, "What would decide it:"), h("ul", {}, ...result.decided_by.map((text) => h("li", {}, text)))) : null);

// Versions of a model on the same records and noise, one per column.
const beside = (result) => {
  const [first, last] = result.models;
  const names = Object.keys(last.channels);
  const cell = (one, name) => (one.channels[name] ? `${figure(one.channels[name].rmse)} ${one.channels[name].unit}` : "–");
  const held = (one, name) => one.channels[name]?.heldout_rmse ?? null;
  return [
    h("p", { class: `statement ${agreementTone(last)}` }, last.statement),
    decidedBy(last),
    h("p", { class: "note" }, first.statement),
    table("Root mean square error, on the same records", ["", result.names[0], result.names[1], "noise"], [
      ...names.flatMap((name) => [
        [plain(name), cell(first, name), cell(last, name), `${figure(last.channels[name].noise)} ${last.channels[name].unit}`],
        ...(held(last, name) === null ? [] : [[`${plain(name)}, held out`, figure(held(first, name)), figure(held(last, name)), ""]]),
      ]),
      ...(Object.values(last.channels).some((one) => one.noise_source === "floor") ? [] : [["reduced χ²", figure(first.chi2_reduced), figure(last.chi2_reduced), "1"]]),
    ]),
    ...(result.residuals ? [h("h3", {}, "What each leaves"), h("p", { class: "note" }, result.residuals.record), ...inSigmas(result.residuals)] : []),
  ];
};

export const comparison = (result) => (result.models?.length > 1 ? beside(result) : agreement(result));

const agreement = (result) => [
  h("p", { class: `statement ${agreementTone(result)}` }, result.statement),
  decidedBy(result),
  table("By channel", ["channel", "RMSE", "noise", "RMSE/noise", "bias", "χ²"], Object.entries(result.channels).map(([name, one]) => [plain(name), `${figure(one.rmse)} ${one.unit}`, `${figure(one.noise)} ${one.unit}`, figure(one.nrmse, 3), `${figure(one.bias, 2)} ${one.unit}`, figure(one.noise_source === "floor" ? null : one.chi2_reduced, 4)])),
  fold("Where it fails, and the tests",
    table("Where it fails", ["", "share of the error", "error/noise", "p"], result.where.slice(0, 12).map((one) => [`${one.by} ${one.label}`, percent(one.share_of_error), figure(one.rmse, 3), chance(one.p_value)])),
    table("Tests", ["", "statistic", "p"], Object.entries(result.tests).map(([name, one]) => [name, figure(one.statistic, 4), chance(one.p_value)])),
    ...result.notes.map((text) => h("p", { class: "note" }, text))),
];

const parameters = (values) => Object.entries(values).map(([name, one]) => `${plain(name)} ${spread(one.value, one.std)} ${unitText(one.unit)}`.trim()).join(", ");

// `actions`: { look(state), add(effect), improve(), design(), discover() }
export const diagnosis = (result, actions) => {
  const titleOf = (name) => result.titles[name] ?? plain(name);
  const tone = result.doubt ? "open" : { adequate: "good", missing_effect: "bad", ambiguous: "warn", outside_library: "warn", undecided: "open" }[result.verdict];
  const ranked = result.verdict === "adequate" ? [] : result.ranking.slice(0, 6);
  const line = (one) => {
    const state = result.states[one.effect];
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
    h("p", {}, h("strong", {}, `${one.titles.slice(0, -1).join(", ")} or ${one.titles.at(-1)}`), ` — these data cannot distinguish them${one.difference ? "; their difference:" : "."}`),
    ...(one.difference ? [h("p", { class: "note" }, one.difference.record), ...inSigmas(one.difference)] : []));
  return [
    h("p", { class: `statement ${tone}` }, h("strong", {}, `${result.title}. `), result.statement),
    decidedBy(result),
    ranked.length ? h("ul", { class: "ranking", "aria-label": "Probability that an effect is among what is missing" }, ...ranked.map(line)) : null,
    result.effects.length ? h("div", { class: "toolbar" }, button(result.verdict === "missing_effect" ? "Add what is missing" : "Add the most likely", actions.improve, { class: result.verdict === "missing_effect" ? "primary" : "" })) : null,
    result.alike.length ? h("div", {}, h("h3", {}, "Not distinguished"), ...result.alike.map(group)) : null,
    h("div", { class: "toolbar" }, result.alike.length ? button("What to measure next", actions.design, { class: "primary" }) : null, result.verdict === "outside_library" ? button("Look for a formula", actions.discover) : null),
    result.signatures ? fold("What each would explain", h("p", { class: "note" }, `over the residual of ${result.signatures.record}, in grey`), ...inSigmas(result.signatures, { quiet: "measured − model" })) : null,
    fold("For and against", h("ul", {}, ...result.evidence.map((text) => h("li", {}, text))), ...(result.drift.length ? [table("Fitted parameters", ["", "without", "with it"], result.drift.map((one) => [plain(one.parameter), spread(one.before, one.before_std), `${spread(one.after, one.after_std)} ${unitText(one.unit)}`]))] : [])),
  ];
};

export const improvement = (result) => [
  h("p", { class: "statement" }, result.improvement),
  table("Steps", ["added", "version", "χ² before", "χ² after"], result.steps.map((one) => [one.effects.map(plain).join(", "), one.version, figure(one.before.chi2_reduced), figure(one.after.chi2_reduced)])),
];

export const change = (result) => [
  h("p", { class: "statement" }, `${result.model} is now version ${result.version}.`),
  result.before && result.after
    ? table("Error", ["", "before", "after", "noise"], Object.keys(result.after.rmse).map((name) => [plain(name), `${figure(result.before.rmse[name])} ${result.after.units[name]}`, `${figure(result.after.rmse[name])} ${result.after.units[name]}`, figure(result.after.noise[name])]))
    : null,
];

export const discovery = (result) => {
  const drawn = result.curves.map((one) => {
    const points = one.points;
    const column = (key) => points.map((point) => point[key]);
    const multiplied = one.times ? ` (times ${one.times})` : "";
    return h("div", {}, h("h3", {}, `${plain(one.slot)} over ${plain(one.over)}${multiplied}`),
      one.free ? h("p", { class: "note" }, "The fitted parameters absorb a component of this term: these data do not determine its size, and it is not in the curve.") : "",
      curves({ x: column("x"), named: { "the term": column("value"), "highest within its band": column("high"), "lowest within its band": column("low") }, hidden: ["highest within its band", "lowest within its band"], bands: [{ between: [2, 3] }], xLabel: `${plain(one.over)} [${unitText(one.over_unit)}]`, yLabel: `${plain(one.slot)} [${unitText(one.unit)}]`, describe: `The term at ${plain(one.slot)} over ${plain(one.over)}, with its 95 % band` }));
  });
  return [
    h("p", { class: "statement" }, result.statement),
    ...drawn.slice(0, 1),
    drawn.length > 1 ? fold("The same misfit at other locations, or over other variables", ...drawn.slice(1)) : null,
    result.formulas.length ? table("Formulas that these data do not distinguish from the best", ["formula", "parameters", "Δ", "accepted"], result.formulas.map((one) => [one.formula, parameters(one.parameters), figure(one.delta, 3), one.accepted ? "yes" : "no"]), "") : null,
  ];
};

// `approve(effects)` carries it out on the simulated bench
export const experiment = (design, { approve, toReal }) => {
  const titleOf = (name) => design.titles[name] ?? plain(name);
  const hidden = h("input", { type: "text", id: "bench-hides", placeholder: "valve_leakage:conductance=4e-16 m^3", size: 34, spellcheck: "false" });
  const record = (one, k) => h("div", { class: "group" },
    h("h3", {}, `${one.duration ? "Record" : "Row"} ${k + 1}: ${Object.entries(one.settings).map(([name, value]) => `${plain(name)} ${value}`).join(", ")}`),
    h("p", { class: "note" }, one.duration ? `${one.why}. It takes ${duration(one.duration)}.` : `${one.why}.`),
    ...distinguishing(design.predictions[k] ?? []).flatMap(predicted));
  // Channels in which the rivals agree are left out.
  const distinguishing = (channels) => {
    const some = channels.filter((channel) => apart(channel) > 0.5);
    return some.length ? some : channels.slice(-1);
  };
  const less = ({ by_rival, sigma }, name) => by_rival[name].map((value, at) => (value - by_rival[Object.keys(by_rival)[0]][at]) / sigma[at]);
  const apart = (channel) => Math.max(0, ...Object.keys(channel.by_rival).slice(1, 4).flatMap((name) => less(channel, name).map(Math.abs)));
  const predicted = (channel) => {
    const names = Object.keys(channel.by_rival).slice(0, 4);
    const first = channel.by_rival[names[0]];
    const named = Object.fromEntries(names.map((name) => [titleOf(name), channel.by_rival[name]]));
    named["± twice the noise"] = first.map((value, at) => value + 2 * channel.sigma[at]);
    named[""] = first.map((value, at) => value - 2 * channel.sigma[at]);
    const drawn = [curves({ x: channel.times, named, hidden: ["± twice the noise", ""], bands: [{ between: [names.length + 1, names.length + 2] }], yLabel: `${channel.channel} [${channel.unit}]`, describe: `${channel.channel}: what each rival predicts` })];
    if (names.length > 1) {
      const others = Object.fromEntries(names.slice(1).map((name) => [`${titleOf(name)} less ${titleOf(names[0])}`, less(channel, name)]));
      drawn.push(curves({ x: channel.times, named: others, height: 130, first: 1, xLabel: "time in the record [s]", yLabel: "difference / noise", describe: `${channel.channel}: the others less ${titleOf(names[0])}, in units of the noise` }));
    }
    return drawn;
  };
  return [
    h("p", { class: "statement" }, design.statement),
    design.records.length
      ? h("ul", { class: "figures" },
          h("li", {}, h("b", {}, `${percent(design.probability_before)} → ${percent(design.probability)}`), "probability that a diagnosis names the right effect"),
          design.duration ? h("li", {}, h("b", {}, duration(design.duration)), "of bench time") : null,
          h("li", {}, h("b", {}, String(design.records.length)), `${design.duration ? "record" : "row"}${design.records.length === 1 ? "" : "s"}`))
      : null,
    table("Rivals", ["", "weight", "parameters"], design.rivals.map((one) => [titleOf(one.name), percent(one.weight), parameters(one.parameters)])),
    ...design.records.map(record),
    design.procedure
      ? h("div", {},
          fold("The procedure", h("pre", { tabindex: 0, "aria-label": "The procedure" }, design.procedure)),
          h("div", { class: "toolbar" },
            button("Approve: run it on the simulated bench", () => approve(hidden.value.split(";").map((one) => one.trim()).filter(Boolean)), { class: "primary" }),
            h("label", { for: "bench-hides" }, "the simulated bench hides"), hidden),
          h("div", { class: "toolbar" }, button("Approve for the real bench…", toReal), h("span", { class: "note" }, "keeps the procedure; the page of procedures asks for the bench by its name")))
      : null,
  ];
};
