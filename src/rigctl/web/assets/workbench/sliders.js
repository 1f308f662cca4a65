// A slider with an input field for every parameter, and a switch for every effect.
import { h } from "../lib.js";
import { figure, plain, shown, unitText, withUnit } from "./numbers.js";

const STEPS = 1000;

const position = (slider, si) => {
  const clipped = Math.min(Math.max(si, slider.low), slider.high);
  const share = slider.scale === "log" ? Math.log(clipped / slider.low) / Math.log(slider.high / slider.low) : (clipped - slider.low) / (slider.high - slider.low || 1);
  return Math.round(STEPS * share);
};

const at = (slider, step) => {
  const share = step / STEPS;
  const si = slider.scale === "log" ? slider.low * (slider.high / slider.low) ** share : slider.low + share * (slider.high - slider.low);
  return Number(si.toPrecision(6)); // no spurious digits
};

let count = 0;

// One parameter. `moved(name, si)` while it is dragged, `rested()` when it is released.
export const makeSlider = (slider, { moved, rested }) => {
  const id = `slider-${++count}`;
  const range = h("input", { type: "range", id, min: 0, max: STEPS, step: 1, value: position(slider, slider.value) });
  const unit = unitText(slider.unit);
  const typed = h("input", { type: "text", class: "typed", inputmode: "decimal", autocomplete: "off", "aria-label": `${plain(slider.label)}, typed${unit ? `, in ${unit}` : ""}` });
  let value = slider.value;

  const showValue = () => {
    typed.value = figure(shown(slider, value), 5);
    typed.removeAttribute("aria-invalid");
    range.setAttribute("aria-valuetext", withUnit(slider, value));
    box.classList.toggle("changed", value !== slider.value);
  };
  range.addEventListener("input", () => {
    value = at(slider, range.valueAsNumber);
    showValue();
    moved(slider.name, value);
  });
  range.addEventListener("change", () => rested());
  typed.addEventListener("change", () => {
    const number = Number(typed.value.replace(",", "."));
    if (typed.value.trim() === "" || !Number.isFinite(number)) {
      typed.setAttribute("aria-invalid", "true");
      return;
    }
    value = number * slider.factor + slider.offset;
    range.value = position(slider, value);
    showValue();
    moved(slider.name, value);
    rested();
  });
  const box = h("div", { class: "slider", title: slider.meaning },
    h("label", { for: id }, plain(slider.label), slider.fit ? h("span", { class: "mark", title: "A fit may change it" }, " fitted") : null),
    range, typed, h("span", { class: "unit" }, unit));
  showValue();
  return {
    element: box,
    name: slider.name,
    set: (si) => {
      value = si;
      range.value = position(slider, si);
      showValue();
    },
  };
};

// One effect: a switch, its sliders while it is on, and the buttons `actions(effect)` makes.
export const makeSwitch = (effect, { moved, rested, switched, actions }) => {
  const id = `switch-${++count}`;
  const box = h("input", { type: "checkbox", role: "switch", id, checked: effect.on, onchange: () => switched(effect.name, box.checked) });
  const sliders = effect.sliders.map((one) => makeSlider(one, { moved, rested }));
  const inside = h("div", { class: "inside" }, h("p", { class: "note" }, effect.summary), ...sliders.map((one) => one.element));
  const buttons = h("span", { class: "buttons" });
  const element = h("li", { class: "effect", "data-effect": effect.name },
    h("div", { class: "head" }, box, h("label", { for: id, title: `${effect.equation}\n${effect.looks_like}` }, effect.title, effect.base ? h("span", { class: "mark" }, " base physics") : null), buttons),
    inside);
  const set = (on) => {
    box.checked = on;
    inside.hidden = !on;
    element.classList.toggle("on", on);
    element.classList.toggle("changed", on !== effect.on);
    buttons.replaceChildren(...actions(effect, on));
  };
  set(effect.on);
  return { element, name: effect.name, sliders, set, effect };
};
